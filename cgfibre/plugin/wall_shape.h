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
//   plane x|y|z AT above|below               the bodies are above or below AT
//   cylinder x|y|z C1 C2 R outside|inside    its axis, which passes through C1, C2 in the other two directions (x: y z,
//                                            y: x z, z: x y); where the bodies are
// Keywords:
//   move x|y|z v_NAME                        displacement (um) from the place above, an equal-style variable
//   rotate v_NAME                            of a cylinder: angular velocity about its axis (rad/us), a variable too
//   span x|y|z LO HI                         a plane ends there: a block with edges and sides; INF: no end
//
// Velocities are those of the displacement from step to step.
class WallShape {
 public:
  static WallShape parse(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);
  // a keyword of those above with its values; false, and nothing is moved, if it is none
  bool keyword(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);

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
  int span_ = -1;    // direction in which a plane ends at low_ and high_, -1: it does not
  double low_ = 0, high_ = 0;
  std::string move_[3], rotate_;    // names of variables
  double displacement_[3] = {0, 0, 0}, velocity_[3] = {0, 0, 0}, angular_ = 0;

  Hit hit_block(double x, double height) const;
};

}    // namespace cgfibre

#endif
