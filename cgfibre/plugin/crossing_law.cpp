#include "crossing_law.h"

#include <array>
#include <cmath>

namespace cgfibre {

static constexpr double PI = 3.14159265358979323846;
static constexpr int POINTS = 800;
static constexpr double LOWEST = -12.0;    // ln of the least sine

// complete elliptic integrals of modulus k = sqrt(1 - q^2), by the arithmetic-geometric mean
static void elliptic(double q, double &K, double &E)
{
  double a = 1.0, b = q, sum = 0.5 * (1.0 - q * q), power = 0.5;
  while (std::fabs(a - b) > 1e-15 * a) {
    const double c = 0.5 * (a - b), mean = 0.5 * (a + b);
    b = std::sqrt(a * b);
    a = mean;
    power *= 2.0;
    sum += power * c * c;
  }
  K = PI / (2.0 * a);
  E = K * (1.0 - sum);
}

// g at one sine: relative curvatures A <= B, A + B = 1, A B = sin^2/4; axis ratio q of the ellipse from
// B/A = (E/q^2 - K)/(K - E); F = 2 pi E*/3 K^-1.5 sqrt((K - E)/(m A)) delta^1.5, m = 1 - q^2 (Johnson, 4.2)
static double shape_at(double sin2)
{
  const double root = std::sqrt(std::fmax(0.0, 1.0 - sin2));
  const double B = 0.5 * (1.0 + root), A = 0.25 * sin2 / B;
  if (root < 1e-6) return 4.0 / 3.0;
  double lo = std::log(1e-12), hi = 0.0, K, E;
  for (int n = 0; n < 200 && hi - lo > 1e-15; n++) {
    const double q = std::exp(0.5 * (lo + hi));
    elliptic(q, K, E);
    if ((E / (q * q) - K) / (K - E) > B / A)
      lo = 0.5 * (lo + hi);
    else
      hi = 0.5 * (lo + hi);
  }
  const double q = std::exp(0.5 * (lo + hi));
  elliptic(q, K, E);
  return 2.0 * PI / 3.0 * std::pow(K, -1.5) * std::sqrt((K - E) / ((1.0 - q * q) * A));
}

// ln(g sin) over ln(sin), which is smooth
static std::array<double, POINTS + 1> tabulate()
{
  std::array<double, POINTS + 1> table{};
  for (int k = 0; k <= POINTS; k++) {
    const double log_sine = LOWEST * (1.0 - (double) k / POINTS);
    table[k] = std::log(shape_at(std::exp(2.0 * log_sine))) + log_sine;
  }
  return table;
}

double hertz_shape(double sin2)
{
  static const std::array<double, POINTS + 1> table = tabulate();
  const double log_sine = 0.5 * std::log(std::fmin(1.0, std::fmax(sin2, std::exp(2.0 * LOWEST))));
  const double at = (1.0 - log_sine / LOWEST) * POINTS;
  const int k = std::fmin(POINTS - 1.0, std::fmax(0.0, std::floor(at)));
  // cubic through four points (at the ends the nearest four)
  const int first = k < 1 ? 0 : (k > POINTS - 2 ? POINTS - 3 : k - 1);
  double value = 0.0;
  for (int i = 0; i < 4; i++) {
    double weight = 1.0;
    for (int j = 0; j < 4; j++)
      if (j != i) weight *= (at - first - j) / (i - j);
    value += weight * table[first + i];
  }
  return std::exp(value - log_sine);
}

}    // namespace cgfibre
