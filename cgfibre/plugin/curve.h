#ifndef CGFIBRE_CURVE_H
#define CGFIBRE_CURVE_H

#include <vector>

namespace cgfibre {

// Monotone piecewise cubic through knots (x rising): Fritsch and Carlson, slopes and ends as in
// scipy.interpolate.PchipInterpolator (interior: weighted harmonic mean of the two chords, 0 at an extremum; ends:
// three-point formula kept within the shape). Beyond the last knot a straight line.
class Curve {
 public:
  enum Beyond { LAST_SLOPE, CONSTANT };    // how it goes on beyond the last knot

  Curve() = default;
  Curve(const std::vector<double> &x, const std::vector<double> &y, Beyond beyond);

  double value(double x) const
  {
    if (x >= last_) return end_ + slope_ * (x - last_);
    if (x <= first_) return cells_.front().a;
    const Cell &c = cells_[find(x)];
    const double t = x - c.x;
    return c.a + t * (c.b + t * (c.c + t * c.d));
  }
  double slope(double x) const;       // right-hand derivative
  double integral(double x) const;    // from the first knot to x, exact
  double first() const { return first_; }
  double last() const { return last_; }
  bool empty() const { return cells_.empty(); }
  const std::vector<double> &knots() const { return knots_; }

 private:
  struct Cell {
    double x, a, b, c, d, area;    // y = a + b t + c t^2 + d t^3, t = x' - x; area under all cells before
  };
  std::vector<Cell> cells_;
  std::vector<double> knots_;
  std::vector<int> bucket_;    // equal intervals of x -> the cell in which each starts
  double first_ = 0, last_ = 0, end_ = 0, slope_ = 0, area_ = 0, per_bucket_ = 0;

  int find(double x) const
  {
    const int b = static_cast<int>((x - first_) * per_bucket_);
    int low = bucket_[b], high = bucket_[b + 1];
    while (low < high) {
      const int middle = (low + high + 1) / 2;
      if (cells_[middle].x <= x)
        low = middle;
      else
        high = middle - 1;
    }
    return low;
  }
};

}    // namespace cgfibre

#endif
