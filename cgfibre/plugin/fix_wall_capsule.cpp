#include "fix_wall_capsule.h"

#include "fix_segments.h"
#include "friction_spring.h"

#include "atom.h"
#include "comm.h"
#include "error.h"
#include "force.h"
#include "group.h"
#include "input.h"
#include "memory.h"
#include "update.h"
#include "utils.h"
#include "variable.h"

#include <algorithm>
#include <cmath>
#include <cstring>

using namespace LAMMPS_NS;
using namespace cgfibre;

namespace {

constexpr int STRETCHES = 2;
constexpr int HISTORY = 6;    // a stretch: friction spring (3), whether it slips, deepest overlap at the two points
constexpr int KEPT = STRETCHES * HISTORY;
constexpr double GAUSS = 0.57735026918962576;    // 1/sqrt(3)

int axis_of(const char *word, Error *error)
{
  if (strlen(word) == 1 && word[0] >= 'x' && word[0] <= 'z') return word[0] - 'x';
  error->all(FLERR, "fix wall/capsule: {} is no axis, expected x, y or z", word);
  return 0;
}

}    // namespace

// fix ID GROUP wall/capsule plane AXIS AT above|below LAW [keywords]
// fix ID GROUP wall/capsule cylinder AXIS C1 C2 RADIUS outside|inside LAW [keywords]
//   above, below, outside, inside: where the filaments are
// keywords: damping GAMMA, tangential KT_OVER_KN RATIO, friction ..., move AXIS v_NAME, span AXIS LO HI, spin yes|no
FixWallCapsule::FixWallCapsule(LAMMPS *lmp, int narg, char **arg) :
    Fix(lmp, narg, arg), shape(PLANE), axis(2), place{0.0, 0.0, 0.0}, side(1.0), cylinder(0.0), move_axis(-1),
    move_variable(-1), span_axis(-1), span_lo(0.0), span_hi(0.0), damping(0.0), tangential(0.8), sliding(0.3), spin(false),
    chain(nullptr), history(nullptr), shift(0.0), speed(0.0), summed(false)
{
  parse(narg, arg);
  scalar_flag = vector_flag = 1;
  size_vector = 7;
  extscalar = extvector = 1;
  global_freq = 1;
  restart_peratom = 1;
  FixWallCapsule::grow_arrays(atom->nmax);
  for (int i = 0; i < atom->nmax; i++) FixWallCapsule::set_arrays(i);
  atom->add_callback(Atom::GROW);
  atom->add_callback(Atom::RESTART);
  for (int k = 0; k < 7; k++) total[k] = sum[k] = 0.0;
}

FixWallCapsule::~FixWallCapsule()
{
  atom->delete_callback(id, Atom::GROW);
  atom->delete_callback(id, Atom::RESTART);
  memory->destroy(history);
}

void FixWallCapsule::parse(int narg, char **arg)
{
  const auto number = [&](int k) { return utils::numeric(FLERR, arg[k], false, lmp); };
  const auto edge = [&](int k, double open) { return strcmp(arg[k], "INF") == 0 ? open : number(k); };
  if (narg < 7) utils::missing_cmd_args(FLERR, "fix wall/capsule", error);
  int iarg;
  const std::string kind = arg[3];
  axis = axis_of(arg[4], error);
  std::string where;
  if (kind == "plane") {
    place[axis] = number(5);
    where = arg[6];
    if (where != "above" && where != "below")
      error->all(FLERR, "fix wall/capsule: {}, expected above or below (where the filaments are)", where);
    side = where == "above" ? 1.0 : -1.0;
    iarg = 7;
  } else if (kind == "cylinder") {
    if (narg < 9) utils::missing_cmd_args(FLERR, "fix wall/capsule cylinder", error);
    shape = CYLINDER;
    place[axis == 0 ? 1 : 0] = number(5);
    place[axis == 2 ? 1 : 2] = number(6);
    cylinder = number(7);
    if (!(cylinder > 0.0)) error->all(FLERR, "fix wall/capsule: radius {} um, expected above 0", cylinder);
    where = arg[8];
    if (where != "outside" && where != "inside")
      error->all(FLERR, "fix wall/capsule: {}, expected outside or inside (where the filaments are)", where);
    side = where == "outside" ? 1.0 : -1.0;
    iarg = 9;
  } else {
    error->all(FLERR, "fix wall/capsule: {}, expected plane or cylinder", kind);
    return;
  }
  law = NormalLaw::parse(lmp, narg, arg, iarg);
  while (iarg < narg) {
    const std::string word = arg[iarg];
    const int left = narg - iarg - 1;
    if (word == "damping" && left >= 1) {
      damping = number(iarg + 1);
      iarg += 2;
    } else if (word == "tangential" && left >= 2) {
      tangential = number(iarg + 1);
      sliding = number(iarg + 2);
      iarg += 3;
    } else if (word == "friction") {
      iarg++;
      friction = FrictionLaw::parse(lmp, narg, arg, iarg);
    } else if (word == "move" && left >= 2) {
      move_axis = axis_of(arg[iarg + 1], error);
      move_name = arg[iarg + 2];
      if (move_name.compare(0, 2, "v_") != 0)
        error->all(FLERR, "fix wall/capsule: move {} {}, expected an equal-style variable, v_NAME", arg[iarg + 1], move_name);
      move_name = move_name.substr(2);
      iarg += 3;
    } else if (word == "span" && left >= 3) {
      span_axis = axis_of(arg[iarg + 1], error);
      span_lo = edge(iarg + 2, -1e300);
      span_hi = edge(iarg + 3, 1e300);
      if (!(span_lo < span_hi))
        error->all(FLERR, "fix wall/capsule: span {} {}, expected a lower and a higher edge", arg[iarg + 2], arg[iarg + 3]);
      iarg += 4;
    } else if (word == "spin" && left >= 1) {
      spin = utils::logical(FLERR, arg[iarg + 1], false, lmp) == 1;
      iarg += 2;
    } else {
      error->all(FLERR,
                 "fix wall/capsule: {} is no keyword or lacks its values, expected damping, tangential, friction, move, span, spin",
                 word);
    }
  }
  if (!(damping >= 0.0 && tangential > 0.0 && sliding >= 0.0))
    error->all(FLERR, "fix wall/capsule: damping and its ratio must not be negative, tangential be above 0");
}

int FixWallCapsule::setmask()
{
  // before forces on ghosts go home: a segment's second bead may be one
  return FixConst::PRE_REVERSE;
}

void FixWallCapsule::init()
{
  if (!atom->radius_flag) error->all(FLERR, "fix wall/capsule needs the radius of every bead (atom_style sphere)");
  if (!force->newton) error->all(FLERR, "fix wall/capsule needs newton on");
  chain = FixSegments::of(lmp);
  if (move_axis >= 0) {
    move_variable = input->variable->find(move_name.c_str());
    if (move_variable < 0 || !input->variable->equalstyle(move_variable))
      error->all(FLERR, "fix wall/capsule: move v_{}, expected an equal-style variable of that name", move_name);
  }
}

void FixWallCapsule::setup_pre_reverse(int, int)
{
  if (move_axis >= 0) shift = input->variable->compute_equal(move_variable);
  speed = 0.0;
  press(false);
}

void FixWallCapsule::pre_reverse(int, int)
{
  if (move_axis >= 0) {
    const double now = input->variable->compute_equal(move_variable);
    speed = (now - shift) / update->dt;
    shift = now;
  }
  press(true);
}

void FixWallCapsule::press(bool advance)
{
  double **x = atom->x, **v = atom->v;
  const std::vector<int> &next = chain->next;
  for (double &t : total) t = 0.0;
  total[5] = 1e20;
  summed = false;
  const double at = place[axis] + (move_axis == axis ? shift : 0.0);
  for (int i = 0; i < atom->nlocal; i++) {
    const int j = next[i];
    if (j < 0 || !(atom->mask[i] & groupbit) || !(atom->mask[j] & groupbit)) continue;
    const double radius = atom->radius[i];
    if (shape == PLANE && side * (x[i][axis] - at) > radius && side * (x[j][axis] - at) > radius) {
      if (history[i][0] != 0.0 || history[i][1] != 0.0 || history[i][2] != 0.0)
        std::fill(history[i], history[i] + 4, 0.0);
      continue;
    }
    Filament s;
    s.first = i;
    s.second = j;
    s.radius = radius;
    double size2 = 0.0;
    for (int d = 0; d < 3; d++) {
      s.x[d] = x[i][d];
      s.t[d] = x[j][d] - x[i][d];
      size2 += s.t[d] * s.t[d];
      s.v[d] = v[i][d];
      s.dv[d] = v[j][d] - v[i][d];
    }
    s.length = std::sqrt(size2);
    if (!(s.length > 0.0)) continue;
    for (int d = 0; d < 3; d++) s.t[d] /= s.length;
    Stretch found[STRETCHES];
    const int n = stretches(s, found);
    for (int k = 0; k < n; k++) push(s, found[k], &history[i][k * HISTORY], advance);
    for (int k = n; k < STRETCHES; k++) std::fill(&history[i][k * HISTORY], &history[i][k * HISTORY] + 4, 0.0);
  }
}

// the stretches of arc length in which the segment touches the wall, within its edges
int FixWallCapsule::stretches(const Filament &s, Stretch *found) const
{
  double p[3];
  for (int d = 0; d < 3; d++) p[d] = s.x[d] - place[d] - (d == move_axis ? shift : 0.0);
  Stretch all[STRETCHES];
  int n = 0;
  if (shape == PLANE) {
    // gap side (p + s t) - radius, a straight line
    const double gap = side * p[axis] - s.radius, slope = side * s.t[axis];
    double lo = 0.0, hi = s.length;
    if (slope > 0.0)
      hi = std::min(hi, -gap / slope);
    else if (slope < 0.0)
      lo = std::max(lo, -gap / slope);
    else if (gap >= 0.0)
      return 0;
    all[n++] = {lo, hi};
  } else {
    double a = 0.0, b = 0.0, c = 0.0;    // squared distance from the axis c + 2 b s + a s^2
    for (int d = 0; d < 3; d++) {
      if (d == axis) continue;
      a += s.t[d] * s.t[d];
      b += p[d] * s.t[d];
      c += p[d] * p[d];
    }
    a = std::max(a, 1e-14);
    const double touch = cylinder + side * s.radius;
    const double root2 = b * b - a * (c - touch * touch);
    if (side > 0.0) {
      if (!(root2 > 0.0)) return 0;
      const double root = std::sqrt(root2);
      all[n++] = {(-b - root) / a, (-b + root) / a};
    } else if (touch <= 0.0 || root2 <= 0.0) {
      all[n++] = {0.0, s.length};
    } else {
      const double root = std::sqrt(root2);
      all[n++] = {0.0, (-b - root) / a};
      all[n++] = {(-b + root) / a, s.length};
    }
  }
  int kept = 0;
  for (int k = 0; k < n; k++) {
    double lo = std::max(0.0, all[k].lo), hi = std::min(s.length, all[k].hi);
    if (span_axis >= 0) {
      const double x = s.x[span_axis], t = s.t[span_axis];
      if (t != 0.0) {
        const double one = (span_lo - x) / t, other = (span_hi - x) / t;
        lo = std::max(lo, std::min(one, other));
        hi = std::min(hi, std::max(one, other));
      } else if (x < span_lo || x > span_hi)
        continue;
    }
    if (lo < hi) found[kept++] = {lo, hi};
  }
  return kept;
}

// distance of an axis point from the wall's surface, and the direction that leads away from the wall
void FixWallCapsule::normal_at(const double *point, double &distance, double *n) const
{
  double p[3];
  for (int d = 0; d < 3; d++) {
    p[d] = point[d] - place[d] - (d == move_axis ? shift : 0.0);
    n[d] = 0.0;
  }
  if (shape == PLANE) {
    distance = side * p[axis];
    n[axis] = side;
    return;
  }
  double r2 = 0.0;
  for (int d = 0; d < 3; d++)
    if (d != axis) r2 += p[d] * p[d];
  const double r = std::sqrt(r2);
  distance = side * (r - cylinder);
  if (r > 0.0)
    for (int d = 0; d < 3; d++) n[d] = d == axis ? 0.0 : side * p[d] / r;
  else
    n[axis == 2 ? 0 : 2] = 1.0;
}

void FixWallCapsule::push(const Filament &s, const Stretch &stretch, double *h, bool advance)
{
  const double half = 0.5 * (stretch.hi - stretch.lo), middle = 0.5 * (stretch.hi + stretch.lo);
  const double size = 0.5 * s.radius;    // of the line law on a rigid plane
  double **f = atom->f;
  double sum = 0.0, at = 0.0, stiffness = 0.0, n[3] = {0.0, 0.0, 0.0}, point[3], way[3];
  double wall[3] = {0.0, 0.0, 0.0}, F1[3] = {0.0, 0.0, 0.0}, F2[3] = {0.0, 0.0, 0.0};
  if (move_axis >= 0) wall[move_axis] = speed;
  for (int g = 0; g < 2; g++) {
    const double a = middle + (g ? GAUSS : -GAUSS) * half, xi = a / s.length;
    for (int d = 0; d < 3; d++) point[d] = s.x[d] + a * s.t[d];
    double distance;
    normal_at(point, distance, way);
    const double overlap = s.radius - distance;
    total[5] = std::min(total[5], distance);
    double closing = 0.0;
    for (int d = 0; d < 3; d++) closing -= way[d] * (s.v[d] + xi * s.dv[d] - wall[d]);
    double elastic;
    if (law.has_history()) {
      double deep = h[4 + g];
      elastic = law.force(overlap, size, deep);
      if (advance) h[4 + g] = deep;
    } else
      elastic = law.force(overlap, size);
    const double push = half * std::max(0.0, elastic + damping * closing);
    if (overlap > 0.0) {
      stiffness += half * elastic / overlap;
      total[4] += half * law.energy(overlap, size);
    }
    sum += push;
    at += push * a;
    for (int d = 0; d < 3; d++) {
      n[d] += push * way[d];
      F1[d] += (1.0 - xi) * push * way[d];
      F2[d] += xi * push * way[d];
    }
  }
  total[3] += 2 * half;
  total[6] += 1.0;
  const double size_n = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
  if (size_n > 0.0) {
    for (int d = 0; d < 3; d++) n[d] /= size_n;
    const double a = at / sum, xi = a / s.length;
    for (int d = 0; d < 3; d++) point[d] = s.x[d] + a * s.t[d];
    double distance;
    normal_at(point, distance, way);
    double arm[3], turn[3], slide[3], couple[3];
    for (int d = 0; d < 3; d++) arm[d] = -distance * n[d];
    if (spin)
      for (int d = 0; d < 3; d++) turn[d] = (1.0 - xi) * atom->omega[s.first][d] + xi * atom->omega[s.second][d];
    else {
      cross(s.t, s.dv, turn);
      for (int d = 0; d < 3; d++) turn[d] /= s.length;
    }
    double roll[3], into = 0.0;
    cross(turn, arm, roll);
    for (int d = 0; d < 3; d++) {
      slide[d] = s.v[d] + xi * s.dv[d] - wall[d] + roll[d];
      into += slide[d] * n[d];
    }
    for (int d = 0; d < 3; d++) slide[d] -= into * n[d];
    const FrictionSpring spring{tangential * stiffness, sliding * damping * 2 * half,
                                friction.limit(1.0, h[3] != 0.0) * size_n, friction.limit(1.0, true) * size_n};
    double T[3];
    pull(spring, n, slide, update->dt, h, advance, T);
    cross(arm, T, couple);
    double pair[3];
    cross(couple, s.t, pair);
    for (int d = 0; d < 3; d++) {
      F1[d] += (1.0 - xi) * T[d];
      F2[d] += xi * T[d];
      if (spin) {
        atom->torque[s.first][d] += (1.0 - xi) * couple[d];
        atom->torque[s.second][d] += xi * couple[d];
      } else {
        // a chain takes the couple as a pair of forces across its segment
        F1[d] -= pair[d] / s.length;
        F2[d] += pair[d] / s.length;
      }
    }
  } else if (advance)
    std::fill(h, h + 4, 0.0);
  for (int d = 0; d < 3; d++) {
    f[s.first][d] += F1[d];
    f[s.second][d] += F2[d];
    total[d] += F1[d] + F2[d];
  }
}

void FixWallCapsule::gather()
{
  if (summed) return;
  MPI_Allreduce(total, sum, 7, MPI_DOUBLE, MPI_SUM, world);
  MPI_Allreduce(&total[5], &sum[5], 1, MPI_DOUBLE, MPI_MIN, world);
  summed = true;
}

// energy of the contacts, nN um
double FixWallCapsule::compute_scalar()
{
  gather();
  return sum[4];
}

// 1-3 force on the filaments nN, 4 length of contact um, 5 energy nN um, 6 least distance of an axis um, 7 stretches
double FixWallCapsule::compute_vector(int k)
{
  gather();
  return sum[k];
}

double FixWallCapsule::memory_usage()
{
  return (double) atom->nmax * KEPT * sizeof(double);
}

void FixWallCapsule::grow_arrays(int nmax)
{
  memory->grow(history, nmax, KEPT, "wall/capsule:history");
}

void FixWallCapsule::copy_arrays(int i, int j, int)
{
  std::copy(history[i], history[i] + KEPT, history[j]);
}

void FixWallCapsule::set_arrays(int i)
{
  std::fill(history[i], history[i] + KEPT, 0.0);
}

int FixWallCapsule::pack_exchange(int i, double *buf)
{
  std::copy(history[i], history[i] + KEPT, buf);
  return KEPT;
}

int FixWallCapsule::unpack_exchange(int i, double *buf)
{
  std::copy(buf, buf + KEPT, history[i]);
  return KEPT;
}

int FixWallCapsule::pack_restart(int i, double *buf)
{
  buf[0] = KEPT + 1;
  std::copy(history[i], history[i] + KEPT, buf + 1);
  return KEPT + 1;
}

void FixWallCapsule::unpack_restart(int i, int nth)
{
  double **extra = atom->extra;
  int m = 0;
  for (int k = 0; k < nth; k++) m += static_cast<int>(extra[i][m]);
  std::copy(extra[i] + m + 1, extra[i] + m + 1 + KEPT, history[i]);
}

int FixWallCapsule::size_restart(int)
{
  return KEPT + 1;
}

int FixWallCapsule::maxsize_restart()
{
  return KEPT + 1;
}
