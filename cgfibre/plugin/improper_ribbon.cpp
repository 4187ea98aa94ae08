#include "improper_ribbon.h"

#include "atom.h"
#include "comm.h"
#include "error.h"
#include "force.h"
#include "memory.h"
#include "neighbor.h"
#include "table_file.h"
#include "utils.h"
#include "vector3.h"

#include <cmath>

using namespace cgfibre;
using namespace LAMMPS_NS;

ImproperRibbon::ImproperRibbon(LAMMPS *lmp) : Improper(lmp)
{
  writedata = 1;
}

ImproperRibbon::~ImproperRibbon()
{
  if (allocated) memory->destroy(setflag);
}

void ImproperRibbon::allocate()
{
  if (allocated) return;
  allocated = 1;
  const int n = atom->nimpropertypes + 1;
  memory->create(setflag, n, "improper:setflag");
  for (int type = 0; type < n; type++) setflag[type] = 0;
  stiffness_.assign(n, 0);
  rest_.assign(n, 0);
}

void ImproperRibbon::coeff(int narg, char **arg)
{
  if (narg != 3) error->all(FLERR, "improper_coeff of style ribbon takes TYPE K Q0, not {} words", narg);
  allocate();
  int low, high, at = 1;
  utils::bounds(FLERR, arg[0], 1, atom->nimpropertypes, low, high, error);
  const double k = number(lmp, narg, arg, at, "stiffness of improper_style ribbon", 0);
  const double q0 = number(lmp, narg, arg, at, "turn at rest of improper_style ribbon", -2);
  for (int type = low; type <= high; type++) {
    stiffness_[type] = k;
    rest_[type] = q0;
    setflag[type] = 1;
  }
}

void ImproperRibbon::compute(int eflag, int vflag)
{
  ev_init(eflag, vflag);
  double **x = atom->x, **f = atom->f;
  const int nlocal = atom->nlocal, newton = force->newton_bond;
  for (int n = 0; n < neighbor->nimproperlist; n++) {
    const int *four = neighbor->improperlist[n];
    const int i1 = four[0], i2 = four[1], i3 = four[2], i4 = four[3], type = four[4];
    // unit vectors t1, t2, e and the lengths of what they come from; lists hold the images next to each other
    double t1[3], t2[3], e[3];
    for (int c = 0; c < 3; c++) {
      t1[c] = x[i2][c] - x[i1][c];
      t2[c] = x[i3][c] - x[i2][c];
      e[c] = x[i4][c] - x[i2][c];
    }
    const double before = std::sqrt(dot(t1, t1)), behind = std::sqrt(dot(t2, t2)), across = std::sqrt(dot(e, e));
    if (!(before > 0 && behind > 0 && across > 0))
      error->one(FLERR, "improper_style ribbon: beads {} {} {} {} coincide", atom->tag[i1], atom->tag[i2],
                 atom->tag[i3], atom->tag[i4]);
    double turn[3];
    for (int c = 0; c < 3; c++) {
      t1[c] /= before;
      t2[c] /= behind;
      e[c] /= across;
      turn[c] = t2[c] - t1[c];
    }
    const double along1 = dot(e, t1), along2 = dot(e, t2), q = dot(e, turn), dq = q - rest_[type];
    const double pull = -stiffness_[type] * dq;
    // -dE/dx: t, e turn with their ends; the middle bead takes the rest, so neither force nor moment is left over
    double f1[3], f3[3], f4[3];
    for (int c = 0; c < 3; c++) {
      f1[c] = pull * (e[c] - along1 * t1[c]) / before;
      f3[c] = pull * (e[c] - along2 * t2[c]) / behind;
      f4[c] = pull * (turn[c] - q * e[c]) / across;
    }
    for (int c = 0; c < 3; c++) {
      if (newton || i1 < nlocal) f[i1][c] += f1[c];
      if (newton || i2 < nlocal) f[i2][c] -= f1[c] + f3[c] + f4[c];
      if (newton || i3 < nlocal) f[i3][c] += f3[c];
      if (newton || i4 < nlocal) f[i4][c] += f4[c];
    }
    if (evflag) {
      const double *a = x[i1], *b = x[i2], *c = x[i3], *d = x[i4];
      ev_tally(i1, i2, i3, i4, nlocal, newton, 0.5 * stiffness_[type] * dq * dq, f1, f3, f4, a[0] - b[0], a[1] - b[1],
               a[2] - b[2], c[0] - b[0], c[1] - b[1], c[2] - b[2], d[0] - c[0], d[1] - c[1], d[2] - c[2]);
    }
  }
}

void ImproperRibbon::write_restart(FILE *fp)
{
  fwrite(&stiffness_[1], sizeof(double), atom->nimpropertypes, fp);
  fwrite(&rest_[1], sizeof(double), atom->nimpropertypes, fp);
}

void ImproperRibbon::read_restart(FILE *fp)
{
  allocate();
  const int n = atom->nimpropertypes;
  if (comm->me == 0) {
    utils::sfread(FLERR, &stiffness_[1], sizeof(double), n, fp, nullptr, error);
    utils::sfread(FLERR, &rest_[1], sizeof(double), n, fp, nullptr, error);
  }
  MPI_Bcast(&stiffness_[1], n, MPI_DOUBLE, 0, world);
  MPI_Bcast(&rest_[1], n, MPI_DOUBLE, 0, world);
  for (int type = 1; type <= n; type++) setflag[type] = 1;
}

void ImproperRibbon::write_data(FILE *fp)
{
  for (int type = 1; type <= atom->nimpropertypes; type++)
    fprintf(fp, "%d %.17g %.17g\n", type, stiffness_[type], rest_[type]);
}
