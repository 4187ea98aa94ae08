#include "fix_wall_granular_table.h"

#include "atom.h"
#include "comm.h"
#include "error.h"
#include "lammps.h"
#include "memory.h"
#include "update.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <mpi.h>
#include <string>

using namespace cgfibre;
using namespace LAMMPS_NS;

FixWallGranularTable::FixWallGranularTable(LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  int iarg = 3;
  shape_ = WallShape::parse(lmp, narg, arg, iarg);
  law_ = ContactLaw::parse(lmp, narg, arg, iarg);
  while (iarg < narg) {
    if (law_.keyword(lmp, narg, arg, iarg) || shape_.keyword(lmp, narg, arg, iarg)) continue;
    if (std::strcmp(arg[iarg], "contacts") != 0)
      error->all(FLERR,
                 "fix wall/granular/table has {}, expected length, damping, friction, tangential, rolling, move, rotate, "
                 "span or contacts",
                 arg[iarg]);
    iarg++;
    peratom_flag = 1;
    size_peratom_cols = COLUMNS;
    peratom_freq = 1;
  }
  if (!atom->radius_flag || !atom->omega_flag || !atom->torque_flag)
    error->all(FLERR, "fix wall/granular/table needs atoms with radius, omega and torque, as of atom_style sphere");

  scalar_flag = 1;
  extscalar = 1;
  vector_flag = 1;
  size_vector = SUMS;
  extvector = 1;
  global_freq = 1;
  energy_global_flag = 1;
  restart_global = 1;
  restart_peratom = 1;
  create_attribute = 1;
  maxexchange = ContactLaw::VALUES;
  std::fill(mine_, mine_ + SUMS, 0.0);
  grow_arrays(atom->nmax);
  atom->add_callback(Atom::GROW);
  atom->add_callback(Atom::RESTART);
}

FixWallGranularTable::~FixWallGranularTable()
{
  atom->delete_callback(id, Atom::GROW);
  atom->delete_callback(id, Atom::RESTART);
  if (peratom_flag) memory->destroy(array_atom);
}

int FixWallGranularTable::setmask()
{
  return FixConst::POST_FORCE | FixConst::MIN_POST_FORCE;
}

void FixWallGranularTable::init()
{
  shape_.init(lmp);
}

void FixWallGranularTable::setup(int /*vflag*/)
{
  shape_.advance(lmp, true);
  press(0);
}

void FixWallGranularTable::post_force(int /*vflag*/)
{
  shape_.advance(lmp, false);
  press(update->dt);
}

void FixWallGranularTable::min_post_force(int vflag)
{
  setup(vflag);
}

// the forces of this step; with dt = 0 no history moves on
void FixWallGranularTable::press(double dt)
{
  std::fill(mine_, mine_ + SUMS, 0.0);
  summed_ = false;
  const int nlocal = atom->nlocal;
  if (peratom_flag && nlocal > 0) std::fill(array_atom[0], array_atom[0] + static_cast<size_t>(nlocal) * COLUMNS, 0.0);
  if (law_.none()) return;
  for (int i = 0; i < nlocal; i++) {
    if (!(atom->mask[i] & groupbit)) continue;
    const Hit hit = shape_.hit(atom->x[i]);
    if (hit.gap < atom->radius[i])
      interact(i, hit, dt);
    else
      set_arrays(i);
  }
}

void FixWallGranularTable::interact(int i, const Hit &hit, double dt)
{
  const double radius = atom->radius[i], *omega = atom->omega[i], *n = hit.n;
  const double arm = std::max(0.0, hit.gap), bend = 1 + radius * hit.curvature, effective = radius / bend;
  Contact contact;
  contact.overlap = radius - hit.gap;
  contact.size = radius / 2 * bend;
  double point[3], wall[3];
  for (int c = 0; c < 3; c++) {
    contact.n[c] = n[c];
    point[c] = atom->x[i][c] - hit.gap * n[c];
  }
  shape_.velocity(point, wall);
  for (int c = 0; c < 3; c++) {
    const int a = (c + 1) % 3, b = (c + 2) % 3;
    const double turning = omega[a] * n[b] - omega[b] * n[a];
    contact.v[c] = atom->v[i][c] - wall[c] - arm * turning;
    contact.roll[c] = effective * turning;
  }
  const ContactForce out = law_.force(contact, history(i), dt);
  for (int c = 0; c < 3; c++) {
    const int a = (c + 1) % 3, b = (c + 2) % 3;
    const double total = out.normal * n[c] + out.t[c];
    atom->f[i][c] += total;
    atom->torque[i][c] += effective * (n[a] * out.roll[b] - n[b] * out.roll[a]) - arm * (n[a] * out.t[b] - n[b] * out.t[a]);
    mine_[c] -= total;
  }
  mine_[3] += 1;
  mine_[4] += law_.energy(contact.overlap, contact.size);
  if (peratom_flag) {
    const double row[COLUMNS] = {out.normal, out.t[0], out.t[1], out.t[2], contact.overlap, history(i)[ContactLaw::SLIPPING]};
    std::copy(row, row + COLUMNS, array_atom[i]);
  }
}

double FixWallGranularTable::compute_vector(int k)
{
  if (!summed_) {
    MPI_Allreduce(mine_, all_, SUMS, MPI_DOUBLE, MPI_SUM, world);
    summed_ = true;
  }
  return all_[k];
}

void FixWallGranularTable::write_restart(FILE *fp)
{
  if (comm->me != 0) return;
  double state[WallShape::STATE];
  shape_.get_state(state);
  const int size = sizeof state;
  fwrite(&size, sizeof size, 1, fp);
  fwrite(state, sizeof state, 1, fp);
}

void FixWallGranularTable::restart(char *buf)
{
  double state[WallShape::STATE];
  std::memcpy(state, buf, sizeof state);
  shape_.set_state(state);
}

void FixWallGranularTable::grow_arrays(int nmax)
{
  const size_t size = static_cast<size_t>(nmax) * ContactLaw::VALUES;
  if (history_.size() < size) history_.resize(size, 0.0);
  if (peratom_flag) memory->grow(array_atom, nmax, COLUMNS, "wall:array_atom");
}

void FixWallGranularTable::copy_arrays(int i, int j, int /*delflag*/)
{
  std::copy(history(i), history(i) + ContactLaw::VALUES, history(j));
  if (peratom_flag) std::copy(array_atom[i], array_atom[i] + COLUMNS, array_atom[j]);
}

void FixWallGranularTable::set_arrays(int i)
{
  std::fill(history(i), history(i) + ContactLaw::VALUES, 0.0);
}

int FixWallGranularTable::pack_exchange(int i, double *buf)
{
  std::copy(history(i), history(i) + ContactLaw::VALUES, buf);
  return ContactLaw::VALUES;
}

int FixWallGranularTable::unpack_exchange(int nlocal, double *buf)
{
  std::copy(buf, buf + ContactLaw::VALUES, history(nlocal));
  return ContactLaw::VALUES;
}

int FixWallGranularTable::pack_restart(int i, double *buf)
{
  buf[0] = ContactLaw::VALUES + 1;
  std::copy(history(i), history(i) + ContactLaw::VALUES, buf + 1);
  return ContactLaw::VALUES + 1;
}

void FixWallGranularTable::unpack_restart(int nlocal, int nth)
{
  const double *stored = atom->extra[nlocal];
  for (int k = 0; k < nth; k++) stored += static_cast<int>(*stored);
  std::copy(stored + 1, stored + 1 + ContactLaw::VALUES, history(nlocal));
}

double FixWallGranularTable::memory_usage()
{
  return static_cast<double>(history_.capacity() * sizeof(double));
}
