#include "fix_disc_support.h"

#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "input.h"
#include "modify.h"
#include "table_file.h"
#include "update.h"
#include "variable.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <mpi.h>

using namespace cgfibre;
using namespace LAMMPS_NS;

FixDiscSupport::FixDiscSupport(LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  int iarg = 3;
  const std::string kind = word(lmp, narg, arg, iarg, "law of fix disc/support");
  if (kind == "linear") {
    k_ = number(lmp, narg, arg, iarg, "stiffness of fix disc/support", 0);
  } else if (kind == "table") {
    const std::string file = word(lmp, narg, arg, iarg, "table file of fix disc/support");
    const TableFile table(lmp, file, word(lmp, narg, arg, iarg, "keyword of fix disc/support"));
    if (table.x[0] != 0) table.fail_row(1, "distance", table.x[0], "0");
    if (table.y[0] != 0) table.fail_row(1, "force", table.y[0], "0");
    for (size_t k = 1; k < table.y.size(); k++)
      if (table.y[k] <= table.y[k - 1]) table.fail_row(k + 1, "force", table.y[k], "more than before");
    law_ = Curve(table.x, table.y, Curve::LAST_SLOPE);
  } else {
    error->all(FLERR, "law of fix disc/support is {}, expected linear or table", kind);
  }
  while (iarg < narg) {
    const std::string what = word(lmp, narg, arg, iarg, "word");
    if (what == "turn") {
      turn_ = number(lmp, narg, arg, iarg, "torsional stiffness of fix disc/support", 0);
    } else if (what == "drag") {
      drag_ = number(lmp, narg, arg, iarg, "drag of fix disc/support", 0);
      turning_drag_ = number(lmp, narg, arg, iarg, "turning drag of fix disc/support", 0);
    } else if (what == "stiffen") {
      stiffen(narg, arg, iarg);
    } else {
      error->all(FLERR, "fix disc/support has {}, expected turn, drag or stiffen", what);
    }
  }
  if (!atom->omega_flag || !atom->torque_flag)
    error->all(FLERR, "fix disc/support needs atoms with omega and torque, as of atom_style sphere");
  scalar_flag = 1;
  extscalar = 1;
  vector_flag = 1;
  size_vector = 8;
  extvector = 0;
  global_freq = 1;
  energy_global_flag = 1;
  restart_global = 1;
  restart_peratom = 1;
  create_attribute = 1;
  maxexchange = VALUES;
  std::fill(mine_, mine_ + SUMS, 0.0);
  grow_arrays(atom->nmax);
  for (int i = 0; i < atom->nlocal; i++) set_arrays(i);
  atom->add_callback(Atom::GROW);
  atom->add_callback(Atom::RESTART);
}

void FixDiscSupport::stiffen(int narg, char **arg, int &iarg)
{
  overlap_ = word(lmp, narg, arg, iarg, "overlap of fix disc/support");
  if (overlap_.compare(0, 2, "v_") != 0)
    error->all(FLERR, "overlap of fix disc/support is {}, expected v_NAME", overlap_);
  overlap_.erase(0, 2);
  start_ = number(lmp, narg, arg, iarg, "first overlap of fix disc/support", 0);
  end_ = number(lmp, narg, arg, iarg, "last overlap of fix disc/support", start_);
  if (end_ <= start_) error->all(FLERR, "last overlap of fix disc/support is {}, expected more than {}", end_, start_);
  most_ = number(lmp, narg, arg, iarg, "factor of fix disc/support", 1);
  if (word(lmp, narg, arg, iarg, "every") != "every")
    error->all(FLERR, "fix disc/support has {}, expected every", arg[iarg - 1]);
  nevery = static_cast<int>(number(lmp, narg, arg, iarg, "steps of fix disc/support", 1));
}

FixDiscSupport::~FixDiscSupport()
{
  atom->delete_callback(id, Atom::GROW);
  atom->delete_callback(id, Atom::RESTART);
}

int FixDiscSupport::setmask()
{
  return FixConst::POST_FORCE | (overlap_.empty() ? 0 : FixConst::END_OF_STEP);
}

void FixDiscSupport::init()
{
  if (overlap_.empty()) return;
  variable_ = input->variable->find(overlap_.c_str());
  if (variable_ < 0 || !input->variable->equalstyle(variable_))
    error->all(FLERR, "variable {} of fix disc/support is no equal-style variable", overlap_);
}

void FixDiscSupport::setup(int /*vflag*/)
{
  hold(0);
  if (!overlap_.empty()) modify->addstep_compute_all((update->ntimestep / nevery + 1) * nevery);
}

void FixDiscSupport::post_force(int /*vflag*/)
{
  state_[2] += state_[3];
  hold(update->dt);
}

// the forces of this step; the turn moves on by dt (velocities are those of half a step before)
void FixDiscSupport::hold(double dt)
{
  std::fill(mine_, mine_ + SUMS, 0.0);
  far_ = turned_ = 0;
  summed_ = false;
  const double share = 1 / state_[1];
  const bool linear = law_.empty();
  double **x = atom->x, **v = atom->v, **f = atom->f, **omega = atom->omega, **torque = atom->torque;
  for (int i = 0; i < atom->nlocal; i++) {
    if (!(atom->mask[i] & groupbit)) continue;
    double at[3], *own = this->own(i);
    domain->unmap(x[i], atom->image[i], at);
    const double dx = at[0] - own[X], dy = at[1] - own[Y], squared = dx * dx + dy * dy;
    double stiffness = k_;
    if (linear) {
      mine_[ENERGY] += 0.5 * k_ * squared;
    } else {
      const double r = std::sqrt(squared);
      // the slope at the origin, where force and distance both vanish
      stiffness = r > 1e-9 * law_.last() ? law_.value(r) / r : law_.slope(0);
      mine_[ENERGY] += law_.integral(r);
    }
    const double fx = -stiffness * dx, fy = -stiffness * dy;
    own[TURN] += dt * omega[i][2];
    const double turn = own[TURN];
    mine_[FX] += fx;
    mine_[FY] += fy;
    mine_[ENERGY] += 0.5 * turn_ * turn * turn;
    far_ = std::max(far_, squared);
    turned_ = std::max(turned_, std::fabs(turn));
    f[i][0] += share * fx - drag_ * v[i][0];
    f[i][1] += share * fy - drag_ * v[i][1];
    f[i][2] = torque[i][0] = torque[i][1] = 0;
    torque[i][2] -= share * turn_ * turn + turning_drag_ * omega[i][2];
  }
}

// a step at which the overlap is known: the next forces take the new factor
void FixDiscSupport::end_of_step()
{
  modify->clearstep_compute();
  const double overlap = input->variable->compute_equal(variable_);
  modify->addstep_compute(update->ntimestep + nevery);
  state_[0] += (std::max(overlap, 0.0) - state_[0]) / MEMORY;
  const double part = std::min(1.0, std::max(0.0, (state_[0] - start_) / (end_ - start_)));
  const double wanted = std::pow(most_, part);
  state_[1] = std::max(state_[1], std::min(wanted, state_[1] * (1 + GROWTH)));
  state_[3] = state_[0] <= start_ ? 1 : wanted > state_[1] ? CREEP : SLOW;
}

void FixDiscSupport::sum()
{
  if (summed_) return;
  MPI_Allreduce(mine_, all_, SUMS, MPI_DOUBLE, MPI_SUM, world);
  summed_ = true;
}

double FixDiscSupport::compute_scalar()
{
  sum();
  return all_[ENERGY];
}

double FixDiscSupport::compute_vector(int k)
{
  if (k == 3 || k == 4) return state_[k - 3];
  if (k == 2 || k == 5) {
    double most = k == 2 ? std::sqrt(far_) : turned_, all = 0;
    MPI_Allreduce(&most, &all, 1, MPI_DOUBLE, MPI_MAX, world);
    return all;
  }
  if (k >= 6) return state_[k - 4];
  sum();
  return all_[FX + k];
}

void FixDiscSupport::write_restart(FILE *fp)
{
  if (comm->me != 0) return;
  const int size = sizeof state_;
  fwrite(&size, sizeof(int), 1, fp);
  fwrite(state_, 1, size, fp);
}

void FixDiscSupport::restart(char *buf)
{
  std::memcpy(state_, buf, sizeof state_);
}

void FixDiscSupport::grow_arrays(int nmax)
{
  own_.resize(static_cast<size_t>(nmax) * VALUES, 0.0);
}

void FixDiscSupport::copy_arrays(int i, int j, int /*delflag*/)
{
  std::copy(own(i), own(i) + VALUES, own(j));
}

void FixDiscSupport::set_arrays(int i)
{
  double at[3];
  domain->unmap(atom->x[i], atom->image[i], at);
  own(i)[X] = at[0];
  own(i)[Y] = at[1];
  own(i)[TURN] = 0;
}

int FixDiscSupport::pack_exchange(int i, double *buf)
{
  std::copy(own(i), own(i) + VALUES, buf);
  return VALUES;
}

int FixDiscSupport::unpack_exchange(int nlocal, double *buf)
{
  std::copy(buf, buf + VALUES, own(nlocal));
  return VALUES;
}

int FixDiscSupport::pack_restart(int i, double *buf)
{
  buf[0] = VALUES + 1;
  std::copy(own(i), own(i) + VALUES, buf + 1);
  return VALUES + 1;
}

void FixDiscSupport::unpack_restart(int nlocal, int nth)
{
  const double *stored = atom->extra[nlocal];
  for (int k = 0; k < nth; k++) stored += static_cast<int>(*stored);
  std::copy(stored + 1, stored + 1 + VALUES, own(nlocal));
}

double FixDiscSupport::memory_usage()
{
  return static_cast<double>(own_.capacity() * sizeof(double));
}
