// Contacts of smooth filaments eight at a time, on the widest vector registers that the processor has.
//
// The kernels (capsule_kernel.h) are compiled once for each set of instructions. A lane's result does not depend on what
// the others hold, nor on its place.

#ifndef CGFIBRE_CAPSULE_LANES_H
#define CGFIBRE_CAPSULE_LANES_H

#include "normal_law.h"

namespace cgfibre {

constexpr int LANES = 8;
constexpr double GAUSS = 0.57735026918962576;    // 1/sqrt(3)

struct alignas(64) Segment {
  double x[3], t[3], length, radius;          // first bead, direction to the second
  double before[3], after[3], inverse, end;   // normals of the planes at its ends; 1/length; 1 where no segment follows
  double v[3], dv[3], unused[2];              // velocity at the first bead, and from the first to the second
};

// Whether segments A (of the lower molecules, or either way) meet segments B, and between which arc lengths of A. The
// squared distance of A's point at arc length s from B's axis is a parabola in s, so the stretch in contact has closed
// limits.
struct MeetLanes {
  const Segment *A[LANES], *B[LANES];
  alignas(64) double lo[LANES], hi[LANES];
};

// Forces of stretches in contact.
struct PressLanes {
  static constexpr int HISTORY = 6;    // friction spring (3), whether it slips, deepest overlap at the two points

  const Segment *A[LANES], *B[LANES];
  alignas(64) double lo[LANES], hi[LANES];
  const NormalLaw *law[LANES];
  bool line;    // all laws are the line law without unloading
  alignas(64) double modulus[LANES];    // E* of the line law, 0 of others
  alignas(64) double damping[LANES];       // nN us/um a um of contact
  alignas(64) double tangential[LANES], sliding[LANES];    // tangential over normal stiffness and damping
  alignas(64) double friction[LANES], kinetic[LANES];      // coefficient as it is now, and of a contact that slips
  double *history[LANES];
  const double *omega[4][LANES];    // of the beads, where they turn with the filament
  double dt;
  bool on_second_axis;    // friction acts there, not where the surfaces touch
  bool advance, energy;

  alignas(64) double force[4][3][LANES], torque[4][3][LANES];    // on first and second bead of A, of B
  alignas(64) double normal[LANES], length[LANES], distance[LANES], cosine[LANES], slips[LANES];
  alignas(64) double friction_force[3][LANES], point[3][LANES];
  alignas(64) double share[LANES], lens[LANES], overlap[3][LANES];    // for the energy, at its three points
};

struct LaneKernels {
  const char *lanes;    // a register: two, four, eight
  unsigned (*meet)(MeetLanes &);    // bits of the lanes that meet
  void (*press)(PressLanes &);
  void (*press_spin)(PressLanes &);    // with couples on beads that turn
};

extern const LaneKernels LANES_BASE, LANES_AVX2, LANES_AVX512;
// the widest that this processor has, or what the environment variable CGFIBRE_LANES names (two, four, eight: the same
// rounding on machines of different kinds); null where this processor has not got that
const LaneKernels *lane_kernels();

// lane by lane what has no vector form: other laws than the line law, Hertz' shape, directions of axes that meet
void law_of_lanes(PressLanes &, int point, int first, int count, const double *overlap, const double *size, double *elastic);
void shape_of_lanes(int count, double *sin2);
void across_of_lanes(const PressLanes &, int lane, double *way);

}    // namespace cgfibre

#endif
