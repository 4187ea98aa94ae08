// The styles of the plugin, and what LAMMPS calls when it loads the library.
#include "about.h"
#include "compute_capsule_local.h"
#include "compute_rod_energy.h"
#include "fix_history.h"
#include "fix_segments.h"
#include "fix_disc_support.h"
#include "fix_wall_capsule.h"
#include "fix_wall_granular_table.h"
#include "guard.h"
#include "improper_ribbon.h"
#include "pair_capsule.h"
#include "pair_granular_table.h"

namespace {

using LAMMPS_NS::LAMMPS;

template <class Style> void *create(void *lmp)
{
  return new Style(static_cast<LAMMPS *>(lmp));
}
template <class Style> void *create_of(void *lmp, int narg, char **arg)
{
  return new Style(static_cast<LAMMPS *>(lmp), narg, arg);
}

struct Entry {
  const char *style, *name, *info;
  lammpsplugin_factory1 *plain;
  lammpsplugin_factory2 *of_words;
};

const Entry entries[] = {
    {"command", "cgfibre_plugin", "what the cgfibre plugin is", &create<cgfibre::About>, nullptr},
    {"pair", "capsule", "contact of filaments, segment to segment", &create<cgfibre::PairCapsule>, nullptr},
    {"fix", "wall/capsule", "platen that presses segments", nullptr, &create_of<cgfibre::FixWallCapsule>},
    {"pair", "granular/table", "contact of spheres and discs, tabulated", &create<cgfibre::PairGranularTable>, nullptr},
    {"fix", "wall/granular/table", "wall for granular/table", nullptr, &create_of<cgfibre::FixWallGranularTable>},
    {"fix", "disc/support", "springs, drag of the discs of a section", nullptr, &create_of<cgfibre::FixDiscSupport>},
    {"compute", "capsule/local", "contacts of pair capsule", nullptr, &create_of<cgfibre::ComputeCapsuleLocal>},
    {"compute", "rod/energy", "elastic energy of rods", nullptr, &create_of<cgfibre::ComputeRodEnergy>},
    {"improper", "ribbon", "bending of a ribbon in its plane", &create<cgfibre::ImproperRibbon>, nullptr},
    {"fix", "CGFIBRE/SEGMENTS", "which bead follows which", nullptr, &create_of<cgfibre::FixSegments>},
    {"fix", "CGFIBRE/HISTORY", "histories of contacts", nullptr, &create_of<cgfibre::FixHistory>},
};

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *regfunc)
{
  auto enrol = reinterpret_cast<lammpsplugin_regfunc>(regfunc);
  if (cgfibre::refuse(lmp, handle, enrol)) return;
  for (const Entry &entry : entries) {
    lammpsplugin_t style{};
    style.version = CGFIBRE_LAMMPS_VERSION;
    style.style = entry.style;
    style.name = entry.name;
    style.info = entry.info;
    style.author = "cgfibre";
    style.handle = handle;
    if (entry.plain)
      style.creator.v1 = entry.plain;
    else
      style.creator.v2 = entry.of_words;
    enrol(&style, lmp);
  }
}
