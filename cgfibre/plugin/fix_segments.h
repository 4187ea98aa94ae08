// fix CGFIBRE/SEGMENTS: which bead follows which along a filament, known for owned and ghost beads.
// Made by pair capsule and fix wall/capsule themselves; users never name it.

#ifndef CGFIBRE_FIX_SEGMENTS_H
#define CGFIBRE_FIX_SEGMENTS_H

#include "fix.h"

#include <vector>

namespace cgfibre {

class FixSegments : public LAMMPS_NS::Fix {
 public:
  FixSegments(LAMMPS_NS::LAMMPS *, int, char **);
  ~FixSegments() override;

  // the one of this run, made where there is none yet
  static FixSegments *of(LAMMPS_NS::LAMMPS *);

  int setmask() override;
  void init() override;
  void setup_post_neighbor() override;
  void post_neighbor() override;
  double memory_usage() override;
  void grow_arrays(int) override;
  void copy_arrays(int, int, int) override;
  void set_arrays(int) override;
  int pack_exchange(int, double *) override;
  int unpack_exchange(int, double *) override;
  int pack_border(int, int *, double *) override;
  int unpack_border(int, int, double *) override;

  // index of the bead behind bead i along its filament (the image next to it), -1: none; owned and ghost beads
  std::vector<int> next;
  double longest;    // bonds at the last reneighbouring, um, of all ranks

 private:
  double *following;    // tag of the next bead, 0: none (a double, as it travels with atoms)
  bool known;

  void read_bonds();
};

}    // namespace cgfibre

#endif
