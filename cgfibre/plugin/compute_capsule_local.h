// compute capsule/local: one row a touching pair of segments, on any number of ranks.

#ifndef CGFIBRE_COMPUTE_CAPSULE_LOCAL_H
#define CGFIBRE_COMPUTE_CAPSULE_LOCAL_H

#include "compute.h"

#include <array>
#include <vector>

namespace cgfibre {

// Columns: 1, 2 tags of the segments' first beads (filament of the lower molecule first), 3, 4 molecules, 5 normal force,
// 6-8 friction on the first filament, 9-11 whole force on it, 12-14 where they touch, 15 length of contact, 16 least
// distance of the axes, 17 angle between them (degrees), 18 energy, 19 whether it slips. nN, um, nN um.
class ComputeCapsuleLocal : public LAMMPS_NS::Compute {
 public:
  ComputeCapsuleLocal(LAMMPS_NS::LAMMPS *, int, char **);
  void init() override;
  void compute_local() override;
  double memory_usage() override;

 private:
  static constexpr int COLUMNS = 19;
  std::vector<std::array<double, COLUMNS>> contacts;
  std::vector<double *> lines;
};

}    // namespace cgfibre

#endif
