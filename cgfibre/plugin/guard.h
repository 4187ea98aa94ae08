// LAMMPS has no stable binary interface: in a build of another version, MPI or integer size a plugin computes wrong
// forces or crashes, and LAMMPS only prints a line. This asks the host, by its C functions alone (whose interface is
// stable), what it is, before any style is registered.
#ifndef CGFIBRE_GUARD_H
#define CGFIBRE_GUARD_H

#include "lammpsplugin.h"

#include "lmptype.h"

#include <dlfcn.h>
#include <mpi.h>

#include <cstdio>
#include <cstring>
#include <string>

#ifndef CGFIBRE_LAMMPS_VERSION
#error "name the LAMMPS that this is for: -DCGFIBRE_LAMMPS_VERSION='\"22 Jul 2025\"' (the Makefile here does)"
#endif
#ifndef CGFIBRE_SOURCES
#define CGFIBRE_SOURCES "by hand"
#endif

namespace cgfibre {

// "22 Jul 2025" as lammps_version() says it: 20250722; 0 for anything else
inline int date_number(const char *text)
{
  static const char months[] = "JanFebMarAprMayJunJulAugSepOctNovDec";
  int day = 0, year = 0;
  char month[4] = "";
  if (std::sscanf(text, "%d %3s %d", &day, month, &year) != 3) return 0;
  const char *at = std::strstr(months, month);
  return at ? year * 10000 + (int((at - months) / 3) + 1) * 100 + day : 0;
}

inline const char *mpi_here()
{
#if defined(OPEN_MPI)
  return "Open MPI";
#elif defined(MPI_STUBS)
  return "STUBS";
#else
  return "MPICH";
#endif
}

// handles are int in MPICH and its kin, pointers in Open MPI
inline const char *mpi_named(const char *library_version)
{
  if (std::strstr(library_version, "Open MPI")) return "Open MPI";
  if (std::strstr(library_version, "STUBS")) return "STUBS";
  return "MPICH";
}

// why this library must not serve the LAMMPS that loads it; empty if it may
inline std::string misfit(void *lmp)
{
  auto version = reinterpret_cast<int (*)(void *)>(dlsym(RTLD_DEFAULT, "lammps_version"));
  if (version && version(lmp) != date_number(CGFIBRE_LAMMPS_VERSION))
    return "built for LAMMPS " CGFIBRE_LAMMPS_VERSION ", not for " + std::to_string(version(lmp));
  auto setting = reinterpret_cast<int (*)(void *, const char *)>(dlsym(RTLD_DEFAULT, "lammps_extract_setting"));
  if (setting &&
      (setting(lmp, "tagint") != int(sizeof(LAMMPS_NS::tagint)) ||
       setting(lmp, "imageint") != int(sizeof(LAMMPS_NS::imageint)) ||
       setting(lmp, "bigint") != int(sizeof(LAMMPS_NS::bigint))))
    return "built for other integer sizes (LAMMPS_SMALLBIG, LAMMPS_BIGBIG)";
  auto library = reinterpret_cast<int (*)(char *, int *)>(dlsym(RTLD_DEFAULT, "MPI_Get_library_version"));
  if (library) {
    static char name[16384];  // more than any MPI_MAX_LIBRARY_VERSION_STRING
    int length = 0;
    library(name, &length);
    if (std::strcmp(mpi_named(name), mpi_here()) != 0)
      return std::string("built with ") + mpi_here() + ", not with " + mpi_named(name);
  }
  return "";
}

// true, with the reason in the log, if this library must not serve this LAMMPS
inline bool refuse(void *lmp, void *handle, lammpsplugin_regfunc enrol)
{
  static std::string why;
  why = misfit(lmp);
  if (why.empty()) return false;
  why = "NOT LOADED: cgfibre plugin " + why;
  // a kind of style that does not exist: LAMMPS logs what is said here and keeps nothing of it
  lammpsplugin_t nothing = {CGFIBRE_LAMMPS_VERSION, "refused", "cgfibre", why.c_str(), "cgfibre", {nullptr}, handle};
  enrol(&nothing, lmp);
  return true;
}

}    // namespace cgfibre

#endif
