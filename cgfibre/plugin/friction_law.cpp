#include "friction_law.h"

#include "error.h"
#include "lammps.h"
#include "table_file.h"

#include <cmath>
#include <cstring>
#include <string>

using namespace cgfibre;
using LAMMPS_NS::LAMMPS;

FrictionLaw FrictionLaw::parse(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  FrictionLaw law;
  if (iarg < narg && std::strcmp(arg[iarg], "angle") == 0) {
    iarg++;
    const std::string file = word(lmp, narg, arg, iarg, "file of friction angle");
    TableFile table(lmp, file, word(lmp, narg, arg, iarg, "keyword of friction angle"));
    for (size_t k = 0; k < table.x.size(); k++) {
      if (table.x[k] < 0 || table.x[k] > 90) table.fail_row(k + 1, "angle", table.x[k], "0 to 90 degrees");
      if (table.y[k] < 0) table.fail_row(k + 1, "coefficient", table.y[k], "at least 0");
    }
    law.curve_ = Curve(table.x, table.y, Curve::CONSTANT);
    if (iarg < narg && std::strcmp(arg[iarg], "ratio") == 0) {
      iarg++;
      law.ratio_ = number(lmp, narg, arg, iarg, "ratio of friction", 0);
      if (law.ratio_ > 1) lmp->error->all(FLERR, "ratio of friction is {}, expected at most 1", law.ratio_);
    }
    return law;
  }
  law.static_ = number(lmp, narg, arg, iarg, "friction coefficient", 0);
  if (iarg < narg && std::strcmp(arg[iarg], "kinetic") == 0) {
    iarg++;
    const double kinetic = number(lmp, narg, arg, iarg, "kinetic friction coefficient", 0);
    if (kinetic > law.static_)
      lmp->error->all(FLERR, "kinetic friction coefficient is {}, expected at most {}, the static one", kinetic,
                      law.static_);
    law.ratio_ = law.static_ > 0 ? kinetic / law.static_ : 1;
  }
  return law;
}

double FrictionLaw::angle_mu(double cos_angle) const
{
  const double c = std::fabs(cos_angle);
  return curve_.value(c < 1 ? std::acos(c) * (180 / 3.14159265358979323846) : 0);
}
