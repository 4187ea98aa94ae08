#ifndef CGFIBRE_WALL_SHAPE_H
#define CGFIBRE_WALL_SHAPE_H

#include <string>

namespace LAMMPS_NS {
class LAMMPS;
}

namespace cgfibre {

// Where a point stands against a wall.
struct Hit {
  double gap;          // distance from the surface, negative inside the wall
  double n[3];         // unit normal out of the wall
  double curvature;    // of the surface across the contact: 0 plane, 1/R on a cylinder, -1/R in one
};

// A rigid wall that may move. Words:
//
//   plane x|y|z POS lo|hi [span LO HI]      the wall fills the side below (lo) or above (hi) POS; with span it is a
//                                           block, LO <= x <= HI (planes y, z), with edges and sides
//   cylinder x|y|z C1 C2 R in|out           axis, its place in the other two directions (x: y z, y: x z, z: x y); the
//                                           free space is in it or out of it
//   ... [move x|y|z v_NAME] ... [spin v_NAME]
//                                           displacement (um) from the place above and, of a cylinder, angular velocity
//                                           about its axis (rad/us), equal-style variables
//
// Velocities are those of the displacement from step to step.
class WallShape {
 public:
  static WallShape parse(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);

  Hit hit(const double *x) const;
  void velocity(const double *x, double *v) const;    // of the wall at a point of its surface

  // variables exist and are of equal style
  void init(LAMMPS_NS::LAMMPS *lmp) const;
  // to this step's place; `setup`: no time has passed since, the velocity stays as it was where the place did
  void advance(LAMMPS_NS::LAMMPS *lmp, bool setup);

  // what a restart needs: displacement and velocity
  static constexpr int STATE = 6;
  void get_state(double *state) const;
  void set_state(const double *state);

 private:
  enum Kind { PLANE, CYLINDER };
  Kind kind_ = PLANE;
  int axis_ = 2;
  double position_[3] = {0, 0, 0};    // of the plane along its axis, of the cylinder's axis
  double side_ = 1;                   // plane: normal along +axis or -axis; cylinder: +1 free space outside
  double radius_ = 0;
  bool block_ = false;
  double low_ = 0, high_ = 0;
  std::string move_[3], spin_;    // names of variables
  double displacement_[3] = {0, 0, 0}, velocity_[3] = {0, 0, 0}, angular_ = 0;

  Hit hit_block(double x, double height) const;
};

}    // namespace cgfibre

#endif
