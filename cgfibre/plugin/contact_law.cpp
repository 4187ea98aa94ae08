#include "contact_law.h"

#include "friction_spring.h"
#include "table_file.h"
#include "vector3.h"

#include "error.h"
#include "lammps.h"

#include <algorithm>
#include <string>

using namespace cgfibre;
using LAMMPS_NS::LAMMPS;

ContactLaw ContactLaw::parse(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  ContactLaw law;
  law.normal_ = NormalLaw::parse(lmp, narg, arg, iarg);
  return law;
}

bool ContactLaw::keyword(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  const std::string name = arg[iarg];
  int at = iarg + 1;
  if (name == "length") {
    length_ = positive(lmp, narg, arg, at, "length");
  } else if (name == "damping") {
    damping_ = number(lmp, narg, arg, at, "damping", 0);
  } else if (name == "friction") {
    friction_ = FrictionLaw::parse(lmp, narg, arg, at);
    if (friction_.by_angle())
      lmp->error->all(FLERR, "friction is by angle, expected a number: spheres and discs cross at no angle");
  } else if (name == "tangential") {
    absolute_ = at < narg && std::string(arg[at]) == "stiffness";
    if (absolute_) at++;
    tangential_ = positive(lmp, narg, arg, at, "stiffness of tangential");
    sliding_ = number(lmp, narg, arg, at, "damping ratio of tangential", 0);
  } else if (name == "rolling") {
    rolling_stiffness_ = number(lmp, narg, arg, at, "stiffness of rolling", 0);
    rolling_damping_ = number(lmp, narg, arg, at, "damping of rolling", 0);
    rolling_friction_ = number(lmp, narg, arg, at, "coefficient of rolling", 0);
  } else {
    return false;
  }
  iarg = at;
  return true;
}

ContactForce ContactLaw::force(const Contact &contact, double *history, double dt) const
{
  ContactForce out = {0, {0, 0, 0}, {0, 0, 0}};
  const double elastic = length_ * normal_.force(contact.overlap, contact.size, history[DEEPEST]);
  out.normal = std::max(0.0, elastic - damping_ * dot(contact.v, contact.n));
  if (!friction_.none()) slide(contact, out.normal, history, dt, out.t);
  if (rolling_friction_ > 0) {
    const double limit = rolling_friction_ * out.normal;
    const FrictionSpring spring = {rolling_stiffness_, rolling_damping_, limit, limit};
    pull(spring, contact.n, contact.roll, dt, history + ROLLING, dt > 0, out.roll);
  }
  return out;
}

void ContactLaw::slide(const Contact &contact, double normal, double *history, double dt, double *t) const
{
  const double vn = dot(contact.v, contact.n);
  double vt[3];
  for (int c = 0; c < 3; c++) vt[c] = contact.v[c] - vn * contact.n[c];
  const double k =
      absolute_ ? tangential_ : tangential_ * length_ * normal_.stiffness(contact.overlap, contact.size);
  double *spring = history + SLIDING;
  if (k > history[STIFFNESS])
    for (int c = 0; c < 3; c++) spring[c] *= history[STIFFNESS] / k;
  history[STIFFNESS] = k;
  const FrictionSpring law = {k, sliding_ * damping_, friction_.limit(history[SLIPPING] != 0) * normal,
                              friction_.limit(true) * normal};
  pull(law, contact.n, vt, dt, spring, dt > 0, t);
}

void ContactLaw::mirror(const double *history, double *mirrored)
{
  std::copy(history, history + VALUES, mirrored);
  // the rolling spring is the same from both sides: R_eff (w1 - w2) x n
  for (int c = 0; c < 3; c++) mirrored[SLIDING + c] = -history[SLIDING + c];
}
