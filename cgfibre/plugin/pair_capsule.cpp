#include "pair_capsule.h"

#include "crossing_law.h"
#include "fix_segments.h"
#include "friction_spring.h"

#include "atom.h"
#include "comm.h"
#include "error.h"
#include "force.h"
#include "memory.h"
#include "modify.h"
#include "neighbor.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <cstring>

using namespace LAMMPS_NS;
using namespace cgfibre;

namespace {

constexpr double GAUSS = 0.57735026918962576;    // 1/sqrt(3)
constexpr double NONE_CLOSE = 1e20;
constexpr double SLIVER = 1e-9;    // of a segment: a shorter stretch is rounding

// a unit vector across both axes, for axes that meet: any will do
void across(const double *u, const double *v, double *n)
{
  cross(u, v, n);
  double size = std::sqrt(dot(n, n));
  if (size < 1e-9) {
    const double e[3] = {std::fabs(u[0]) < 0.8 ? 1.0 : 0.0, std::fabs(u[0]) < 0.8 ? 0.0 : 1.0, 0.0};
    cross(u, e, n);
    size = std::sqrt(dot(n, n));
  }
  for (int d = 0; d < 3; d++) n[d] /= size;
}

// the part of [lo, hi] where alpha + beta s >= 0; `edge`: whether a stretch that lies in the plane belongs to it
inline void keep(double alpha, double beta, bool edge, double &lo, double &hi)
{
  if (beta > 0.0)
    lo = std::max(lo, -alpha / beta);
  else if (beta < 0.0)
    hi = std::min(hi, -alpha / beta);
  else if (alpha < 0.0 || (alpha == 0.0 && !edge))
    hi = -1.0;
}

}    // namespace

PairCapsule::PairCapsule(LAMMPS *lmp) : Pair(lmp), reach(0.0), spin(false), two_sided(false), chain(nullptr), store(nullptr), stale(true), warned(false)
{
  single_enable = 1;
  restartinfo = 0;    // the deck gives pair_style and pair_coeff again after read_restart
  writedata = 0;
  one_coeff = 0;
  manybody_flag = 1;
  single_extra = 7;
  svector = new double[single_extra]();
  nextra = 3;
  pvector = new double[nextra]();    // touching pairs of segments, least distance of axes um, length of contact um
}

PairCapsule::~PairCapsule()
{
  if (store && modify->get_fix_by_id(store->id)) modify->delete_fix(store->id);
  delete[] pvector;
  delete[] svector;
  if (allocated) {
    memory->destroy(setflag);
    memory->destroy(cutsq);
  }
}

void PairCapsule::allocate()
{
  allocated = 1;
  const int n = atom->ntypes + 1;
  memory->create(setflag, n, n, "pair:setflag");
  memory->create(cutsq, n, n, "pair:cutsq");
  for (int i = 0; i < n; i++)
    for (int j = 0; j < n; j++) setflag[i][j] = 0;
  coefficients.assign((size_t) n * n, {});
  active.assign(n, 0);
}

// pair_style capsule REACH [spin yes|no] [sides one|both]
void PairCapsule::settings(int narg, char **arg)
{
  if (narg % 2 == 0) error->all(FLERR, "pair_style capsule takes the longest segment, um, spin yes|no and sides one|both");
  reach = utils::numeric(FLERR, arg[0], false, lmp);
  if (!(reach > 0.0)) error->all(FLERR, "pair_style capsule: longest segment {} um, expected above 0", reach);
  for (int iarg = 1; iarg < narg; iarg += 2) {
    const std::string word = arg[iarg], value = arg[iarg + 1];
    if (word == "spin")
      spin = utils::logical(FLERR, arg[iarg + 1], false, lmp) == 1;
    else if (word == "sides" && (value == "one" || value == "both"))
      two_sided = value == "both";
    else
      error->all(FLERR, "pair_style capsule: unknown words {} {}, expected spin yes|no, sides one|both", word, value);
  }
}

// pair_coeff I J none | LAW [damping GAMMA] [tangential KT_OVER_KN DAMPING_RATIO] [friction ...]
void PairCapsule::coeff(int narg, char **arg)
{
  if (narg < 3) error->all(FLERR, "pair_coeff of capsule takes two types and a law");
  if (!allocated) allocate();
  int ilo, ihi, jlo, jhi;
  utils::bounds(FLERR, arg[0], 1, atom->ntypes, ilo, ihi, error);
  utils::bounds(FLERR, arg[1], 1, atom->ntypes, jlo, jhi, error);
  int iarg = 2;
  Coefficients c;
  c.law = NormalLaw::parse(lmp, narg, arg, iarg);
  c.given = true;
  while (iarg < narg) {
    const std::string word = arg[iarg];
    if (word == "damping" && iarg + 1 < narg) {
      c.damping = utils::numeric(FLERR, arg[iarg + 1], false, lmp);
      iarg += 2;
    } else if (word == "tangential" && iarg + 2 < narg) {
      c.tangential = utils::numeric(FLERR, arg[iarg + 1], false, lmp);
      c.sliding = utils::numeric(FLERR, arg[iarg + 2], false, lmp);
      iarg += 3;
    } else if (word == "friction") {
      iarg++;
      c.friction = FrictionLaw::parse(lmp, narg, arg, iarg);
    } else {
      error->all(FLERR, "pair_coeff of capsule: {} is no keyword or lacks its values, expected damping, tangential, friction",
                 word);
    }
  }
  if (!(c.damping >= 0.0 && c.tangential > 0.0 && c.sliding >= 0.0))
    error->all(FLERR, "pair_coeff of capsule: damping and its ratio must not be negative, tangential be above 0");
  const int n = atom->ntypes + 1;
  bool any = false;
  for (int i = ilo; i <= ihi; i++)
    for (int j = std::max(jlo, i); j <= jhi; j++) {
      coefficients[(size_t) i * n + j] = coefficients[(size_t) j * n + i] = c;
      setflag[i][j] = 1;
      any = true;
    }
  if (!any) error->all(FLERR, "pair_coeff of capsule: no pair of types I <= J in {} {}", arg[0], arg[1]);
}

void PairCapsule::init_style()
{
  if (!atom->radius_flag) error->all(FLERR, "pair_style capsule needs the radius of every bead (atom_style sphere)");
  if (!force->newton_pair) error->all(FLERR, "pair_style capsule needs newton on for pairs");
  chain = FixSegments::of(lmp);
  // there must be a box first
  if (!store) store = FixHistory::create(lmp, "CGFIBRE_CAPSULE", HISTORY, this);
}

double PairCapsule::init_one(int i, int j)
{
  if (setflag[i][j] == 0)
    error->all(FLERR, "pair_style capsule: no pair_coeff of the types {} and {} (none switches a pair off)", i, j);
  const int n = atom->ntypes + 1;
  const auto touches = [&](int a, int b) { return coefficients[(size_t) a * n + b].law.kind() != NormalLaw::NONE; };
  for (int t = 1; t < n; t++) {
    active[t] = 0;
    for (int o = 1; o < n; o++) active[t] |= setflag[std::min(t, o)][std::max(t, o)] && touches(t, o);
  }
  double widest = 0.0;
  for (int k = 0; k < atom->nlocal; k++) widest = std::max(widest, atom->radius[k]);
  MPI_Allreduce(MPI_IN_PLACE, &widest, 1, MPI_DOUBLE, MPI_MAX, world);
  return 1.4142136 * reach + 2 * widest;    // of first beads of touching segments at right angles
}

// --- candidates, at every reneighbouring -----------------------------------------------------------------------------

void PairCapsule::find_pairs()
{
  const int nall = atom->nlocal + atom->nghost;
  double **x = atom->x, *radius = atom->radius;
  int *type = atom->type;
  const std::vector<int> &next = chain->next;
  near.clear();
  double longest = 0.0, widest = 0.0;
  std::vector<int> before(nall, -1);
  for (int i = 0; i < nall; i++) {
    const int j = next[i];
    if (j < 0) continue;
    before[j] = i;
    if (!active[type[i]] || !active[type[j]]) continue;
    SearchSegment s{i, (int) atom->molecule[i], i < atom->nlocal, {}, {}, radius[i]};
    double length2 = 0.0;
    for (int d = 0; d < 3; d++) {
      s.from[d] = x[i][d];
      s.to[d] = x[j][d];
      length2 += (x[j][d] - x[i][d]) * (x[j][d] - x[i][d]);
    }
    if (!std::isfinite(length2 + x[i][0] + x[i][1] + x[i][2])) continue;
    widest = std::max(widest, radius[i]);
    if (s.owned) longest = std::max(longest, std::sqrt(length2));
    else if (length2 > 4 * reach * reach) continue;    // the image next to a ghost is not here
    near.push_back(s);
  }
  double both[2] = {longest, widest};
  MPI_Allreduce(MPI_IN_PLACE, both, 2, MPI_DOUBLE, MPI_MAX, world);
  // other ranks' beads reach no further than was asked for; a single rank knows them all, until beads fly apart
  if (both[0] > (comm->nprocs > 1 ? 1.5 : 20.0) * reach)
    error->all(FLERR, "pair_style capsule: a segment of {:.6g} um touches, the style was told of {:.6g} um at most", both[0],
               reach);
  const double ghosts = 3 * reach + 2 * both[1] + neighbor->skin;
  if (!warned && comm->nprocs > 1 && comm->get_comm_cutoff() < ghosts) {
    if (comm->me == 0)
      error->warning(FLERR, "pair_style capsule: ghost cutoff {:.6g} um is below {:.6g} um: contacts may be missed at the "
                            "borders of ranks along the filaments (comm_modify cutoff)", comm->get_comm_cutoff(), ghosts);
    warned = true;
  }

  // rows of partners; segments that are in some pair get a place
  segments.clear();
  masters.clear();
  rows.assign(1, 0);
  partners.clear();
  history.clear();
  row_of.clear();
  std::vector<int> place(near.size(), -1);
  const auto placed = [&](int a) {
    if (place[a] < 0) {
      place[a] = (int) segments.size();
      const int i = near[a].bead, j = next[i];
      Segment s{};
      s.first = i;
      s.second = j;
      s.previous = before[i];
      s.following = next[j];
      s.radius = near[a].radius;
      segments.push_back(s);
    }
    return place[a];
  };
  int row = -1;
  search.pairs(near, neighbor->skin, two_sided, [&](int a, int b) {
    const int i = near[a].bead, j = near[b].bead;
    if (of_types(type[i], type[j]).law.kind() == NormalLaw::NONE) return;
    if (a != row) {
      if (row >= 0) rows.push_back((int) partners.size());
      row_of[atom->tag[i]] = (int) masters.size();
      masters.push_back(placed(a));
      row = a;
    }
    partners.push_back(placed(b));
    const double *kept = store->find(i, atom->tag[j]);
    for (int k = 0; k < HISTORY; k++) history.push_back(kept ? kept[k] : 0.0);
  });
  if (row >= 0) rows.push_back((int) partners.size());
  // segments next to one another, where both have a place
  std::vector<int> place_of(nall, -1);
  for (size_t k = 0; k < segments.size(); k++) place_of[segments[k].first] = (int) k;
  for (Segment &s : segments) {
    s.back = s.previous >= 0 ? place_of[s.previous] : -1;
    s.front = place_of[s.second];
  }
  stale = false;
}

void PairCapsule::restore(const FixHistory &)
{
  stale = true;    // with the next forces, when segments are known too
}

void PairCapsule::deposit(FixHistory &into)
{
  for (size_t m = 0; m < masters.size(); m++) {
    const int i = segments[masters[m]].first;
    for (int k = rows[m]; k < rows[m + 1]; k++) {
      const double *h = &history[(size_t) k * HISTORY];
      bool any = false;
      for (int n = 0; n < HISTORY; n++) any |= h[n] != 0.0;
      if (any) into.add(i, atom->tag[segments[partners[k]].first], h);
    }
  }
}

// --- one step --------------------------------------------------------------------------------------------------------

void PairCapsule::place_segments()
{
  double **x = atom->x, **v = atom->v;
  const auto direction = [&](int from, int to, double *t) {
    double size2 = 0.0;
    for (int d = 0; d < 3; d++) {
      t[d] = x[to][d] - x[from][d];
      size2 += t[d] * t[d];
    }
    const double size = std::sqrt(size2);
    if (size > 0.0)
      for (int d = 0; d < 3; d++) t[d] /= size;
    else
      t[0] = 1.0;
    return size;
  };
  for (Segment &s : segments) {
    s.length = direction(s.first, s.second, s.t);
    s.inverse = s.length > 0.0 ? 1.0 / s.length : 0.0;
    for (int d = 0; d < 3; d++) {
      s.x[d] = x[s.first][d];
      s.y[d] = x[s.second][d];
      s.v[d] = v[s.first][d];
      s.dv[d] = v[s.second][d] - v[s.first][d];
    }
  }
  // a neighbour that is in no pair has no place
  for (Segment &s : segments) {
    double there[3];
    const auto plane = [&](int place, int from, int to, double *normal) {
      const Segment *other = place >= 0 ? &segments[place] : nullptr;
      const bool found = other ? other->length > 0.0 : from >= 0 && to >= 0 && direction(from, to, there) > 0.0;
      const double *t = other ? other->t : there;
      for (int d = 0; d < 3; d++) normal[d] = found ? s.t[d] + t[d] : s.t[d];
    };
    plane(s.back, s.previous, s.first, s.before);
    plane(s.front, s.second, s.following, s.after);
  }
}

// Whether segment A (of the lower molecule, or either of the two) meets segment B, and where. The squared distance of A's point at arc length s from
// B's axis is a parabola in s, so the stretch in contact has closed limits.
inline bool PairCapsule::meet(const Segment &A, const Segment &B, Stretch &S)
{
  const double D = A.radius + B.radius;
  double w[3], end[3];
  for (int d = 0; d < 3; d++) {
    w[d] = A.x[d] - B.x[d];
    end[d] = A.x[d] - B.y[d];
  }
  // between B's end planes; most candidates end here, next to a neighbour's segment
  const double behind = dot(w, B.before), ahead = -dot(end, B.after);
  const double gain = dot(A.t, B.before), loss = -dot(A.t, B.after);
  if ((behind < 0.0 && behind + gain * A.length < 0.0) || (ahead < 0.0 && ahead + loss * A.length < 0.0)) return false;

  S.b = dot(A.t, B.t);
  S.e = dot(w, B.t);
  for (int d = 0; d < 3; d++) {
    S.p0[d] = w[d] - S.e * B.t[d];
    S.m[d] = A.t[d] - S.b * B.t[d];
  }
  S.C = dot(S.p0, S.p0) - D * D;
  S.Q = dot(S.p0, S.m);
  S.M = std::max(dot(S.m, S.m), 1e-14);
  const double root2 = S.Q * S.Q - S.M * S.C;
  if (!(root2 > 0.0)) return false;
  const double root = std::sqrt(root2);
  const double q = -(S.Q + (S.Q >= 0.0 ? root : -root));
  const double s1 = q / S.M, s2 = S.C / q;
  S.lo = std::max(0.0, std::min(s1, s2));
  S.hi = std::min(A.length, std::max(s1, s2));
  keep(behind, gain, true, S.lo, S.hi);
  keep(ahead, loss, B.following < 0, S.lo, S.hi);
  return S.hi - S.lo > SLIVER * A.length;
}

// The forces of a stretch in contact.
template <bool SPIN>
void PairCapsule::press(const Segment &A, const Segment &B, const Stretch &S, const Coefficients &c, double *h, bool advance,
                        bool energy, CapsuleContact &out, Load &load) const
{
  const double D = A.radius + B.radius, size = 0.5 * D;
  const double lo = S.lo, hi = S.hi, b = S.b, e = S.e, C = S.C, Q = S.Q, M = S.M;
  const double *p0 = S.p0, *m = S.m;
  const double half = 0.5 * (hi - lo), middle = 0.5 * (hi + lo);

  // crossing at an angle: Hertz' ellipse as a lens of linear springs, see crossing_law.h
  double share = 1.0, lens_stiffness = 0.0;
  const double nearest = std::min(hi, std::max(lo, -Q / M));
  const double lens2 = -(C + nearest * (2 * Q + nearest * M));    // D^2 less the least distance squared
  const double harmonic = 2 * A.radius * B.radius / D;
  if (c.law.kind() == NormalLaw::LINE && lens2 > 0.0 && lens2 < M * LONG_LENS * LONG_LENS * harmonic * harmonic) {
    share = line_share(std::sqrt(lens2 / M) / harmonic);    // by the half width of the whole lens
    // Hertz' force over the lens' area, with the powers of a vanishing overlap taken out of it
    const double open = D + std::sqrt(std::max(0.0, D * D - lens2));
    lens_stiffness = 0.75 * c.law.modulus() * std::sqrt(harmonic * M / (open * open * open)) *
        hertz_shape(M * harmonic * harmonic / (A.radius * B.radius)) * (D + std::sqrt(D * D - 2.0 / 3.0 * lens2));
  }

  double sum = 0.0, stiffness = 0.0, at = 0.0, n[3] = {0.0, 0.0, 0.0};
  double onA[3] = {0.0, 0.0, 0.0}, onB[3] = {0.0, 0.0, 0.0};    // part of n on the second beads
  double least = D;
  for (int g = 0; g < 2; g++) {
    const double s = middle + (g ? GAUSS : -GAUSS) * half, along = e + b * s;
    double way[3], distance2 = 0.0;
    for (int d = 0; d < 3; d++) {
      way[d] = p0[d] + s * m[d];
      distance2 += way[d] * way[d];
    }
    const double distance = std::sqrt(distance2);
    if (distance > 1e-12 * D) {
      const double inverse = 1.0 / distance;
      for (int d = 0; d < 3; d++) way[d] *= inverse;
    } else
      across(A.t, B.t, way);
    const double overlap = D - distance;
    least = std::min(least, distance);
    const double xi = s * A.inverse, eta = along * B.inverse;
    double closing = 0.0;
    for (int d = 0; d < 3; d++) closing -= way[d] * (A.v[d] + xi * A.dv[d] - B.v[d] - eta * B.dv[d]);
    double elastic;
    if (c.law.has_history()) {
      double deep = h[4 + g];
      elastic = c.law.force(overlap, size, deep);
      if (advance) h[4 + g] = deep;
    } else
      elastic = share * c.law.force(overlap, size) + (1.0 - share) * lens_stiffness * std::max(0.0, overlap);
    const double f = half * std::max(0.0, elastic + c.damping * closing);
    if (overlap > 0.0) stiffness += half * elastic / overlap;
    sum += f;
    at += f * s;
    for (int d = 0; d < 3; d++) {
      const double F = f * way[d];
      n[d] += F;
      onA[d] += xi * F;
      onB[d] += eta * F;
    }
  }

  for (int d = 0; d < 3; d++) {
    load.force[0][d] = n[d] - onA[d];
    load.force[1][d] = onA[d];
    load.force[2][d] = onB[d] - n[d];
    load.force[3][d] = -onB[d];
  }
  if (SPIN) memset(load.torque, 0, sizeof load.torque);
  out.normal = sum;
  out.length = hi - lo;
  out.distance = least;
  out.cosine = std::fabs(b);
  out.energy = 0.0;
  for (int d = 0; d < 3; d++) out.friction[d] = 0.0;
  const double push = std::sqrt(dot(n, n));
  if (push > 0.0) {
    const double unit = 1.0 / push;
    for (int d = 0; d < 3; d++) n[d] *= unit;
    const double s = at / sum, along = e + b * s;
    const double xi = s * A.inverse, eta = along * B.inverse;
    // from the axes to the point where the surfaces touch, along the line between them: it takes no angular momentum
    const double rA = -A.radius / D, rB = B.radius / D;
    double slide[3], armA[3], armB[3], turnA[3], turnB[3];
    for (int d = 0; d < 3; d++) {
      const double way = p0[d] + s * m[d];
      armA[d] = rA * way;
      armB[d] = rB * way;
      slide[d] = A.v[d] + xi * A.dv[d] - B.v[d] - eta * B.dv[d];
    }
    if (SPIN) {
      double **omega = atom->omega;
      for (int d = 0; d < 3; d++) {
        turnA[d] = (1.0 - xi) * omega[A.first][d] + xi * omega[A.second][d];
        turnB[d] = (1.0 - eta) * omega[B.first][d] + eta * omega[B.second][d];
      }
    } else {
      cross(A.t, A.dv, turnA);
      cross(B.t, B.dv, turnB);
      for (int d = 0; d < 3; d++) {
        turnA[d] *= A.inverse;
        turnB[d] *= B.inverse;
      }
    }
    double rollA[3], rollB[3];
    cross(turnA, armA, rollA);
    cross(turnB, armB, rollB);
    double normal_speed = 0.0;
    for (int d = 0; d < 3; d++) {
      slide[d] += rollA[d] - rollB[d];
      normal_speed += slide[d] * n[d];
    }
    for (int d = 0; d < 3; d++) slide[d] -= normal_speed * n[d];

    const FrictionSpring spring{c.tangential * stiffness, c.sliding * c.damping * out.length,
                                c.friction.limit(out.cosine, h[3] != 0.0) * push,
                                c.friction.limit(out.cosine, true) * push};
    double T[3];
    out.slipping = pull(spring, n, slide, update->dt, h, advance, T);

    double coupleA[3], coupleB[3];
    cross(armA, T, coupleA);
    cross(T, armB, coupleB);    // - armB x T
    for (int d = 0; d < 3; d++) {
      out.friction[d] = T[d];
      load.force[0][d] += (1.0 - xi) * T[d];
      load.force[1][d] += xi * T[d];
      load.force[2][d] -= (1.0 - eta) * T[d];
      load.force[3][d] -= eta * T[d];
      out.point[d] = A.x[d] + s * A.t[d] + armA[d];
    }
    if (SPIN)
      for (int d = 0; d < 3; d++) {
        load.torque[0][d] = (1.0 - xi) * coupleA[d];
        load.torque[1][d] = xi * coupleA[d];
        load.torque[2][d] = (1.0 - eta) * coupleB[d];
        load.torque[3][d] = eta * coupleB[d];
      }
    else {
      // a chain takes the couple as a pair of forces across its segment; it has nothing that could turn about its axis
      double pairA[3], pairB[3];
      cross(coupleA, A.t, pairA);
      cross(coupleB, B.t, pairB);
      for (int d = 0; d < 3; d++) {
        load.force[0][d] -= pairA[d] * A.inverse;
        load.force[1][d] += pairA[d] * A.inverse;
        load.force[2][d] -= pairB[d] * B.inverse;
        load.force[3][d] += pairB[d] * B.inverse;
      }
    }
  } else if (advance)
    h[0] = h[1] = h[2] = h[3] = 0.0;

  if (energy) {
    // three points: the energy is of the fourth order where the force is of the second
    constexpr double OUTER = 0.77459666924148338;
    const double shift[3] = {-OUTER, 0.0, OUTER}, weight[3] = {5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0};
    for (int g = 0; g < 3; g++) {
      const double s = middle + shift[g] * half;
      const double overlap = D - std::sqrt(std::max(0.0, C + D * D + s * (2 * Q + s * M)));
      if (overlap > 0.0)
        out.energy += half * weight[g] *
            (share * c.law.energy(overlap, size) + (1.0 - share) * 0.5 * lens_stiffness * overlap * overlap);
    }
  }
  if (two_sided) {    // the other half comes from the other side
    for (int n = 0; n < 4; n++)
      for (int d = 0; d < 3; d++) {
        load.force[n][d] *= 0.5;
        if (SPIN) load.torque[n][d] *= 0.5;
      }
    for (int d = 0; d < 3; d++) out.friction[d] *= 0.5;
    out.normal *= 0.5;
    out.length *= 0.5;
    out.energy *= 0.5;
  }
  for (int d = 0; d < 3; d++) out.force[d] = load.force[0][d] + load.force[1][d];
}

// A stretch that begins on the next segment of a filament goes on with the spring of the stretch before it: what has slid
// along the one has slid along the other. A filament that crosses at a right angle changes segments at once.
bool PairCapsule::inherit(size_t m, int k)
{
  const Segment &B = segments[partners[k]];
  double *h = &history[(size_t) k * HISTORY];
  const auto next_to = [&](int other) {
    const Segment &O = segments[other];
    return O.second == B.first || O.first == B.second;
  };
  for (const Ended &one : lost)
    if (next_to(one.segment)) {
      std::copy(one.history, one.history + HISTORY, h);
      return true;
    }
  for (int j = rows[m]; j < rows[m + 1]; j++) {
    const double *theirs = &history[(size_t) j * HISTORY];
    if (j == k || (theirs[0] == 0.0 && theirs[1] == 0.0 && theirs[2] == 0.0) || !next_to(partners[j])) continue;
    std::copy(theirs, theirs + HISTORY, h);
    return true;
  }
  return false;
}

template <bool SPIN> void PairCapsule::add_forces()
{
  double **f = atom->f, **torque = atom->torque;
  int *type = atom->type;
  const bool advance = !update->setupflag, energy = eflag_either;
  double touching = 0.0, length = 0.0, closest = NONE_CLOSE;
  CapsuleContact contact;
  Stretch stretch;
  Load load;
  for (size_t m = 0; m < masters.size(); m++) {
    const Segment &A = segments[masters[m]];
    lost.clear();
    for (int k = rows[m]; k < rows[m + 1]; k++) {
      const Segment &B = segments[partners[k]];
      double *h = &history[(size_t) k * HISTORY];
      const bool fresh = h[0] == 0.0 && h[1] == 0.0 && h[2] == 0.0;
      if (!meet(A, B, stretch)) {
        if (advance && !fresh) {
          lost.push_back({partners[k], {}});
          std::copy(h, h + HISTORY, lost.back().history);
          std::fill(h, h + 4, 0.0);
        }
        continue;
      }
      const Coefficients &c = of_types(type[A.first], type[B.first]);
      press<SPIN>(A, B, stretch, c, h, advance, energy, contact, load);
      if (advance && fresh && contact.normal > 0.0 && inherit(m, k))
        press<SPIN>(A, B, stretch, c, h, advance, energy, contact, load);
      const int beads[4] = {A.first, A.second, B.first, B.second};
      for (int n = 0; n < 4; n++) {
        double *F = f[beads[n]];
        for (int d = 0; d < 3; d++) F[d] += load.force[n][d];
        if (SPIN)
          for (int d = 0; d < 3; d++) torque[beads[n]][d] += load.torque[n][d];
      }
      if (evflag) {
        touching += two_sided ? 0.5 : 1.0;
        length += contact.length;
        closest = std::min(closest, contact.distance);
        tally(A, B, contact, load);
      }
    }
  }
  if (eflag_global) {
    // compute pair adds up over ranks: a least value is shared out
    MPI_Allreduce(MPI_IN_PLACE, &closest, 1, MPI_DOUBLE, MPI_MIN, world);
    pvector[0] = touching;
    pvector[1] = closest / comm->nprocs;
    pvector[2] = length;
  }
}

void PairCapsule::tally(const Segment &A, const Segment &B, const CapsuleContact &contact, const Load &load)
{
  if (eflag_global) eng_vdwl += contact.energy;
  const int beads[4] = {A.first, A.second, B.first, B.second};
  if (eflag_atom)
    for (const int k : beads) eatom[k] += 0.25 * contact.energy;
  if (!vflag_atom && !(vflag_global && !vflag_fdotr)) return;
  // the four forces add up to nothing, so any origin will do
  double v[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  for (int n = 0; n < 4; n++) {
    const double *x = atom->x[beads[n]], *F = load.force[n];
    double r[3];
    for (int d = 0; d < 3; d++) r[d] = x[d] - A.x[d];
    v[0] += r[0] * F[0];
    v[1] += r[1] * F[1];
    v[2] += r[2] * F[2];
    v[3] += r[0] * F[1];
    v[4] += r[0] * F[2];
    v[5] += r[1] * F[2];
  }
  for (int n = 0; n < 6; n++) {
    if (vflag_global && !vflag_fdotr) virial[n] += v[n];
    if (vflag_atom)
      for (const int k : beads) vatom[k][n] += 0.25 * v[n];
  }
}

void PairCapsule::compute(int eflag, int vflag)
{
  ev_init(eflag, vflag);
  if (stale) find_pairs();
  place_segments();
  if (spin)
    add_forces<true>();
  else
    add_forces<false>();
  store->changed();
  if (vflag_fdotr) virial_fdotr_compute();
}

// For compute pair/local: beads stand for the segments that begin at them. p1 normal force, p2-p4 friction on the filament
// of the lower molecule, nN; p5 length of contact, p6 least distance of the axes, um; p7 angle between them, degrees.
double PairCapsule::single(int i, int j, int, int, double, double, double, double &fforce)
{
  if (comm->nprocs > 1)
    error->all(FLERR, "pair_style capsule: compute pair/local misses contacts of other ranks, use compute capsule/local");
  fforce = 0.0;
  for (int k = 0; k < single_extra; k++) svector[k] = 0.0;
  int a = atom->molecule[i] < atom->molecule[j] ? i : j, b = a == i ? j : i;
  double energy = 0.0;
  for (int side = 0; side < (two_sided ? 2 : 1); side++, std::swap(a, b)) {
    const auto row = row_of.find(atom->tag[a]);
    if (row == row_of.end()) continue;
    CapsuleContact contact;
    for (int k = rows[row->second]; k < rows[row->second + 1]; k++) {
      if (atom->tag[segments[partners[k]].first] != atom->tag[b]) continue;
      if (!look(row->second, k, contact)) break;
      fforce = svector[0] += contact.normal;
      for (int d = 0; d < 3; d++) svector[1 + d] += side ? -contact.friction[d] : contact.friction[d];
      svector[4] += contact.length;
      svector[5] = svector[5] > 0.0 ? std::min(svector[5], contact.distance) : contact.distance;
      svector[6] = contact.angle();
      energy += contact.energy;
      break;
    }
  }
  return energy;
}

// the contact as it stands, history untouched
bool PairCapsule::look(int m, int k, CapsuleContact &contact)
{
  const Segment &one = segments[masters[m]], &other = segments[partners[k]];
  double kept[HISTORY];
  std::copy(&history[(size_t) k * HISTORY], &history[(size_t) (k + 1) * HISTORY], kept);
  Stretch stretch;
  Load load;
  if (!meet(one, other, stretch)) return false;
  const Coefficients &c = of_types(atom->type[one.first], atom->type[other.first]);
  if (spin)
    press<true>(one, other, stretch, c, kept, false, true, contact, load);
  else
    press<false>(one, other, stretch, c, kept, false, true, contact, load);
  return true;
}

double PairCapsule::memory_usage()
{
  return (double) segments.capacity() * sizeof(Segment) + (double) history.capacity() * sizeof(double) +
      (double) (partners.capacity() + rows.capacity() + masters.capacity()) * sizeof(int) +
      (double) near.capacity() * sizeof(SearchSegment);
}
