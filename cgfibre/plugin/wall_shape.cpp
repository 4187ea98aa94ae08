#include "wall_shape.h"

#include "error.h"
#include "input.h"
#include "lammps.h"
#include "modify.h"
#include "table_file.h"
#include "update.h"
#include "variable.h"

#include <cmath>

using namespace cgfibre;
using LAMMPS_NS::LAMMPS;

namespace {

constexpr double ANY = -HUGE_VAL;    // no lower bound of a number

int direction(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what)
{
  const std::string name = word(lmp, narg, arg, iarg, what);
  if (name != "x" && name != "y" && name != "z") lmp->error->all(FLERR, "{} is {}, expected x, y or z", what, name);
  return name[0] - 'x';
}

bool choice(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what, const char *yes, const char *no)
{
  const std::string name = word(lmp, narg, arg, iarg, what);
  if (name != yes && name != no) lmp->error->all(FLERR, "{} is {}, expected {} or {}", what, name, yes, no);
  return name == yes;
}

double edge(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what, double open)
{
  if (iarg >= narg || std::string(arg[iarg]) != "INF") return number(lmp, narg, arg, iarg, what, ANY);
  iarg++;
  return open;
}

std::string variable(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what)
{
  const std::string name = word(lmp, narg, arg, iarg, what);
  if (name.compare(0, 2, "v_") != 0) lmp->error->all(FLERR, "{} is {}, expected v_NAME of a variable", what, name);
  return name.substr(2);
}

double evaluate(LAMMPS *lmp, const std::string &name)
{
  return lmp->input->variable->compute_equal(lmp->input->variable->find(name.c_str()));
}

}    // namespace

WallShape WallShape::parse(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  WallShape wall;
  const std::string kind = word(lmp, narg, arg, iarg, "wall");
  if (kind == "plane") {
    wall.kind_ = PLANE;
    wall.axis_ = direction(lmp, narg, arg, iarg, "axis of plane");
    wall.position_[wall.axis_] = number(lmp, narg, arg, iarg, "position of plane", ANY);
    wall.side_ = choice(lmp, narg, arg, iarg, "side of plane", "above", "below") ? 1 : -1;
  } else if (kind == "cylinder") {
    wall.kind_ = CYLINDER;
    wall.axis_ = direction(lmp, narg, arg, iarg, "axis of cylinder");
    for (int c = 0; c < 3; c++)
      if (c != wall.axis_) wall.position_[c] = number(lmp, narg, arg, iarg, "centre of cylinder", ANY);
    wall.radius_ = positive(lmp, narg, arg, iarg, "radius of cylinder");
    wall.side_ = choice(lmp, narg, arg, iarg, "side of cylinder", "outside", "inside") ? 1 : -1;
  } else {
    lmp->error->all(FLERR, "wall is {}, expected plane or cylinder", kind);
  }
  return wall;
}

bool WallShape::keyword(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  const std::string name = arg[iarg];
  int at = iarg + 1;
  if (name == "move") {
    const int c = direction(lmp, narg, arg, at, "direction of move");
    move_[c] = variable(lmp, narg, arg, at, "displacement of move");
  } else if (name == "rotate") {
    if (kind_ != CYLINDER) lmp->error->all(FLERR, "rotate is given for a plane, expected a cylinder");
    rotate_ = variable(lmp, narg, arg, at, "angular velocity of rotate");
  } else if (name == "span") {
    span_ = direction(lmp, narg, arg, at, "direction of span");
    if (kind_ != PLANE || span_ == axis_)
      lmp->error->all(FLERR, "span is given along {}, expected a plane and a direction in it", "xyz"[span_]);
    low_ = edge(lmp, narg, arg, at, "start of span", -HUGE_VAL);
    high_ = edge(lmp, narg, arg, at, "end of span", HUGE_VAL);
    if (high_ <= low_) lmp->error->all(FLERR, "end of span is {}, expected more than its start {}", high_, low_);
  } else {
    return false;
  }
  iarg = at;
  return true;
}

void WallShape::init(LAMMPS *lmp) const
{
  for (const std::string &name : {move_[0], move_[1], move_[2], rotate_}) {
    if (name.empty()) continue;
    const int k = lmp->input->variable->find(name.c_str());
    if (k < 0 || !lmp->input->variable->equalstyle(k))
      lmp->error->all(FLERR, "variable {} of a wall does not exist as one of equal style", name);
  }
}

void WallShape::advance(LAMMPS *lmp, bool setup)
{
  if (move_[0].empty() && move_[1].empty() && move_[2].empty() && rotate_.empty()) return;
  lmp->modify->clearstep_compute();
  for (int c = 0; c < 3; c++) {
    if (move_[c].empty()) continue;
    const double now = evaluate(lmp, move_[c]), change = now - displacement_[c];
    // time from a restart file may differ in its last digit
    if (!setup)
      velocity_[c] = change / lmp->update->dt;
    else if (std::fabs(change) > 1e-6 * lmp->update->dt * std::fabs(velocity_[c]))
      velocity_[c] = 0;
    displacement_[c] = now;
  }
  if (!rotate_.empty()) angular_ = evaluate(lmp, rotate_);
  lmp->modify->addstep_compute(lmp->update->ntimestep + 1);
}

// against a block between LO and HI below height 0: its face, its edges, its sides
Hit WallShape::hit_block(double x, double height) const
{
  Hit hit = {height, {0, 0, 0}, 0};
  const double beyond = x < low_ ? x - low_ : (x > high_ ? x - high_ : 0);
  if (beyond == 0) {
    hit.n[axis_] = side_;
  } else if (height <= 0) {
    hit.gap = std::fabs(beyond);
    hit.n[span_] = beyond > 0 ? 1 : -1;
  } else {
    hit.gap = std::sqrt(beyond * beyond + height * height);
    hit.n[span_] = beyond / hit.gap;
    hit.n[axis_] = side_ * height / hit.gap;
  }
  return hit;
}

Hit WallShape::hit(const double *x) const
{
  if (kind_ == PLANE) {
    const double height = side_ * (x[axis_] - position_[axis_] - displacement_[axis_]);
    if (span_ >= 0) return hit_block(x[span_] - displacement_[span_], height);
    Hit hit = {height, {0, 0, 0}, 0};
    hit.n[axis_] = side_;
    return hit;
  }
  double d[3];
  for (int c = 0; c < 3; c++) d[c] = c == axis_ ? 0 : x[c] - position_[c] - displacement_[c];
  const double r = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  Hit hit = {side_ * (r - radius_), {0, 0, 0}, side_ / radius_};
  for (int c = 0; c < 3; c++) hit.n[c] = r > 0 ? side_ * d[c] / r : 0;
  if (r == 0) hit.n[axis_ == 0 ? 1 : 0] = 1;    // on the axis: any direction
  return hit;
}

void WallShape::velocity(const double *x, double *v) const
{
  for (int c = 0; c < 3; c++) v[c] = velocity_[c];
  if (angular_ == 0) return;
  // angular velocity along the axis x lever
  const int b = (axis_ + 1) % 3, c = (axis_ + 2) % 3;
  v[b] -= angular_ * (x[c] - position_[c] - displacement_[c]);
  v[c] += angular_ * (x[b] - position_[b] - displacement_[b]);
}

void WallShape::get_state(double *state) const
{
  for (int c = 0; c < 3; c++) {
    state[c] = displacement_[c];
    state[3 + c] = velocity_[c];
  }
}

void WallShape::set_state(const double *state)
{
  for (int c = 0; c < 3; c++) {
    displacement_[c] = state[c];
    velocity_[c] = state[3 + c];
  }
}
