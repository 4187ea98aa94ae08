#include "normal_law.h"

#include "error.h"
#include "fmt/format.h"
#include "lammps.h"
#include "table_file.h"

#include <algorithm>
#include <cmath>
#include <string>

using namespace cgfibre;
using LAMMPS_NS::LAMMPS;

namespace {

constexpr double PI = 3.14159265358979323846;

// dphi/dy = pi/(ln(8 pi/phi) - 2)
double line_slope(double phi) { return PI / (std::log(8 * PI / phi) - 2); }

// phi(y) by Newton from a `phi` that lies below: y(phi) is concave, so it is approached from there without a step over
double line_solve(double y, double phi)
{
  for (int k = 0; k < 60; k++) {
    const double step = (y - phi / PI * (std::log(8 * PI / phi) - 1)) * line_slope(phi);
    phi += step;
    if (std::fabs(step) <= 1e-16 * phi) break;
  }
  return phi;
}

// a table of force against overlap with its checks
Curve force_curve(LAMMPS *lmp, const std::string &file, const std::string &keyword)
{
  TableFile table(lmp, file, keyword);
  for (size_t k = 0; k < table.x.size(); k++) {
    if (table.x[k] < 0) table.fail_row(k + 1, "overlap", table.x[k], "at least 0");
    if (table.y[k] < 0) table.fail_row(k + 1, "force", table.y[k], "at least 0");
    if (k > 0 && table.y[k] < table.y[k - 1])
      table.fail_row(k + 1, "force", table.y[k], fmt::format("no less than {} before it", table.y[k - 1]));
  }
  if (table.x[0] == 0 && table.y[0] != 0) table.fail_row(1, "force", table.y[0], "0 at no overlap");
  if (table.y.back() == 0) table.fail_row(table.y.size(), "force", 0, "more than 0");
  if (table.x[0] > 0) {
    table.x.insert(table.x.begin(), 0.0);
    table.y.insert(table.y.begin(), 0.0);
  }
  return Curve(table.x, table.y, Curve::LAST_SLOPE);
}

// U meets L at its end within 1e-6 and lies under it before
void check_unloading(LAMMPS *lmp, const Curve &load, const Curve &unload, const std::string &name)
{
  const double r = unload.last(), top = load.value(r);
  if (std::fabs(unload.value(r) - top) > 1e-6 * top)
    lmp->error->all(FLERR, "table {}: its last force is {}, expected {}, the loading curve's at its last overlap {}", name,
                    unload.value(r), top, r);
  for (const double d : unload.knots())
    if (unload.value(d) > load.value(d) + 1e-6 * top)
      lmp->error->all(FLERR, "table {}: its force at overlap {} is {}, expected at most {}, the loading curve's", name, d,
                      unload.value(d), load.value(d));
}

}    // namespace

const LineCurve &LineCurve::get()
{
  static const LineCurve curve;
  return curve;
}

LineCurve::LineCurve()
{
  double y0 = FIRST, p0 = line_solve(y0, PI * y0 / 25);
  initial_ = p0 / y0;
  below_[0] = p0 * y0 / 2;
  for (int k = 0; k < OCTAVES << CELL_BITS; k++) {
    const std::uint64_t bits = (BASE + k + 1) << SHIFT;
    double y1;
    std::memcpy(&y1, &bits, sizeof y1);
    const double p1 = line_solve(y1, p0), s0 = line_slope(p0), s1 = line_slope(p1), h = y1 - y0, m = (p1 - p0) / h;
    const Cell c = {p0, s0, (3 * m - 2 * s0 - s1) / h, (s0 + s1 - 2 * m) / (h * h)};
    cells_[k] = c;
    below_[k + 1] = below_[k] + h * (c.a + h * (c.b / 2 + h * (c.c / 3 + h * c.d / 4)));
    y0 = y1;
    p0 = p1;
  }
  phi1_ = p0;
  slope1_ = line_slope(p0);
}

double LineCurve::energy(double y) const
{
  if (y < FIRST) return initial_ * y * y / 2;
  if (y >= 1) return below_[OCTAVES << CELL_BITS] + (y - 1) * (phi1_ + slope1_ * (y - 1) / 2);
  double t;
  const std::size_t cell = place(y, t);
  const Cell &c = cells_[cell];
  return below_[cell] + t * (c.a + t * (c.b / 2 + t * (c.c / 3 + t * c.d / 4)));
}

NormalLaw NormalLaw::parse(LAMMPS *lmp, int narg, char **arg, int &iarg)
{
  NormalLaw law;
  const std::string kind = word(lmp, narg, arg, iarg, "normal law");
  if (kind == "none") {
    law.kind_ = NONE;
  } else if (kind == "hooke") {
    law.kind_ = HOOKE;
    law.stiffness_ = positive(lmp, narg, arg, iarg, "stiffness of law hooke");
  } else if (kind == "line") {
    law.kind_ = LINE;
    law.line_ = &LineCurve::get();
    law.stiffness_ = positive(lmp, narg, arg, iarg, "modulus E* of law line");
    if (iarg < narg && std::strcmp(arg[iarg], "soften") == 0) {
      iarg++;
      law.stiffness_ /= positive(lmp, narg, arg, iarg, "factor of soften");
    }
  } else if (kind == "table") {
    law.kind_ = TABLE;
    const std::string file = word(lmp, narg, arg, iarg, "file of law table");
    law.load_ = force_curve(lmp, file, word(lmp, narg, arg, iarg, "keyword of law table"));
    if (iarg < narg && std::strcmp(arg[iarg], "unload") == 0) {
      iarg++;
      const std::string keyword = word(lmp, narg, arg, iarg, "keyword of unload");
      law.unload_ = force_curve(lmp, file, keyword);
      check_unloading(lmp, law.load_, law.unload_, keyword + " of file " + file);
    }
  } else {
    lmp->error->all(FLERR, "normal law is {}, expected none, hooke, line or table", kind);
  }
  return law;
}

double NormalLaw::branch(double overlap, double load, double deepest) const
{
  const double r = unload_.last();
  return std::min(load, load_.value(deepest) * (unload_.value(overlap * (r / deepest)) / unload_.value(r)));
}

double NormalLaw::energy(double overlap, double size) const
{
  if (overlap <= 0) return 0;
  switch (kind_) {
    case HOOKE:
      return stiffness_ * overlap * overlap / 2;
    case LINE:
      return stiffness_ * size * size * line_->energy(overlap / size);
    case TABLE:
      return load_.integral(overlap);
    default:
      return 0;
  }
}

double NormalLaw::stiffness(double overlap, double size) const
{
  switch (kind_) {
    case HOOKE:
      return stiffness_;
    case LINE:
      return stiffness_ * (overlap > 0 ? line_->phi(overlap / size) * size / overlap : line_->initial_slope());
    case TABLE:
      return overlap > 0 ? load_.value(overlap) / overlap : load_.slope(0);
    default:
      return 0;
  }
}
