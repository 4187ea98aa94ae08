// The spring, dashpot and slider of Coulomb friction in the plane of a contact.

#ifndef CGFIBRE_FRICTION_SPRING_H
#define CGFIBRE_FRICTION_SPRING_H

#include "vector3.h"

#include <cmath>

namespace cgfibre {

struct FrictionSpring {
  double stiffness;    // nN/um
  double drag;         // nN us/um
  double limit;        // nN, largest force as it is now (sticking: static, slipping: kinetic)
  double kinetic;      // nN, of a contact that slips
};

// Friction force T on the body that slides with velocity `slide` (in the plane of n) on the other. `h` holds the stretch of
// the spring (3), which turns with the contact and keeps its length, and whether the contact slips; it goes on by `dt` us
// where `advance`. Returns whether the contact slips: a spring that gives way goes on at the kinetic limit, with the
// stretch that carries it.
inline bool pull(const FrictionSpring &c, const double *n, const double *slide, double dt, double *h, bool advance, double *T)
{
  const double tilt = dot(h, n), before = dot(h, h);
  double u[3], after = 0.0, size2 = 0.0;
  for (int d = 0; d < 3; d++) {
    u[d] = h[d] - tilt * n[d];
    after += u[d] * u[d];
  }
  const double scale = after > 0.0 ? std::sqrt(before / after) : 1.0;
  for (int d = 0; d < 3; d++) {
    u[d] = u[d] * scale + (advance ? slide[d] * dt : 0.0);
    T[d] = -c.stiffness * u[d] - c.drag * slide[d];
    size2 += T[d] * T[d];
  }
  const bool slips = size2 > c.limit * c.limit;
  if (slips) {
    const double shrink = c.kinetic / std::sqrt(size2), give = c.stiffness > 0.0 ? 1.0 / c.stiffness : 0.0;
    for (int d = 0; d < 3; d++) {
      T[d] *= shrink;
      u[d] = -give * (T[d] + c.drag * slide[d]);
    }
  }
  if (advance) {
    for (int d = 0; d < 3; d++) h[d] = u[d];
    h[3] = slips ? 1.0 : 0.0;
  }
  return slips;
}

}    // namespace cgfibre

#endif
