// fix wall/capsule: a platen that presses segments of filaments, not beads: a plane, or a cylinder from out- or inside,
// that may move and may end at sharp edges.

#ifndef CGFIBRE_FIX_WALL_CAPSULE_H
#define CGFIBRE_FIX_WALL_CAPSULE_H

#include "fix.h"

#include "friction_law.h"
#include "normal_law.h"

#include <string>

namespace cgfibre {

class FixSegments;

class FixWallCapsule : public LAMMPS_NS::Fix {
 public:
  FixWallCapsule(LAMMPS_NS::LAMMPS *, int, char **);
  ~FixWallCapsule() override;

  int setmask() override;
  void init() override;
  void setup_pre_reverse(int, int) override;
  void pre_reverse(int, int) override;
  double compute_scalar() override;
  double compute_vector(int) override;
  double memory_usage() override;
  void grow_arrays(int) override;
  void copy_arrays(int, int, int) override;
  void set_arrays(int) override;
  int pack_exchange(int, double *) override;
  int unpack_exchange(int, double *) override;
  int pack_restart(int, double *) override;
  void unpack_restart(int, int) override;
  int size_restart(int) override;
  int maxsize_restart() override;

 private:
  enum Shape { PLANE, CYLINDER };
  struct Stretch {
    double lo, hi;
  };
  struct Filament {    // the segment at hand
    double x[3], t[3], length, radius, v[3], dv[3];
    int first, second;
  };

  Shape shape;
  int axis;             // across the plane, or along the cylinder
  double place[3];      // a point of the plane, or of the cylinder's axis, before it moves
  double side;          // plane: +1 filaments lie above, -1 below; cylinder: +1 outside, -1 inside
  double cylinder;      // radius, um
  int move_axis, move_variable;    // -1: it stands still
  std::string move_name;
  int span_axis;                   // -1: no edges
  double span_lo, span_hi;
  NormalLaw law;
  FrictionLaw friction;
  double damping, tangential, sliding;
  bool spin;

  FixSegments *chain;
  double **history;     // two stretches a segment, at its first bead
  double shift, speed;
  double total[7];      // of this rank: force on the filaments xyz, length of contact, energy, least distance, contacts
  double sum[7];
  bool summed;

  void parse(int, char **);
  void press(bool);
  int stretches(const Filament &, Stretch *) const;
  void normal_at(const double *, double &, double *) const;
  void push(const Filament &, const Stretch &, double *, bool);
  void gather();
};

}    // namespace cgfibre

#endif
