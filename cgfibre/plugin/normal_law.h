#ifndef CGFIBRE_NORMAL_LAW_H
#define CGFIBRE_NORMAL_LAW_H

#include "curve.h"

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace LAMMPS_NS {
class LAMMPS;
}

namespace cgfibre {

// Johnson's line contact of two parallel cylinders in numbers without dimension: y = overlap/size, phi = f/(E* size),
//
//   y = phi/pi (ln(8 pi/phi) - 1)          (Contact Mechanics, 5.57), size = Rg^2/(2 R*)
//
// inverted to phi(y): piecewise cubic on 2^-20 <= y < 1, a straight line below, the tangent beyond y = 1 (the theory
// ends at y = 8/e^2 = 1.083). Every octave of y has the same number of cells, found from the bits of y.
class LineCurve {
 public:
  static const LineCurve &get();

  double phi(double y) const
  {
    if (y < FIRST) return y * initial_;
    if (y >= 1) return phi1_ + slope1_ * (y - 1);
    double t;
    const Cell &c = cells_[place(y, t)];
    return c.a + t * (c.b + t * (c.c + t * c.d));
  }
  double initial_slope() const { return initial_; }
  double last() const { return phi1_; }    // phi(1)
  double last_slope() const { return slope1_; }
  // integral of phi dy, of the pieces themselves; of the law: phi^2/(2 pi) (ln(8 pi/phi) - 3/2)
  double energy(double y) const;

  // cell of y: cells()[(bits of y >> SHIFT) - BASE]
  static constexpr int OCTAVES = 20, CELL_BITS = 8, SHIFT = 52 - CELL_BITS;    // 256 cells an octave
  static constexpr std::uint64_t BASE = std::uint64_t(1023 - OCTAVES) << CELL_BITS;
  static constexpr double FIRST = 1.0 / (1 << OCTAVES);
  struct Cell {
    double a, b, c, d;
  };
  const Cell *cells() const { return cells_; }

 private:
  Cell cells_[OCTAVES << CELL_BITS];
  double below_[(OCTAVES << CELL_BITS) + 1];    // energy at the start of each cell
  double initial_, phi1_, slope1_;

  LineCurve();

  // cell of FIRST <= y < 1, and how far into it y lies
  static std::size_t place(double y, double &t)
  {
    std::uint64_t bits;
    std::memcpy(&bits, &y, sizeof bits);
    const std::uint64_t cell = bits >> SHIFT;
    bits = cell << SHIFT;
    double start;
    std::memcpy(&start, &bits, sizeof start);
    t = y - start;
    return cell - BASE;
  }
};

// Force against overlap, loading and unloading: nN of spheres and discs, nN/um of capsules; um, nN/um, kPa = nN/um^2.
//
//   none
//   hooke K                            F = K d
//   line E* [soften F]                 Johnson's line contact with E*/F, see LineCurve
//   table FILE KEYWORD [unload KEY2]   tabulated loading curve L(d), see TableFile: d, F rising from (0, 0), a row of
//                                      which is put first where the table starts later; monotone cubic between the
//                                      rows (Curve), last slope beyond them
//
// Unloading: U(d) is tabulated up to its own largest overlap r, where it meets the loading curve, U(r) = L(r), and
// below which it lies under it. The branch from any deepest overlap m keeps the shape of U,
//
//   F = min(L(d), L(m) U(d r/m)/U(r))        for d < m,        F = L(d), m = d        for d >= m:
//
// U itself from m = r, so a cycle to r dissipates exactly the integral of L - U; reloading goes up the same branch and
// on along L. The minimum keeps every branch under L, so that no cycle makes energy, whatever the shapes. (Luding's and
// Walton and Braun's rules are the case of straight lines.) A contact that opens forgets m.
class NormalLaw {
 public:
  enum Kind { NONE, HOOKE, LINE, TABLE };

  NormalLaw() = default;

  // words of a LAMMPS command from arg[iarg] on, which is moved behind the law
  static NormalLaw parse(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg);

  // loading curve. `size`, the length scale of the line law: pair of equal radii R: R; of R1 and R2: (R1 + R2)/2; on a
  // rigid plane: R/2
  double force(double overlap, double size) const
  {
    if (!(overlap > 0)) return 0;    // nor for NaN
    switch (kind_) {
      case HOOKE:
        return stiffness_ * overlap;
      case LINE:
        return stiffness_ * size * line_->phi(overlap / size);
      case TABLE:
        return load_.value(overlap);
      default:
        return 0;
    }
  }

  // with the unloading branch; `deepest`, the largest overlap so far, is brought up to date
  double force(double overlap, double size, double &deepest) const
  {
    if (!(overlap > 0)) {
      deepest = 0;
      return 0;
    }
    const double load = force(overlap, size);
    if (overlap >= deepest) {
      deepest = overlap;
      return load;
    }
    return unload_.empty() ? load : branch(overlap, load, deepest);
  }

  double energy(double overlap, double size) const;       // integral of the loading curve
  double stiffness(double overlap, double size) const;    // secant of the loading curve, its slope at 0
  bool has_history() const { return !unload_.empty(); }
  Kind kind() const { return kind_; }
  double modulus() const { return stiffness_; }    // E* of the line law, K of hooke

 private:
  Kind kind_ = NONE;
  double stiffness_ = 0;              // K or E*
  const LineCurve *line_ = nullptr;
  Curve load_, unload_;

  double branch(double overlap, double load, double deepest) const;
};

}    // namespace cgfibre

#endif
