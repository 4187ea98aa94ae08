#include "tables.h"

#include "fix_history.h"
#include "fix_wall_granular_table.h"
#include "pair_granular_table.h"

using LAMMPS_NS::LAMMPS;

namespace {

void *pair(void *lmp) { return new cgfibre::PairGranularTable(static_cast<LAMMPS *>(lmp)); }

template <class Style> void *fix(void *lmp, int narg, char **arg)
{
  return new Style(static_cast<LAMMPS *>(lmp), narg, arg);
}

}    // namespace

void cgfibre::enrol_tables(const lammpsplugin_t &stem, lammpsplugin_regfunc enrol, void *lmp)
{
  lammpsplugin_t style = stem;
  style.style = "pair";
  style.name = "granular/table";
  style.info = "spheres and discs with a tabulated normal force, friction and rolling";
  style.creator.v1 = &pair;
  enrol(&style, lmp);

  style.style = "fix";
  style.name = "wall/granular/table";
  style.info = "walls for pair granular/table";
  style.creator.v2 = &fix<FixWallGranularTable>;
  enrol(&style, lmp);

  style.name = "CGFIBRE/HISTORY";
  style.info = "histories of contacts";
  style.creator.v2 = &fix<FixHistory>;
  enrol(&style, lmp);
}
