#ifndef CGFIBRE_FRICTION_LAW_H
#define CGFIBRE_FRICTION_LAW_H

#include "curve.h"

namespace LAMMPS_NS {
class LAMMPS;
}

namespace cgfibre {

// Coefficient of friction mu, the limit of tangential over normal force. Words:
//
//   MU                             one coefficient
//   MU kinetic MU_K                static MU, kinetic MU_K <= MU
//   angle FILE KEYWORD [ratio R]   static mu against the crossing angle (degrees, 0 parallel, 90 square; monotone cubic
//                                  between the rows, constant beyond them), kinetic R times it, 0 <= R <= 1
//
// A contact that sticks slips once its tangential force exceeds mu_static N; it then carries mu_kinetic N, and sticks
// again as soon as the spring's force falls below that.
class FrictionLaw {
 public:
  FrictionLaw() = default;

  // words of a LAMMPS command from arg[iarg] on, which is moved behind the law
  static FrictionLaw parse(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);

  // mu of two lines at this cosine (its sign is of no account)
  double limit(double cos_angle, bool slipping) const
  {
    const double mu = by_angle() ? angle_mu(cos_angle) : static_;
    return slipping ? mu * ratio_ : mu;
  }
  double limit(bool slipping) const { return slipping ? static_ * ratio_ : static_; }    // without an angle

  bool by_angle() const { return !curve_.empty(); }
  bool has_kinetic() const { return ratio_ != 1; }
  bool none() const { return static_ == 0 && !by_angle(); }

 private:
  double static_ = 0, ratio_ = 1;
  Curve curve_;

  double angle_mu(double cos_angle) const;
};

}    // namespace cgfibre

#endif
