// What LAMMPS calls when it loads the library.
#include "tables.h"

#include "lammps.h"

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *regfunc)
{
  lammpsplugin_t stem = {};
  stem.version = static_cast<LAMMPS_NS::LAMMPS *>(lmp)->version;
  stem.author = "cgfibre";
  stem.handle = handle;
  cgfibre::enrol_tables(stem, reinterpret_cast<lammpsplugin_regfunc>(regfunc), lmp);
}
