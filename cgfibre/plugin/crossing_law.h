// Crossing filaments: from Hertz' elliptical contact to the line law.
//
// Two cylinders that cross at an angle overlap in a lens of half width w = sqrt(4 R delta)/sin(angle) along the axes. A
// lens short beside the radius is Hertz' ellipse; a long one is a line contact whose overlap falls off along it. Both
// forces have the same powers, and their logarithms differ by where they are cut off: at the ellipse's length, or at the
// radius where that is shorter. They are equal at w/R = 0.45, at every angle; below it Hertz' ellipse is the stiffer, above
// it the line (a half-space, which Hertz presses, is softer than a filament). The law leads over from w/R 0.25 to 1.

#ifndef CGFIBRE_CROSSING_LAW_H
#define CGFIBRE_CROSSING_LAW_H

namespace cgfibre {

constexpr double SHORT_LENS = 0.25, LONG_LENS = 1.0;    // w/R

// g of Hertz' F = E* sqrt(Re) g delta^1.5, with 1/Re = (1/r1 + 1/r2)/2 and sin^2 = Re^2 sin^2(angle)/(r1 r2); 4/3 at 90 deg
double hertz_shape(double sin2);

}    // namespace cgfibre

#endif
