// compute rod/energy: elastic energy of rods (bond_style bpm/rotational reports none), and how far they have turned.

#ifndef CGFIBRE_COMPUTE_ROD_ENERGY_H
#define CGFIBRE_COMPUTE_ROD_ENERGY_H

#include "compute.h"

#include <string>
#include <vector>

namespace cgfibre {

// compute ID group rod/energy NAME EA EI GJ kGA [EA EI GJ kGA ...]
//
// NAME: a fix property/atom d2_NAME 3 holds the natural (stress-free) vector from every bead to the one behind it along
// its filament. A set of constants a kind of filament, kind k of n being the atom types k, k + n, k + 2 n ... Segments
// count whose beads are both in the group.
//
// A segment of natural length s, between beads turned by q1 and q2 since its natural shape: stretch EA/s (r - s)^2/2;
// bending EI/s and twist GJ/s times half the square of the parts of log(q2 q1^-1) across and along it; shear by the angle
// g between the segment and the mean of its natural direction turned by q1 and by q2, ks (r g)^2/2 with 1/ks = s/kGA +
// s^3/(12 EI). The engine's own force law to second order in the turn of one segment.
//
// c_ID: their sum; c_ID[1-4]: stretch, shear, bending, twist (nN um); c_ID[5]: largest roll of a bead, rad up to pi: the
// angle about the filament by which what lay level across it has tilted (z is up); c_ID[6]: largest twist of one
// segment, rad.
class ComputeRodEnergy : public LAMMPS_NS::Compute {
 public:
  ComputeRodEnergy(LAMMPS_NS::LAMMPS *, int, char **);
  ~ComputeRodEnergy() override;
  void init() override;
  double compute_scalar() override;
  void compute_vector() override;

 private:
  enum { STRETCH, SHEAR, BEND, TWIST, SUMS, ROLL = SUMS, TURN, ALL };
  struct Kind {
    double EA, EI, GJ, kGA;
  };
  std::vector<Kind> kinds;
  std::string name;
};

}    // namespace cgfibre

#endif
