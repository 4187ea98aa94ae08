#include "compute_rod_energy.h"

#include "fix_segments.h"
#include "vector3.h"

#include "atom.h"
#include "error.h"
#include "force.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <cstring>

using namespace LAMMPS_NS;
using namespace cgfibre;

namespace {

// v turned by the unit quaternion q: v + 2 q0 (u x v) + 2 u x (u x v)
void turned(const double *q, const double *v, double *out)
{
  double a[3], b[3];
  cross(q + 1, v, a);
  cross(q + 1, a, b);
  for (int k = 0; k < 3; k++) out[k] = v[k] + 2.0 * (q[0] * a[k] + b[k]);
}

// rotation vector of p q^-1, its length up to pi
void between(const double *p, const double *q, double *out)
{
  double c[3];
  cross(p + 1, q + 1, c);
  double w = p[0] * q[0] + dot(p + 1, q + 1);
  double v[3];
  for (int k = 0; k < 3; k++) v[k] = q[0] * p[k + 1] - p[0] * q[k + 1] - c[k];
  if (w < 0.0) {
    w = -w;
    for (double &x : v) x = -x;
  }
  const double sine = std::sqrt(dot(v, v));
  const double scale = sine > 1e-12 ? 2.0 * std::atan2(sine, w) / sine : 2.0;
  for (int k = 0; k < 3; k++) out[k] = scale * v[k];
}

}    // namespace

ComputeRodEnergy::ComputeRodEnergy(LAMMPS *lmp, int narg, char **arg) : Compute(lmp, narg, arg)
{
  if (narg < 8 || (narg - 4) % 4)
    error->all(FLERR, "compute rod/energy takes the name of the natural segments and EA EI GJ kGA of every kind");
  name = arg[3];
  for (int k = 4; k < narg; k += 4) {
    double values[4];
    for (int m = 0; m < 4; m++) values[m] = utils::numeric(FLERR, arg[k + m], false, lmp);
    kinds.push_back({values[0], values[1], values[2], values[3]});
  }
  scalar_flag = vector_flag = 1;
  extscalar = 1;
  size_vector = ALL;
  extvector = 0;
  vector = new double[ALL];
}

ComputeRodEnergy::~ComputeRodEnergy()
{
  delete[] vector;
}

void ComputeRodEnergy::init()
{
  if (!atom->quat_flag || !force->bond_style || std::strncmp(force->bond_style, "bpm/rotational", 14) != 0)
    error->all(FLERR, "compute rod/energy needs bond_style bpm/rotational");
  if (!FixSegments::of(lmp)) error->all(FLERR, "compute rod/energy does not know the segments");
}

double ComputeRodEnergy::compute_scalar()
{
  if (invoked_vector != update->ntimestep) compute_vector();
  invoked_scalar = update->ntimestep;
  scalar = vector[STRETCH] + vector[SHEAR] + vector[BEND] + vector[TWIST];
  return scalar;
}

void ComputeRodEnergy::compute_vector()
{
  invoked_vector = update->ntimestep;
  int flag = 0, columns = 0;
  const int index = atom->find_custom(name.c_str(), flag, columns);
  if (index < 0 || flag != 1 || columns != 3) error->all(FLERR, "compute rod/energy needs fix property/atom d2_{} 3", name);
  double **natural = atom->darray[index];
  const std::vector<int> &next = FixSegments::of(lmp)->next;
  double mine[ALL] = {0.0};
  for (int i = 0; i < atom->nlocal; i++) {
    const int j = i < (int) next.size() ? next[i] : -1;
    if (j < 0 || !(atom->mask[i] & groupbit) || !(atom->mask[j] & groupbit)) continue;
    const double *n = natural[i], *q1 = atom->quat[i], *q2 = atom->quat[j];
    const double s = std::sqrt(dot(n, n));
    if (s == 0.0) continue;
    const Kind &kind = kinds[(atom->type[i] - 1) % kinds.size()];
    double r[3], first[3], second[3], mean[3], across[3], turn[3];
    for (int k = 0; k < 3; k++) r[k] = atom->x[j][k] - atom->x[i][k];
    const double length = std::sqrt(dot(r, r));
    turned(q1, n, first);
    turned(q2, n, second);
    for (int k = 0; k < 3; k++) mean[k] = first[k] + second[k];
    cross(r, mean, across);
    const double shear = std::atan2(std::sqrt(dot(across, across)), dot(r, mean));
    between(q2, q1, turn);
    const double twist = dot(turn, r) / length;
    const double bend2 = std::max(0.0, dot(turn, turn) - twist * twist);
    const double ks = 1.0 / (s / kind.kGA + s * s * s / (12.0 * kind.EI));
    mine[STRETCH] += 0.5 * kind.EA / s * (length - s) * (length - s);
    mine[SHEAR] += 0.5 * ks * length * length * shear * shear;
    mine[BEND] += 0.5 * kind.EI / s * bend2;
    mine[TWIST] += 0.5 * kind.GJ / s * twist * twist;
    mine[TURN] = std::max(mine[TURN], std::fabs(twist));
    // what stood up and what lay level across the filament, turned with its beads: rolling tilts them about it
    const double up[3] = {-n[2] * n[0], -n[2] * n[1], n[0] * n[0] + n[1] * n[1]};
    if (up[2] < 1e-12 * s * s) continue;
    double level[3], now_up[3], now_level[3];
    cross(n, up, level);
    for (const double *q : {q1, q2}) {
      turned(q, up, now_up);
      turned(q, level, now_level);
      mine[ROLL] = std::max(mine[ROLL], std::fabs(std::atan2(now_level[2], s * now_up[2])));
    }
  }
  MPI_Allreduce(mine, vector, SUMS, MPI_DOUBLE, MPI_SUM, world);
  MPI_Allreduce(mine + SUMS, vector + SUMS, ALL - SUMS, MPI_DOUBLE, MPI_MAX, world);
}
