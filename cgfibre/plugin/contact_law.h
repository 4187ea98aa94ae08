#ifndef CGFIBRE_CONTACT_LAW_H
#define CGFIBRE_CONTACT_LAW_H

#include "friction_law.h"
#include "normal_law.h"

namespace cgfibre {

// One contact as it is now. The first body feels the forces below, the second their opposite.
struct Contact {
  double overlap, size;    // um; `size` of the line law, see NormalLaw
  double n[3];             // unit normal towards the first body
  double v[3];             // velocity of the first body's surface at the contact less that of the second's
  double roll[3];          // rolling velocity R_eff (omega_1 - omega_2) x n
};

struct ContactForce {
  double normal;     // along n, never below 0
  double t[3];       // tangential, friction
  double roll[3];    // gives the torque R_eff n x roll
};

// All forces of a contact of spheres, discs and walls. Words:
//
//   LAW                                     see NormalLaw
//   length L                                the law's force times L (um): depth of discs, length of cylinders
//   damping G                               N = max(0, F - G v_n): never adhesion
//   friction MU ...                         see FrictionLaw (not by angle), of the full N, damping included
//   tangential ratio K | stiffness K [viscous G]
//                                           spring of friction: K times the secant of the loading curve, or K (nN/um)
//   rolling K G MU                          spring, dashpot and limit MU N of the rolling velocity
//
// Friction: the spring's force T turns with the contact plane (projected, its length kept), grows by -k v_t dt and is
// kept within the limit; a spring that softens lets its force down with it (Thornton, Cummins, Cleary 2013), so that it
// never makes energy. The force is T - G v_t, within the limit mu N. Rolling alike.
class ContactLaw {
 public:
  // what a contact remembers: T (3), slipping, deepest overlap, k, force of the rolling spring (3)
  enum { TANGENT = 0, SLIPPING = 3, DEEPEST = 4, STIFFNESS = 5, ROLLING = 6, VALUES = 9 };

  ContactLaw() = default;
  // words of a LAMMPS command from arg[iarg] on, which is moved to the first word that is none of the above
  static ContactLaw parse(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);

  // `history` moves on by dt; with dt = 0 (set-up of a run) the forces as they stand
  ContactForce force(const Contact &contact, double *history, double dt) const;
  double energy(double overlap, double size) const { return length_ * normal_.energy(overlap, size); }
  bool none() const { return normal_.kind() == NormalLaw::NONE; }

  // the history as the second body sees it
  static void mirror(const double *history, double *mirrored);

 private:
  NormalLaw normal_;
  FrictionLaw friction_;
  double length_ = 1, damping_ = 0;
  double tangential_ratio_ = 0, tangential_stiffness_ = 0, tangential_damping_ = 0;
  double rolling_stiffness_ = 0, rolling_damping_ = 0, rolling_friction_ = 0;

  void friction(const Contact &contact, double normal, double *history, double dt, double *t) const;
  void rolling(const Contact &contact, double normal, double *history, double dt, double *t) const;
};

}    // namespace cgfibre

#endif
