#include "contact_law.h"

#include "error.h"
#include "lammps.h"
#include "table_file.h"

#include <algorithm>
#include <cmath>
#include <string>

using namespace cgfibre;
using LAMMPS_NS::LAMMPS;

namespace {

double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double norm(const double *a) { return std::sqrt(dot(a, a)); }
void scale(double s, double *a)
{
  for (int c = 0; c < 3; c++) a[c] *= s;
}

// into the plane of normal n, its length kept
void turn(double *t, const double *n)
{
  const double before = norm(t), along = dot(t, n);
  for (int c = 0; c < 3; c++) t[c] -= along * n[c];
  const double after = norm(t);
  if (after > 0) scale(before / after, t);
}

void shorten(double *t, double limit)
{
  const double length = norm(t);
  if (length > limit) scale(limit / length, t);
}

}    // namespace

ContactLaw ContactLaw::parse(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  ContactLaw law;
  law.normal_ = NormalLaw::parse(lmp, narg, arg, iarg);
  bool spring = false;
  while (iarg < narg) {
    const std::string name = arg[iarg];
    int at = iarg + 1;
    if (name == "length") {
      law.length_ = positive(lmp, narg, arg, at, "length");
    } else if (name == "damping") {
      law.damping_ = number(lmp, narg, arg, at, "damping", 0);
    } else if (name == "friction") {
      law.friction_ = FrictionLaw::parse(lmp, narg, arg, at);
      if (law.friction_.by_angle())
        lmp->error->all(FLERR, "friction is by angle, expected a number: spheres and discs cross at no angle");
    } else if (name == "tangential") {
      spring = true;
      const std::string kind = word(lmp, narg, arg, at, "kind of tangential spring");
      law.tangential_ratio_ = law.tangential_stiffness_ = 0;
      if (kind == "ratio")
        law.tangential_ratio_ = positive(lmp, narg, arg, at, "ratio of tangential");
      else if (kind == "stiffness")
        law.tangential_stiffness_ = positive(lmp, narg, arg, at, "stiffness of tangential");
      else
        lmp->error->all(FLERR, "tangential spring is {}, expected ratio or stiffness", kind);
      if (at < narg && std::string(arg[at]) == "viscous") {
        at++;
        law.tangential_damping_ = number(lmp, narg, arg, at, "viscous", 0);
      }
    } else if (name == "rolling") {
      law.rolling_stiffness_ = number(lmp, narg, arg, at, "stiffness of rolling", 0);
      law.rolling_damping_ = number(lmp, narg, arg, at, "damping of rolling", 0);
      law.rolling_friction_ = number(lmp, narg, arg, at, "coefficient of rolling", 0);
    } else {
      break;
    }
    iarg = at;
  }
  if (!spring && !law.friction_.none())
    lmp->error->all(FLERR, "friction has no spring, expected also tangential ratio K or tangential stiffness K");
  return law;
}

ContactForce ContactLaw::force(const Contact &contact, double *history, double dt) const
{
  ContactForce out = {0, {0, 0, 0}, {0, 0, 0}};
  const double elastic = length_ * normal_.force(contact.overlap, contact.size, history[DEEPEST]);
  out.normal = std::max(0.0, elastic - damping_ * dot(contact.v, contact.n));
  if (!friction_.none()) friction(contact, out.normal, history, dt, out.t);
  if (rolling_friction_ > 0) rolling(contact, out.normal, history, dt, out.roll);
  return out;
}

void ContactLaw::friction(const Contact &contact, double normal, double *history, double dt, double *t) const
{
  double *spring = history + TANGENT;
  const double vn = dot(contact.v, contact.n);
  double vt[3];
  for (int c = 0; c < 3; c++) vt[c] = contact.v[c] - vn * contact.n[c];
  if (dt > 0) {
    turn(spring, contact.n);
    const double k = tangential_ratio_ > 0
        ? tangential_ratio_ * length_ * normal_.stiffness(contact.overlap, contact.size)
        : tangential_stiffness_;
    if (k < history[STIFFNESS]) scale(k / history[STIFFNESS], spring);
    history[STIFFNESS] = k;
    for (int c = 0; c < 3; c++) spring[c] -= k * dt * vt[c];
  }
  for (int c = 0; c < 3; c++) t[c] = spring[c] - tangential_damping_ * vt[c];
  // while a run is set up, a contact neither starts nor stops to slip
  if (dt > 0) history[SLIPPING] = norm(t) > friction_.limit(history[SLIPPING] != 0) * normal ? 1 : 0;
  const double limit = friction_.limit(history[SLIPPING] != 0) * normal;
  if (history[SLIPPING] != 0) shorten(spring, limit);
  shorten(t, limit);
}

void ContactLaw::rolling(const Contact &contact, double normal, double *history, double dt, double *t) const
{
  double *spring = history + ROLLING;
  if (dt > 0) {
    turn(spring, contact.n);
    for (int c = 0; c < 3; c++) spring[c] -= rolling_stiffness_ * dt * contact.roll[c];
  }
  const double limit = rolling_friction_ * normal;
  for (int c = 0; c < 3; c++) t[c] = spring[c] - rolling_damping_ * contact.roll[c];
  if (norm(t) > limit) {
    shorten(spring, limit);
    shorten(t, limit);
  }
}

void ContactLaw::mirror(const double *history, double *mirrored)
{
  std::copy(history, history + VALUES, mirrored);
  scale(-1, mirrored + TANGENT);    // the rolling spring is the same from both sides: R_eff (w1 - w2) x n
}
