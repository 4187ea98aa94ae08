#include "pair_granular_table.h"

#include "vector3.h"

#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "force.h"
#include "lammps.h"
#include "memory.h"
#include "modify.h"
#include "neigh_list.h"
#include "neighbor.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <mpi.h>

using namespace cgfibre;
using namespace LAMMPS_NS;

PairGranularTable::PairGranularTable(LAMMPS *lmp) : Pair(lmp)
{
  single_enable = 1;
  restartinfo = 0;
  finitecutflag = 1;
  no_virial_fdotr_compute = 1;    // forces on ghosts stay with their owners
  centroidstressflag = CENTROID_NOTAVAIL;
  single_extra = 6;
  svector = new double[single_extra]();
}

PairGranularTable::~PairGranularTable()
{
  if (!history_id_.empty() && modify->get_fix_by_id(history_id_)) modify->delete_fix(history_id_);
  delete[] svector;
  if (allocated) {
    memory->destroy(setflag);
    memory->destroy(cutsq);
  }
}

int PairGranularTable::stride() const
{
  return atom->ntypes + 1;
}

void PairGranularTable::allocate()
{
  allocated = 1;
  const int n = stride();
  memory->create(setflag, n, n, "pair:setflag");
  memory->create(cutsq, n, n, "pair:cutsq");
  for (int i = 0; i < n; i++) std::fill(setflag[i], setflag[i] + n, 0);
  laws_.assign(n * n, ContactLaw());
}

void PairGranularTable::make_history()
{
  if (history_) return;
  history_ = FixHistory::create(lmp, "CGFIBRE_GRANULAR", ContactLaw::VALUES, this);
  history_id_ = history_->id;
}

void PairGranularTable::settings(int narg, char **arg)
{
  if (narg != 0) error->all(FLERR, "pair_style granular/table is followed by {}, expected nothing", arg[0]);
  if (domain->box_exist) make_history();
}

void PairGranularTable::coeff(int narg, char **arg)
{
  if (narg < 3) error->all(FLERR, "pair_coeff of granular/table is too short, expected I J LAW ...");
  if (!allocated) allocate();
  int ilo, ihi, jlo, jhi, iarg = 2;
  utils::bounds(FLERR, arg[0], 1, atom->ntypes, ilo, ihi, error);
  utils::bounds(FLERR, arg[1], 1, atom->ntypes, jlo, jhi, error);
  ContactLaw given = ContactLaw::parse(lmp, narg, arg, iarg);
  while (iarg < narg)
    if (!given.keyword(lmp, narg, arg, iarg))
      error->all(FLERR, "pair_coeff of granular/table has {}, expected length, damping, friction, tangential or rolling",
                 arg[iarg]);
  bool any = false;
  for (int i = ilo; i <= ihi; i++)
    for (int j = std::max(jlo, i); j <= jhi; j++) {
      any = true;
      laws_[i * stride() + j] = laws_[j * stride() + i] = given;
      setflag[i][j] = 1;
    }
  if (!any) error->all(FLERR, "pair_coeff of granular/table has types {} {}, expected I <= J", arg[0], arg[1]);
}

void PairGranularTable::init_style()
{
  if (!atom->radius_flag || !atom->omega_flag || !atom->torque_flag)
    error->all(FLERR, "pair_style granular/table needs atoms with radius, omega and torque, as of atom_style sphere");
  if (!atom->tag_enable) error->all(FLERR, "pair_style granular/table needs atom IDs");
  if (!comm->ghost_velocity) error->all(FLERR, "pair_style granular/table needs comm_modify vel yes");
  make_history();
  neighbor->add_request(this, NeighConst::REQ_SIZE | NeighConst::REQ_NEWTON_OFF);

  std::vector<double> mine(atom->ntypes + 1, 0.0);
  for (int i = 0; i < atom->nlocal; i++) mine[atom->type[i]] = std::max(mine[atom->type[i]], atom->radius[i]);
  radius_.assign(mine.size(), 0.0);
  MPI_Allreduce(mine.data(), radius_.data(), static_cast<int>(mine.size()), MPI_DOUBLE, MPI_MAX, world);
}

double PairGranularTable::init_one(int i, int j)
{
  if (!setflag[i][j]) error->all(FLERR, "pair_coeff {} {} of granular/table is missing, expected: there is no mixing", i, j);
  return radius_[i] + radius_[j];
}

// contacts are known by the partner's tag, so no two of its images may touch an atom at once
void PairGranularTable::setup()
{
  for (int c = 0; c < domain->dimension; c++)
    if (domain->periodicity[c] && domain->prd[c] < 2 * cutforce)
      error->all(FLERR, "the periodic box is {} wide in {}, expected at least {}, twice the greatest contact distance",
                 domain->prd[c], "xyz"[c], 2 * cutforce);
}

void PairGranularTable::deposit(FixHistory &store)
{
  const int nlocal = static_cast<int>(start_.size()) - 1;
  const tagint *tag = atom->tag;
  double mirrored[ContactLaw::VALUES];
  for (int i = 0; i < nlocal; i++)
    for (int k = start_[i]; k < start_[i + 1]; k++) {
      const Candidate &c = candidates_[k];
      if (!c.touching) continue;
      store.add(i, tag[c.j], c.history);
      if (c.j < nlocal) {
        ContactLaw::mirror(c.history, mirrored);
        store.add(c.j, tag[i], mirrored);
      }
    }
}

void PairGranularTable::restore(const FixHistory &store)
{
  const int nlocal = atom->nlocal;
  const int *type = atom->type;
  const tagint *tag = atom->tag;
  std::vector<int> row(nlocal, -1);
  for (int ii = 0; ii < list->inum; ii++) row[list->ilist[ii]] = ii;
  candidates_.clear();
  start_.assign(nlocal + 1, 0);
  for (int i = 0; i < nlocal; i++) {
    start_[i] = static_cast<int>(candidates_.size());
    if (row[i] < 0) continue;
    for (int jj = 0; jj < list->numneigh[i]; jj++) {
      const int neighbour = list->firstneigh[i][jj], j = neighbour & NEIGHMASK;
      if (force->special_lj[sbmask(neighbour)] == 0 || law(type[i], type[j]).none()) continue;
      Candidate c = {};
      c.j = j;
      if (const double *stored = store.find(i, tag[j])) {
        std::copy(stored, stored + ContactLaw::VALUES, c.history);
        c.touching = true;
      }
      candidates_.push_back(c);
    }
  }
  start_[nlocal] = static_cast<int>(candidates_.size());
}

void PairGranularTable::compute(int eflag, int vflag)
{
  ev_init(eflag, vflag);
  history_->changed();
  double **x = atom->x;
  const double *radius = atom->radius;
  const double dt = update->setupflag ? 0 : update->dt;
  const int n = static_cast<int>(start_.size()) - 1;
  for (int i = 0; i < n; i++)
    for (int k = start_[i]; k < start_[i + 1]; k++) {
      Candidate &c = candidates_[k];
      const double dx = x[i][0] - x[c.j][0], dy = x[i][1] - x[c.j][1], dz = x[i][2] - x[c.j][2];
      const double reach = radius[i] + radius[c.j];
      if (dx * dx + dy * dy + dz * dz < reach * reach) {
        interact(i, c, dt);
      } else if (c.touching) {
        const int j = c.j;
        c = {};
        c.j = j;
      }
    }
}

void PairGranularTable::interact(int i, Candidate &c, double dt)
{
  const int j = c.j, nlocal = atom->nlocal;
  double **x = atom->x, **v = atom->v, **omega = atom->omega, **f = atom->f, **torque = atom->torque;
  const double ri = atom->radius[i], rj = atom->radius[j];
  double d[3];
  for (int k = 0; k < 3; k++) d[k] = x[i][k] - x[j][k];
  const double r = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);

  Contact contact;
  contact.overlap = ri + rj - r;
  contact.size = (ri + rj) / 2;
  for (int k = 0; k < 3; k++) contact.n[k] = r > 0 ? d[k] / r : 0;
  if (r == 0) contact.n[0] = atom->tag[i] < atom->tag[j] ? 1 : -1;    // any direction, the same from both sides

  const double ai = r * ri / (ri + rj), aj = r * rj / (ri + rj), effective = ri * rj / (ri + rj);
  double spin[3], turning[3], slide[3];
  for (int k = 0; k < 3; k++) {
    spin[k] = ai * omega[i][k] + aj * omega[j][k];
    turning[k] = effective * (omega[i][k] - omega[j][k]);
  }
  cross(spin, contact.n, slide);
  cross(turning, contact.n, contact.roll);
  for (int k = 0; k < 3; k++) contact.v[k] = v[i][k] - v[j][k] - slide[k];

  const ContactLaw &law_ij = law(atom->type[i], atom->type[j]);
  const ContactForce out = law_ij.force(contact, c.history, dt);
  c.touching = true;
  c.normal = out.normal;
  c.overlap = contact.overlap;
  std::copy(out.t, out.t + 3, c.t);

  double total[3], sliding[3], rolling[3];
  for (int k = 0; k < 3; k++) total[k] = out.normal * contact.n[k] + out.t[k];
  cross(contact.n, out.t, sliding);
  cross(contact.n, out.roll, rolling);
  for (int k = 0; k < 3; k++) {
    f[i][k] += total[k];
    torque[i][k] += effective * rolling[k] - ai * sliding[k];
    if (j < nlocal) {
      f[j][k] -= total[k];
      torque[j][k] -= effective * rolling[k] + aj * sliding[k];
    }
  }
  if (evflag)
    ev_tally_xyz(i, j, nlocal, 0, eflag_either ? law_ij.energy(contact.overlap, contact.size) : 0, 0, total[0], total[1],
                 total[2], d[0], d[1], d[2]);
}

const PairGranularTable::Candidate *PairGranularTable::find(int i, int j) const
{
  if (i + 1 >= static_cast<int>(start_.size())) return nullptr;
  for (int k = start_[i]; k < start_[i + 1]; k++)
    if (candidates_[k].j == j) return &candidates_[k];
  return nullptr;
}

double PairGranularTable::single(int i, int j, int itype, int jtype, double rsq, double, double, double &fforce)
{
  double sign = 1;
  const Candidate *c = find(i, j);
  if (c == nullptr && j < atom->nlocal) {
    c = find(j, i);
    sign = -1;
  }
  std::fill(svector, svector + single_extra, 0.0);
  fforce = 0;
  if (c == nullptr || !c->touching) return 0;
  fforce = rsq > 0 ? c->normal / std::sqrt(rsq) : 0;
  svector[0] = c->normal;
  for (int k = 0; k < 3; k++) svector[1 + k] = sign * c->t[k];
  svector[4] = c->overlap;
  svector[5] = c->history[ContactLaw::SLIPPING];
  return law(itype, jtype).energy(c->overlap, (atom->radius[i] + atom->radius[j]) / 2);
}

double PairGranularTable::memory_usage()
{
  return Pair::memory_usage() + static_cast<double>(candidates_.capacity() * sizeof(Candidate) + start_.capacity() * sizeof(int));
}
