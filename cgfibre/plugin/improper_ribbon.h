#ifndef CGFIBRE_IMPROPER_RIBBON_H
#define CGFIBRE_IMPROPER_RIBBON_H

#include "improper.h"

#include <cstdio>
#include <vector>

namespace cgfibre {

// improper_style ribbon, improper_coeff TYPE K Q0: bending of a ribbon of parallel chains in its own plane.
//
// Atoms 1, 2, 3 follow each other along one chain, atom 4 stands beside atom 2 on the next. With the unit vectors t1
// from 1 to 2, t2 from 2 to 3 and e from 2 to 4,
//   E = K/2 (q - Q0)^2,  q = (t2 - t1) . e :
// the part of the chain's turn (rad) that lies in the plane of the ribbon. Turns out of it cost nothing, chains may
// slide along each other.
class ImproperRibbon : public LAMMPS_NS::Improper {
 public:
  explicit ImproperRibbon(LAMMPS_NS::LAMMPS *);
  ~ImproperRibbon() override;
  void compute(int eflag, int vflag) override;
  void coeff(int narg, char **arg) override;
  void write_restart(FILE *) override;
  void read_restart(FILE *) override;
  void write_data(FILE *) override;

 private:
  std::vector<double> stiffness_, rest_;    // of types, from 1

  void allocate();
};

}    // namespace cgfibre

#endif
