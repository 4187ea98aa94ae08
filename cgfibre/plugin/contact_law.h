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
//   LAW                  see NormalLaw
//   length L             the law's force times L (um): depth of discs, length of cylinders
//   damping G            N = max(0, F - G v_n), nN us/um: never adhesion
//   friction MU ...      see FrictionLaw (not by angle), of the full N, damping included
//   tangential K RATIO   spring of friction: K times the secant of the loading curve; its damping: RATIO G (0.8 0.3)
//   tangential stiffness K RATIO    the same, K in nN/um
//   rolling K G MU       spring (nN/um), dashpot and limit MU N against the rolling velocity
//
// Friction and rolling: see FrictionSpring. Where the spring stiffens with the overlap its force stays as it is, where it
// softens its stretch does (Thornton, Cummins, Cleary 2013): either way round it never makes energy.
class ContactLaw {
 public:
  // what a contact remembers: two friction springs (stretch, whether it slips), of sliding with its stiffness, of rolling;
  // deepest overlap
  enum { SLIDING = 0, SLIPPING = 3, STIFFNESS = 4, ROLLING = 5, DEEPEST = 9, VALUES = 10 };

  ContactLaw() = default;
  // LAW, from arg[iarg] on, which is moved behind it
  static ContactLaw parse(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);
  // a keyword of those above with its values; false, and nothing is moved, if it is none
  bool keyword(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);

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
  double tangential_ = 0.8, sliding_ = 0.3;
  bool absolute_ = false;    // tangential_ is a stiffness
  double rolling_stiffness_ = 0, rolling_damping_ = 0, rolling_friction_ = 0;

  void slide(const Contact &contact, double normal, double *history, double dt, double *t) const;
};

}    // namespace cgfibre

#endif
