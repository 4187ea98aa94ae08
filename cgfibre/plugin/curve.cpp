#include "curve.h"

#include <cmath>

using namespace cgfibre;

namespace {

bool same_sign(double a, double b) { return (a > 0 && b > 0) || (a < 0 && b < 0); }

// slope at an end from the steps h and chords m of the two cells next to it
double end_slope(double h0, double h1, double m0, double m1)
{
  const double d = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1);
  if (!same_sign(d, m0)) return 0;
  if (!same_sign(m0, m1) && std::fabs(d) > 3 * std::fabs(m0)) return 3 * m0;
  return d;
}

std::vector<double> slopes(const std::vector<double> &x, const std::vector<double> &y)
{
  const size_t n = x.size();
  std::vector<double> h(n - 1), m(n - 1), d(n);
  for (size_t k = 0; k + 1 < n; k++) {
    h[k] = x[k + 1] - x[k];
    m[k] = (y[k + 1] - y[k]) / h[k];
  }
  if (n == 2) return {m[0], m[0]};
  for (size_t k = 1; k + 1 < n; k++) {
    const double w1 = 2 * h[k] + h[k - 1], w2 = h[k] + 2 * h[k - 1];
    d[k] = same_sign(m[k - 1], m[k]) ? (w1 + w2) / (w1 / m[k - 1] + w2 / m[k]) : 0;
  }
  d[0] = end_slope(h[0], h[1], m[0], m[1]);
  d[n - 1] = end_slope(h[n - 2], h[n - 3], m[n - 2], m[n - 3]);
  return d;
}

}    // namespace

Curve::Curve(const std::vector<double> &x, const std::vector<double> &y, Beyond beyond) : knots_(x)
{
  const std::vector<double> d = slopes(x, y);
  const size_t n = x.size();
  area_ = 0;
  for (size_t k = 0; k + 1 < n; k++) {
    const double h = x[k + 1] - x[k], m = (y[k + 1] - y[k]) / h;
    Cell c{x[k], y[k], d[k], (3 * m - 2 * d[k] - d[k + 1]) / h, (d[k] + d[k + 1] - 2 * m) / (h * h), area_};
    cells_.push_back(c);
    area_ += h * (c.a + h * (c.b / 2 + h * (c.c / 3 + h * c.d / 4)));
  }
  first_ = x.front();
  last_ = x.back();
  end_ = y.back();
  slope_ = beyond == LAST_SLOPE ? d.back() : 0;
  const int buckets = 4 * static_cast<int>(n);
  per_bucket_ = buckets / (last_ - first_);
  size_t k = 0;
  for (int b = 0; b <= buckets; b++) {
    while (k + 2 < n && x[k + 1] <= first_ + b / per_bucket_) k++;
    bucket_.push_back(static_cast<int>(k));
  }
  bucket_.push_back(static_cast<int>(k));
}

double Curve::slope(double x) const
{
  if (x >= last_) return slope_;
  if (x < first_) return 0;
  const Cell &c = cells_[find(x)];
  const double t = x - c.x;
  return c.b + t * (2 * c.c + 3 * t * c.d);
}

double Curve::integral(double x) const
{
  if (x <= first_) return (x - first_) * cells_.front().a;
  if (x >= last_) return area_ + (x - last_) * (end_ + slope_ * (x - last_) / 2);
  const Cell &c = cells_[find(x)];
  const double t = x - c.x;
  return c.area + t * (c.a + t * (c.b / 2 + t * (c.c / 3 + t * c.d / 4)));
}
