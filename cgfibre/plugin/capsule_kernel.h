// The kernels of capsule_lanes.h for WIDTH lanes a register. Included once by each capsule_lanes_*.cpp, which sets WIDTH,
// KERNELS, KERNEL_LANES and what the compiler may use; nothing here may be shared between them, hence the unnamed
// namespace, and no template of the standard library.

#include "capsule_lanes.h"
#include "crossing_law.h"

namespace cgfibre {
namespace {

#define LANE_INLINE inline __attribute__((always_inline))

typedef double Lanes __attribute__((vector_size(8 * WIDTH)));
typedef long long Mask __attribute__((vector_size(8 * WIDTH)));

LANE_INLINE Lanes every(double a) { return Lanes{} + a; }
LANE_INLINE Lanes greater(Lanes a, Lanes b) { return a > b ? a : b; }
LANE_INLINE Lanes lesser(Lanes a, Lanes b) { return a < b ? a : b; }
LANE_INLINE Lanes size_of(Lanes a) { return a < 0.0 ? -a : a; }
LANE_INLINE Lanes load(const double *a) { return *reinterpret_cast<const Lanes *>(a); }
LANE_INLINE void keep(double *a, Lanes v) { *reinterpret_cast<Lanes *>(a) = v; }

// a vector of what `of(lane)` gives
#if WIDTH == 8
#define EACH_LANE(of) Lanes{of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)}
LANE_INLINE Lanes root(Lanes a) { return (Lanes) _mm512_maskz_sqrt_pd(0xff, (__m512d) a); }
LANE_INLINE unsigned bits(Mask m) { return _mm512_movepi64_mask((__m512i) m); }
#elif WIDTH == 4
#define EACH_LANE(of) Lanes{of(0), of(1), of(2), of(3)}
LANE_INLINE Lanes root(Lanes a) { return (Lanes) _mm256_sqrt_pd((__m256d) a); }
LANE_INLINE unsigned bits(Mask m) { return _mm256_movemask_pd((__m256d) m); }
#else
#define EACH_LANE(of) Lanes{of(0), of(1)}
LANE_INLINE Lanes root(Lanes a) { return Lanes{__builtin_sqrt(a[0]), __builtin_sqrt(a[1])}; }
LANE_INLINE unsigned bits(Mask m) { return (m[0] ? 1 : 0) | (m[1] ? 2 : 0); }
#endif

LANE_INLINE Lanes dot3(const Lanes *a, const Lanes *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

LANE_INLINE void cross3(const Lanes *a, const Lanes *b, Lanes *c)
{
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

// numbers of each lane's own place in memory
LANE_INLINE Lanes gather1(const double *const *from, int offset)
{
#define HERE(lane) from[lane][offset]
  return EACH_LANE(HERE);
#undef HERE
}

LANE_INLINE void gather(const double *const *from, int offset, Lanes *v)
{
  for (int d = 0; d < 3; d++) v[d] = gather1(from, offset + d);
}

constexpr int X = 0, T = 3, LENGTH = 6, RADIUS = 7, BEFORE = 8, AFTER = 11, INVERSE = 14, END = 15, V = 16, DV = 19;

struct Pointers {
  const double *at[WIDTH];
  LANE_INLINE explicit Pointers(const Segment *const *segments)
  {
    for (int l = 0; l < WIDTH; l++) at[l] = segments[l]->x;
  }
};

// A's point at arc length s lies p0 + s m from B's axis, |p0 + s m|^2 = C + D^2 + 2 Q s + M s^2, beside B's point e + b s
struct Pair {
  Lanes p0[3], m[3], b, e, C, Q, M;
  LANE_INLINE Pair(const Lanes *w, const Lanes *At, const Lanes *Bt, Lanes D)
  {
    b = dot3(At, Bt);
    e = dot3(w, Bt);
    for (int d = 0; d < 3; d++) {
      p0[d] = w[d] - e * Bt[d];
      m[d] = At[d] - b * Bt[d];
    }
    C = dot3(p0, p0) - D * D;
    Q = dot3(p0, m);
    M = greater(dot3(m, m), every(1e-14));
  }
};

constexpr double SLIVER = 1e-9;    // of a segment: a shorter stretch is rounding

// the part of [lo, hi] where alpha + beta s >= 0; `edge`: whether a stretch that lies in the plane belongs to it
LANE_INLINE void cut(Lanes alpha, Lanes beta, Mask edge, Lanes &lo, Lanes &hi)
{
  const Lanes at = -alpha / beta;
  const Mask out = (beta == 0.0) & ((alpha < 0.0) | ((alpha == 0.0) & ~edge));
  lo = (beta > 0.0) & (at > lo) ? at : lo;
  hi = (beta < 0.0) & (at < hi) ? at : hi;
  hi = out ? every(-1.0) : hi;
}

LANE_INLINE unsigned meet_group(MeetLanes &all, int first)
{
  const Pointers A(all.A + first), B(all.B + first);
  Lanes Ax[3], At[3], Bx[3], Bt[3], before[3], after[3], w[3], end[3];
  gather(A.at, X, Ax);
  gather(A.at, T, At);
  gather(B.at, X, Bx);
  gather(B.at, T, Bt);
  gather(B.at, BEFORE, before);
  gather(B.at, AFTER, after);
  const Lanes Alength = gather1(A.at, LENGTH), Blength = gather1(B.at, LENGTH);
  for (int d = 0; d < 3; d++) {
    w[d] = Ax[d] - Bx[d];
    end[d] = w[d] - Blength * Bt[d];
  }
  // between B's end planes; most candidates end here, next to a neighbour's segment
  const Lanes behind = dot3(w, before), ahead = -dot3(end, after);
  const Lanes gain = dot3(At, before), loss = -dot3(At, after);
  const Mask beside = ((behind < 0.0) & (behind + gain * Alength < 0.0)) | ((ahead < 0.0) & (ahead + loss * Alength < 0.0));
  if (bits(~beside) == 0) return 0;

  const Lanes D = gather1(A.at, RADIUS) + gather1(B.at, RADIUS);
  const Pair pair(w, At, Bt, D);
  const Lanes C = pair.C, Q = pair.Q, M = pair.M;
  const Lanes root2 = Q * Q - M * C;
  const Lanes half = root(greater(root2, every(0.0))), q = -(Q >= 0.0 ? Q + half : Q - half);
  const Lanes s1 = q / M, s2 = C / q;
  Lanes lo = greater(every(0.0), lesser(s1, s2)), hi = lesser(Alength, greater(s1, s2));
  cut(behind, gain, Mask{} - 1, lo, hi);
  cut(ahead, loss, gather1(B.at, END) != 0.0, lo, hi);
  keep(all.lo + first, lo);
  keep(all.hi + first, hi);
  return bits(~beside & (root2 > 0.0) & (hi - lo > SLIVER * Alength));
}

// part of the line law in the force of a lens shorter than LONG_LENS: 0 short, 1 long, smooth
LANE_INLINE Lanes line_share(Lanes w_over_R)
{
  const Lanes t = (w_over_R - SHORT_LENS) * (1.0 / (LONG_LENS - SHORT_LENS));
  return w_over_R <= SHORT_LENS ? every(0.0) : t * t * (3.0 - 2.0 * t);
}

// Johnson's line law, see LineCurve
LANE_INLINE Lanes line_force(Lanes modulus, Lanes overlap, Lanes size, const LineCurve &curve)
{
  const Lanes y = overlap / size;
  const Mask inside = (y >= LineCurve::FIRST) & (y < 1.0);
  const Lanes known = inside ? y : every(0.5);
  const Mask cell = reinterpret_cast<Mask>(known) >> LineCurve::SHIFT;
  const Lanes t = known - reinterpret_cast<Lanes>(cell << LineCurve::SHIFT);
  const double *at[WIDTH];
  for (int l = 0; l < WIDTH; l++) at[l] = &curve.cells()[cell[l] - (long long) LineCurve::BASE].a;
  const Lanes a = gather1(at, 0), b = gather1(at, 1), c = gather1(at, 2), d = gather1(at, 3);
  Lanes phi = a + t * (b + t * (c + t * d));
  phi = y < LineCurve::FIRST ? y * curve.initial_slope() : phi;
  phi = y >= 1.0 ? curve.last() + curve.last_slope() * (y - 1.0) : phi;
  return overlap > 0.0 ? modulus * size * phi : every(0.0);
}

template <bool SPIN> LANE_INLINE void press_group(PressLanes &all, int first, const LineCurve &curve)
{
  const Pointers pA(all.A + first), pB(all.B + first);
  const double *const *A = pA.at, *const *B = pB.at;
  Lanes Ax[3], At[3], Bx[3], Bt[3], Av[3], Adv[3], Bv[3], Bdv[3], w[3];
  gather(A, X, Ax);
  gather(A, T, At);
  gather(B, X, Bx);
  gather(B, T, Bt);
  gather(A, V, Av);
  gather(A, DV, Adv);
  gather(B, V, Bv);
  gather(B, DV, Bdv);
  const Lanes Ainverse = gather1(A, INVERSE), Binverse = gather1(B, INVERSE);
  const Lanes Aradius = gather1(A, RADIUS), Bradius = gather1(B, RADIUS), D = Aradius + Bradius, size = 0.5 * D;
  const Lanes lo = load(all.lo + first), hi = load(all.hi + first);
  for (int d = 0; d < 3; d++) {
    w[d] = Ax[d] - Bx[d];
    Av[d] -= Bv[d];    // A's motion against B at their first beads
  }
  const Pair pair(w, At, Bt, D);
  const Lanes *p0 = pair.p0, *m = pair.m, b = pair.b, e = pair.e, C = pair.C, Q = pair.Q, M = pair.M;
  const Lanes half = 0.5 * (hi - lo), middle = 0.5 * (hi + lo), zero{};

  // crossing at an angle: Hertz' ellipse as a lens of linear springs, see crossing_law.h
  const Lanes modulus = load(all.modulus + first);
  const Lanes nearest = lesser(hi, greater(lo, -Q / M));
  const Lanes lens2 = -(C + nearest * (2.0 * Q + nearest * M));    // D^2 less the least distance squared
  const Lanes harmonic = 2.0 * Aradius * Bradius / D;
  const Mask crossing = (modulus > 0.0) & (lens2 > 0.0) & (lens2 < M * (LONG_LENS * LONG_LENS) * harmonic * harmonic);
  Lanes share = every(1.0), lens = zero;
  if (bits(crossing)) {
    const Lanes within = crossing ? lens2 : zero, across = crossing ? M : every(1.0);
    const Lanes ratio = root(within / across) / harmonic;    // half width of the whole lens
    share = crossing ? line_share(ratio) : share;
    // Hertz' force over the lens' area, with the powers of a vanishing overlap taken out of it
    const Lanes open = D + root(greater(zero, D * D - within));
    alignas(64) double shape[WIDTH];
    keep(shape, across * harmonic * harmonic / (Aradius * Bradius));
    shape_of_lanes(WIDTH, shape);
    lens = 0.75 * modulus * root(harmonic * across / (open * open * open)) * load(shape) *
        (D + root(D * D - 2.0 / 3.0 * within));
    lens = crossing ? lens : zero;
  }

  const Lanes damping = load(all.damping + first);
  Lanes sum = zero, stiffness = zero, at = zero, n[3] = {zero, zero, zero};
  Lanes onA[3] = {zero, zero, zero}, onB[3] = {zero, zero, zero};    // part of n on the second beads
  Lanes least = D;
  for (int g = 0; g < 2; g++) {
    const Lanes s = middle + (g ? GAUSS : -GAUSS) * half, along = e + b * s;
    Lanes way[3];
    for (int d = 0; d < 3; d++) way[d] = p0[d] + s * m[d];
    const Lanes distance = root(dot3(way, way));
    const Mask apart = distance > 1e-12 * D;
    const Lanes inverse = 1.0 / (apart ? distance : every(1.0));
    for (int d = 0; d < 3; d++) way[d] *= inverse;
    if (unsigned met = bits(~apart))
      for (int l = 0; l < WIDTH; l++)
        if (met >> l & 1) {
          double direction[3];
          across_of_lanes(all, first + l, direction);
          for (int d = 0; d < 3; d++) way[d][l] = direction[d];
        }
    const Lanes overlap = D - distance;
    least = lesser(least, distance);
    const Lanes xi = s * Ainverse, eta = along * Binverse;
    Lanes closing = zero;
    for (int d = 0; d < 3; d++) closing -= way[d] * (Av[d] + xi * Adv[d] - eta * Bdv[d]);
    Lanes elastic;
    if (all.line)
      elastic = line_force(modulus, overlap, size, curve);
    else {
      alignas(64) double depth[WIDTH], scale[WIDTH], law[WIDTH];
      keep(depth, overlap);
      keep(scale, size);
      law_of_lanes(all, g, first, WIDTH, depth, scale, law);
      elastic = load(law);
    }
    elastic = share * elastic + (1.0 - share) * lens * greater(zero, overlap);
    const Lanes f = half * greater(zero, elastic + damping * closing);
    stiffness += overlap > 0.0 ? half * elastic / overlap : zero;
    sum += f;
    at += f * s;
    for (int d = 0; d < 3; d++) {
      const Lanes F = f * way[d];
      n[d] += F;
      onA[d] += xi * F;
      onB[d] += eta * F;
    }
  }
  Lanes force[4][3];
  for (int d = 0; d < 3; d++) {
    force[0][d] = n[d] - onA[d];
    force[1][d] = onA[d];
    force[2][d] = onB[d] - n[d];
    force[3][d] = -onB[d];
  }
  const Lanes push = root(dot3(n, n));
  const Mask pressed = push > 0.0;
  {
    const Lanes unit = 1.0 / (pressed ? push : every(1.0));
    for (int d = 0; d < 3; d++) n[d] *= unit;
  }
  const Lanes s = at / (pressed ? sum : every(1.0)), along = e + b * s;
  const Lanes xi = s * Ainverse, eta = along * Binverse;

  // friction, from the axes to the point where the surfaces touch (or to B's axis), along the line between them: it takes
  // no angular momentum
  Lanes slide[3], armA[3], armB[3], turnA[3], turnB[3], rollA[3], rollB[3];
  const Lanes rA = all.on_second_axis ? every(-1.0) : -Aradius / D, rB = all.on_second_axis ? zero : Bradius / D;
  for (int d = 0; d < 3; d++) {
    const Lanes way = p0[d] + s * m[d];
    armA[d] = rA * way;
    armB[d] = rB * way;
    slide[d] = Av[d] + xi * Adv[d] - eta * Bdv[d];
  }
  if (SPIN) {
    Lanes one[3], two[3];
    gather(all.omega[0] + first, 0, one);
    gather(all.omega[1] + first, 0, two);
    for (int d = 0; d < 3; d++) turnA[d] = (1.0 - xi) * one[d] + xi * two[d];
    gather(all.omega[2] + first, 0, one);
    gather(all.omega[3] + first, 0, two);
    for (int d = 0; d < 3; d++) turnB[d] = (1.0 - eta) * one[d] + eta * two[d];
  } else {
    cross3(At, Adv, turnA);
    cross3(Bt, Bdv, turnB);
    for (int d = 0; d < 3; d++) {
      turnA[d] *= Ainverse;
      turnB[d] *= Binverse;
    }
  }
  cross3(turnA, armA, rollA);
  cross3(turnB, armB, rollB);
  for (int d = 0; d < 3; d++) slide[d] += rollA[d] - rollB[d];
  const Lanes normal_speed = dot3(slide, n);
  for (int d = 0; d < 3; d++) slide[d] -= normal_speed * n[d];

  // the spring, dashpot and slider of friction_spring.h
  double *const *h = all.history + first;
  Lanes u[3], friction[3];
  gather(h, 0, u);
  const Lanes tilt = dot3(u, n), before = dot3(u, u);
  for (int d = 0; d < 3; d++) u[d] -= tilt * n[d];
  const Lanes after = dot3(u, u);
  const Lanes turned = root(after > 0.0 ? before / after : every(1.0));
  const Lanes k = load(all.tangential + first) * stiffness, drag = load(all.sliding + first) * damping * (hi - lo);
  const Lanes limit = load(all.friction + first) * push, kinetic = load(all.kinetic + first) * push;
  const double moved = all.advance ? all.dt : 0.0;
  for (int d = 0; d < 3; d++) {
    u[d] = u[d] * turned + slide[d] * moved;
    friction[d] = -k * u[d] - drag * slide[d];
  }
  const Lanes size2 = dot3(friction, friction);
  const Mask slips = size2 > limit * limit;
  const Lanes shrink = slips ? kinetic / root(slips ? size2 : every(1.0)) : every(1.0);
  const Lanes give = k > 0.0 ? 1.0 / k : zero;
  for (int d = 0; d < 3; d++) {
    friction[d] = pressed ? friction[d] * shrink : zero;
    u[d] = slips ? -give * (friction[d] + drag * slide[d]) : u[d];
    u[d] = pressed ? u[d] : zero;
  }
  const Lanes slipping = pressed & slips ? every(1.0) : zero;
  if (all.advance)
    for (int l = 0; l < WIDTH; l++) {
      for (int d = 0; d < 3; d++) h[l][d] = u[d][l];
      h[l][3] = slipping[l];
    }

  Lanes coupleA[3], coupleB[3];
  cross3(armA, friction, coupleA);
  cross3(friction, armB, coupleB);    // - armB x T
  for (int d = 0; d < 3; d++) {
    force[0][d] += (1.0 - xi) * friction[d];
    force[1][d] += xi * friction[d];
    force[2][d] -= (1.0 - eta) * friction[d];
    force[3][d] -= eta * friction[d];
  }
  if (SPIN)
    for (int d = 0; d < 3; d++) {
      keep(all.torque[0][d] + first, (1.0 - xi) * coupleA[d]);
      keep(all.torque[1][d] + first, xi * coupleA[d]);
      keep(all.torque[2][d] + first, (1.0 - eta) * coupleB[d]);
      keep(all.torque[3][d] + first, eta * coupleB[d]);
    }
  else {
    // a chain takes the couple as a pair of forces across its segment; it has nothing that could turn about its axis
    Lanes pairA[3], pairB[3];
    cross3(coupleA, At, pairA);
    cross3(coupleB, Bt, pairB);
    for (int d = 0; d < 3; d++) {
      force[0][d] -= pairA[d] * Ainverse;
      force[1][d] += pairA[d] * Ainverse;
      force[2][d] -= pairB[d] * Binverse;
      force[3][d] += pairB[d] * Binverse;
    }
  }
  for (int bead = 0; bead < 4; bead++)
    for (int d = 0; d < 3; d++) keep(all.force[bead][d] + first, force[bead][d]);
  keep(all.normal + first, sum);
  keep(all.length + first, hi - lo);
  keep(all.distance + first, least);
  keep(all.cosine + first, size_of(b));
  keep(all.slips + first, slipping);
  for (int d = 0; d < 3; d++) {
    keep(all.friction_force[d] + first, friction[d]);
    keep(all.point[d] + first, Ax[d] + s * At[d] - Aradius / D * (p0[d] + s * m[d]));
  }
  if (all.energy) {
    // three points: the energy is of the fourth order where the force is of the second
    keep(all.share + first, share);
    keep(all.lens + first, lens);
    for (int g = 0; g < 3; g++) {
      const Lanes where = middle + (g - 1) * 0.77459666924148338 * half;
      keep(all.overlap[g] + first, D - root(greater(zero, C + D * D + where * (2.0 * Q + where * M))));
    }
  }
}

unsigned meet(MeetLanes &all)
{
  unsigned met = 0;
  for (int first = 0; first < LANES; first += WIDTH) met |= meet_group(all, first) << first;
  return met;
}

void press(PressLanes &all)
{
  const LineCurve &curve = LineCurve::get();
  for (int first = 0; first < LANES; first += WIDTH) press_group<false>(all, first, curve);
}

void press_spin(PressLanes &all)
{
  const LineCurve &curve = LineCurve::get();
  for (int first = 0; first < LANES; first += WIDTH) press_group<true>(all, first, curve);
}

}    // namespace

const LaneKernels KERNELS = {KERNEL_LANES, meet, press, press_spin};

}    // namespace cgfibre
