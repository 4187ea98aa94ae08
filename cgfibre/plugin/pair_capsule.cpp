#include "pair_capsule.h"

#include "fix_segments.h"
#include "vector3.h"

#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "force.h"
#include "memory.h"
#include "modify.h"
#include "neighbor.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

using namespace LAMMPS_NS;
using namespace cgfibre;

namespace {

constexpr double NONE_CLOSE = 1e20;

}    // namespace

PairCapsule::PairCapsule(LAMMPS *lmp) : Pair(lmp), reach(0.0), spin(false), two_sided(false), kernels(lane_kernels()), chain(nullptr), store(nullptr), stale(true), warned(false)
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
  // pair_coeff comes when there is a box, and before fixes that move atoms between ranks
  if (!store) store = FixHistory::create(lmp, "CGFIBRE_CAPSULE", HISTORY, this);
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
  if (!kernels)
    error->all(FLERR, "environment variable CGFIBRE_LANES is {}, expected two, four or eight, as this processor has",
               getenv("CGFIBRE_LANES"));
  if (!chain && comm->me == 0) utils::logmesg(lmp, "pair_style capsule: contacts by {} a register\n", kernels->lanes);
  chain = FixSegments::of(lmp);
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
  beads.clear();
  masters.clear();
  rows.assign(1, 0);
  partners.clear();
  history.clear();
  held.clear();
  row_of.clear();
  std::vector<int> place(near.size(), -1);
  const auto placed = [&](int a) {
    if (place[a] < 0) {
      place[a] = (int) segments.size();
      const int i = near[a].bead, j = next[i];
      segments.push_back({});
      segments.back().radius = near[a].radius;
      segments.back().end = next[j] < 0 ? 1.0 : 0.0;
      beads.push_back({i, j, before[i], next[j], -1, -1});
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
    held.push_back(kept && (kept[0] != 0.0 || kept[1] != 0.0 || kept[2] != 0.0));
  });
  if (row >= 0) rows.push_back((int) partners.size());
  // segments next to one another, where both have a place
  std::vector<int> place_of(nall, -1);
  for (size_t k = 0; k < beads.size(); k++) place_of[beads[k].first] = (int) k;
  for (Beads &b : beads) {
    b.back = b.previous >= 0 ? place_of[b.previous] : -1;
    b.front = place_of[b.second];
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
    const int i = beads[masters[m]].first;
    for (int k = rows[m]; k < rows[m + 1]; k++) {
      const double *h = &history[(size_t) k * HISTORY];
      bool any = false;
      for (int n = 0; n < HISTORY; n++) any |= h[n] != 0.0;
      if (any) into.add(i, atom->tag[beads[partners[k]].first], h);
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
  for (size_t k = 0; k < segments.size(); k++) {
    Segment &s = segments[k];
    const Beads &b = beads[k];
    s.length = direction(b.first, b.second, s.t);
    s.inverse = s.length > 0.0 ? 1.0 / s.length : 0.0;
    for (int d = 0; d < 3; d++) {
      s.x[d] = x[b.first][d];
      s.v[d] = v[b.first][d];
      s.dv[d] = v[b.second][d] - v[b.first][d];
    }
  }
  carry_with_box();
  // a neighbour that is in no pair has no place
  for (size_t k = 0; k < segments.size(); k++) {
    Segment &s = segments[k];
    const Beads &b = beads[k];
    double there[3];
    const auto plane = [&](int place, int from, int to, double *normal) {
      const Segment *other = place >= 0 ? &segments[place] : nullptr;
      const bool found = other ? other->length > 0.0 : from >= 0 && to >= 0 && direction(from, to, there) > 0.0;
      const double *t = other ? other->t : there;
      for (int d = 0; d < 3; d++) normal[d] = found ? s.t[d] + t[d] : s.t[d];
    };
    plane(b.back, b.previous, b.first, s.before);
    plane(b.front, b.second, b.following, s.after);
  }
}

// A box that deforms (fix deform, remap x) moves beads beside their velocities: surfaces slide past each other by that too.
void PairCapsule::carry_with_box()
{
  const double *rate = domain->h_rate, *inverse = domain->h_inv;    // xx, yy, zz, yz, xz, xy
  if (!domain->deform_flag || domain->deform_vremap) return;
  bool still = true;
  for (int k = 0; k < 6; k++) still = still && rate[k] == 0.0;
  if (still) return;
  // velocity gradient: the rate of the box's edges times their inverse, upper triangles both
  const double xx = rate[0] * inverse[0], yy = rate[1] * inverse[1], zz = rate[2] * inverse[2];
  const double xy = rate[0] * inverse[5] + rate[5] * inverse[1];
  const double yz = rate[1] * inverse[3] + rate[3] * inverse[2];
  const double xz = rate[0] * inverse[4] + rate[5] * inverse[3] + rate[4] * inverse[2];
  for (Segment &s : segments) {
    const double *r = s.x, along[3] = {s.length * s.t[0], s.length * s.t[1], s.length * s.t[2]};
    s.v[0] += xx * r[0] + xy * r[1] + xz * r[2];
    s.v[1] += yy * r[1] + yz * r[2];
    s.v[2] += zz * r[2];
    s.dv[0] += xx * along[0] + xy * along[1] + xz * along[2];
    s.dv[1] += yy * along[1] + yz * along[2];
    s.dv[2] += zz * along[2];
  }
}

// a stretch in contact into its lane
void PairCapsule::fill(PressLanes &all, int lane, const Waiting &pair, double lo, double hi, double *h) const
{
  const int a = masters[pair.master], b = partners[pair.partner];
  const Segment &A = segments[a], &B = segments[b];
  const Coefficients &c = of_types(atom->type[beads[a].first], atom->type[beads[b].first]);
  const double cosine = c.friction.by_angle() ? std::fabs(dot(A.t, B.t)) : 1.0;
  all.A[lane] = &A;
  all.B[lane] = &B;
  all.lo[lane] = lo;
  all.hi[lane] = hi;
  all.law[lane] = &c.law;
  all.modulus[lane] = c.law.kind() == NormalLaw::LINE ? c.law.modulus() : 0.0;
  all.damping[lane] = c.damping;
  all.tangential[lane] = c.tangential;
  all.sliding[lane] = c.sliding;
  all.friction[lane] = c.friction.limit(cosine, h[3] != 0.0);
  all.kinetic[lane] = c.friction.limit(cosine, true);
  all.history[lane] = h;
  if (spin) {
    double **omega = atom->omega;
    const int turning[4] = {beads[a].first, beads[a].second, beads[b].first, beads[b].second};
    for (int n = 0; n < 4; n++) all.omega[n][lane] = omega[turning[n]];
  }
}

// the forces of the first `count` lanes
void PairCapsule::press(PressLanes &all, int count) const
{
  double nothing[HISTORY];
  all.dt = update->dt;
  all.line = true;
  for (int l = 0; l < count; l++) all.line &= all.law[l]->kind() == NormalLaw::LINE;
  for (int l = count; l < LANES; l++) {    // repeat the first, without a trace
    std::copy(all.history[0], all.history[0] + HISTORY, nothing);
    all.A[l] = all.A[0];
    all.B[l] = all.B[0];
    all.lo[l] = all.lo[0];
    all.hi[l] = all.hi[0];
    all.law[l] = all.law[0];
    all.modulus[l] = all.modulus[0];
    all.damping[l] = all.damping[0];
    all.tangential[l] = all.tangential[0];
    all.sliding[l] = all.sliding[0];
    all.friction[l] = all.friction[0];
    all.kinetic[l] = all.kinetic[0];
    all.history[l] = nothing;
    for (int n = 0; n < 4; n++) all.omega[n][l] = all.omega[n][0];
  }
  // Seen from both sides, on average at the surfaces: a chain takes its couple as the first, over the length of the
  // contact. As the second it would take it across one segment, and behind a joint suddenly across the next.
  all.on_second_axis = two_sided && !spin;
  if (spin)
    kernels->press_spin(all);
  else
    kernels->press(all);
  if (!two_sided) return;
  const auto halve = [count](double *values) {    // the other half comes from the other side
    for (int l = 0; l < count; l++) values[l] *= 0.5;
  };
  for (int d = 0; d < 3; d++) {
    for (int n = 0; n < 4; n++) {
      halve(all.force[n][d]);
      if (spin) halve(all.torque[n][d]);
    }
    halve(all.friction_force[d]);
  }
  halve(all.normal);
  halve(all.length);
}

CapsuleContact PairCapsule::contact_of(const PressLanes &all, int lane) const
{
  CapsuleContact contact;
  contact.normal = all.normal[lane];
  for (int d = 0; d < 3; d++) {
    contact.friction[d] = all.friction_force[d][lane];
    contact.force[d] = all.force[0][d][lane] + all.force[1][d][lane];
    contact.point[d] = all.point[d][lane];
  }
  contact.length = all.length[lane];
  contact.distance = all.distance[lane];
  contact.cosine = all.cosine[lane];
  contact.slipping = all.slips[lane] != 0.0;
  constexpr double weight[3] = {5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0};
  const double share = all.share[lane], size = 0.5 * (all.A[lane]->radius + all.B[lane]->radius);
  for (int g = 0; g < 3; g++) {
    const double overlap = all.overlap[g][lane];
    if (overlap > 0.0)
      contact.energy += 0.5 * contact.length * weight[g] *
          (share * all.law[lane]->energy(overlap, size) + (1.0 - share) * 0.5 * all.lens[lane] * overlap * overlap);
  }
  return contact;
}

// A stretch that begins on the next segment of a filament goes on with the spring of the stretch before it: what has slid
// along the one has slid along the other. A filament that crosses at a right angle changes segments at once.
void PairCapsule::inherit(size_t m, int k)
{
  const Beads &B = beads[partners[k]];
  double *h = &history[(size_t) k * HISTORY];
  const auto next_to = [&](int other) {
    const Beads &O = beads[other];
    return O.second == B.first || O.first == B.second;
  };
  for (const Ended &one : lost)
    if (next_to(one.segment)) {
      std::copy(one.history, one.history + HISTORY, h);
      return;
    }
  for (int j = rows[m]; j < rows[m + 1]; j++) {
    if (j == k || !held[j] || !next_to(partners[j])) continue;
    const double *theirs = &history[(size_t) j * HISTORY];
    std::copy(theirs, theirs + HISTORY, h);
    return;
  }
}

// which of the waiting candidates touch
void PairCapsule::sort_out()
{
  const bool advance = pressing.advance;
  for (int l = candidate_count; l < LANES; l++) {
    meeting.A[l] = meeting.A[0];
    meeting.B[l] = meeting.B[0];
  }
  const unsigned met = kernels->meet(meeting);
  for (int l = 0; l < candidate_count; l++) {
    const Waiting &pair = candidates[l];
    const int k = pair.partner;
    if (!(met >> l & 1) && !held[k]) continue;
    double *h = &history[(size_t) k * HISTORY];
    if (advance && lost_row != (size_t) pair.master) {
      lost.clear();
      lost_row = pair.master;
    }
    if (!(met >> l & 1)) {
      if (!advance) continue;
      lost.push_back({partners[k], {}});
      std::copy(h, h + HISTORY, lost.back().history);
      std::fill(h, h + 4, 0.0);
      held[k] = 0;
      continue;
    }
    if (advance && !held[k]) {
      add_loads();    // the springs of the row before this one, as they are after this step on any number of ranks
      inherit(pair.master, k);
    }
    fill(pressing, touching_count, pair, meeting.lo[l], meeting.hi[l], h);
    touching[touching_count++] = pair;
    if (touching_count == LANES) add_loads();
  }
  candidate_count = 0;
}

void PairCapsule::add_loads()
{
  if (touching_count == 0) return;
  double **f = atom->f, **torque = atom->torque;
  press(pressing, touching_count);
  for (int l = 0; l < touching_count; l++) {
    const Beads &A = beads[masters[touching[l].master]], &B = beads[partners[touching[l].partner]];
    const int on[4] = {A.first, A.second, B.first, B.second};
    for (int n = 0; n < 4; n++)
      for (int d = 0; d < 3; d++) f[on[n]][d] += pressing.force[n][d][l];
    if (spin)
      for (int n = 0; n < 4; n++)
        for (int d = 0; d < 3; d++) torque[on[n]][d] += pressing.torque[n][d][l];
    if (pressing.advance) {
      const double *h = pressing.history[l];
      held[touching[l].partner] = h[0] != 0.0 || h[1] != 0.0 || h[2] != 0.0;
    }
    if (evflag) {
      contacts += two_sided ? 0.5 : 1.0;
      contact_length += pressing.length[l];
      closest = std::min(closest, pressing.distance[l]);
      tally(on, pressing, l);
    }
  }
  touching_count = 0;
}

void PairCapsule::add_forces()
{
  pressing.advance = !update->setupflag;
  pressing.energy = eflag_either;
  contacts = contact_length = 0.0;
  closest = NONE_CLOSE;
  candidate_count = touching_count = 0;
  lost.clear();
  lost_row = 0;
  for (size_t m = 0; m < masters.size(); m++) {
    const Segment *A = &segments[masters[m]];
    for (int k = rows[m]; k < rows[m + 1]; k++) {
      meeting.A[candidate_count] = A;
      meeting.B[candidate_count] = &segments[partners[k]];
      candidates[candidate_count++] = {(int) m, k};
      if (candidate_count == LANES) sort_out();
    }
  }
  if (candidate_count > 0) sort_out();
  add_loads();
  if (eflag_global) {
    // compute pair adds up over ranks: a least value is shared out
    MPI_Allreduce(MPI_IN_PLACE, &closest, 1, MPI_DOUBLE, MPI_MIN, world);
    pvector[0] = contacts;
    pvector[1] = closest / comm->nprocs;
    pvector[2] = contact_length;
  }
}

void PairCapsule::tally(const int *on, const PressLanes &all, int lane)
{
  if (eflag_either) {
    const double energy = contact_of(all, lane).energy;
    if (eflag_global) eng_vdwl += energy;
    if (eflag_atom)
      for (int n = 0; n < 4; n++) eatom[on[n]] += 0.25 * energy;
  }
  if (!vflag_atom && !(vflag_global && !vflag_fdotr)) return;
  // the four forces add up to nothing, so any origin will do
  double v[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  for (int n = 0; n < 4; n++) {
    const double *x = atom->x[on[n]], F[3] = {all.force[n][0][lane], all.force[n][1][lane], all.force[n][2][lane]};
    double r[3];
    for (int d = 0; d < 3; d++) r[d] = x[d] - all.A[lane]->x[d];
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
      for (int k = 0; k < 4; k++) vatom[on[k]][n] += 0.25 * v[n];
  }
}

void PairCapsule::compute(int eflag, int vflag)
{
  ev_init(eflag, vflag);
  if (stale) find_pairs();
  place_segments();
  add_forces();
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
      if (atom->tag[beads[partners[k]].first] != atom->tag[b]) continue;
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
  MeetLanes pair;
  for (int l = 0; l < LANES; l++) {
    pair.A[l] = &segments[masters[m]];
    pair.B[l] = &segments[partners[k]];
  }
  if (!(kernels->meet(pair) & 1)) return false;
  double kept[HISTORY];
  std::copy(&history[(size_t) k * HISTORY], &history[(size_t) (k + 1) * HISTORY], kept);
  PressLanes one;
  one.advance = false;
  one.energy = true;
  fill(one, 0, {m, k}, pair.lo[0], pair.hi[0], kept);
  press(one, 1);
  contact = contact_of(one, 0);
  return true;
}

double PairCapsule::memory_usage()
{
  return (double) segments.capacity() * sizeof(Segment) + (double) beads.capacity() * sizeof(Beads) +
      (double) history.capacity() * sizeof(double) + (double) held.capacity() +
      (double) (partners.capacity() + rows.capacity() + masters.capacity()) * sizeof(int) +
      (double) near.capacity() * sizeof(SearchSegment);
}
