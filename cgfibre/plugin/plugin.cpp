// The styles of the plugin, and what LAMMPS calls when it loads the library.
#include "about.h"
#include "guard.h"

namespace {

using LAMMPS_NS::LAMMPS;

template <class Style> void *create(void *lmp) { return new Style(static_cast<LAMMPS *>(lmp)); }

struct Entry {
  const char *style, *name, *info;
  lammpsplugin_factory1 *creator;
};

const Entry entries[] = {
    {"command", "cgfibre_plugin", "what the cgfibre plugin is", &create<cgfibre::About>},
};

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *regfunc)
{
  auto enrol = reinterpret_cast<lammpsplugin_regfunc>(regfunc);
  if (cgfibre::refuse(lmp, handle, enrol)) return;
  for (const Entry &entry : entries) {
    lammpsplugin_t style = {CGFIBRE_LAMMPS_VERSION, entry.style, entry.name, entry.info, "cgfibre", {entry.creator},
                            handle};
    enrol(&style, lmp);
  }
}
