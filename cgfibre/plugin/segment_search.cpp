#include "segment_search.h"

#include <algorithm>
#include <cmath>

namespace cgfibre {

static double length_of(const SearchSegment &s)
{
  return std::sqrt((s.to[0] - s.from[0]) * (s.to[0] - s.from[0]) + (s.to[1] - s.from[1]) * (s.to[1] - s.from[1]) +
                   (s.to[2] - s.from[2]) * (s.to[2] - s.from[2]));
}

int SegmentSearch::cuts(const SearchSegment &s) const
{
  return std::max(1, (int) std::ceil(length_of(s) / piece_length));
}

void SegmentSearch::cell_of(const double *x, int64_t *c) const
{
  for (int d = 0; d < 3; d++) {
    const int64_t k = (int64_t) std::floor((x[d] - low[d]) / size[d]);
    c[d] = std::min(std::max(k, (int64_t) 0), count[d] - 1);
  }
}

void SegmentSearch::sort_into_cells(const std::vector<SearchSegment> &segments, double skin)
{
  double widest = 0.0, high[3];
  std::vector<double> lengths;
  lengths.reserve(segments.size());
  for (int d = 0; d < 3; d++) {
    low[d] = HUGE_VAL;
    high[d] = -HUGE_VAL;
  }
  for (const SearchSegment &s : segments) {
    widest = std::max(widest, s.radius);
    lengths.push_back(length_of(s));
    for (int d = 0; d < 3; d++) {
      low[d] = std::min({low[d], s.from[d], s.to[d]});
      high[d] = std::max({high[d], s.from[d], s.to[d]});
    }
  }
  const double cut = 2 * widest + skin;
  std::nth_element(lengths.begin(), lengths.begin() + lengths.size() / 2, lengths.end());
  piece_length = std::max(cut, 1.01 * lengths[lengths.size() / 2]);
  // two pieces nearer than cut have their middles in the same or neighbouring cells
  double extent[3] = {0.0, 0.0, 0.0};
  for (const SearchSegment &s : segments) {
    const int n = cuts(s);
    for (int d = 0; d < 3; d++) extent[d] = std::max(extent[d], std::fabs(s.to[d] - s.from[d]) / n);
  }
  for (int d = 0; d < 3; d++) {
    size[d] = extent[d] + cut;
    count[d] = std::max((int64_t) 1, (int64_t) std::min(2e6, std::ceil((high[d] - low[d]) / size[d])));
    size[d] = std::max(size[d], (high[d] - low[d]) / (double) count[d]);
  }
  pieces.clear();
  for (int a = 0; a < (int) segments.size(); a++) {
    const SearchSegment &s = segments[a];
    const int n = cuts(s);
    for (int k = 0; k < n; k++) {
      double middle[3];
      int64_t c[3];
      for (int d = 0; d < 3; d++) middle[d] = s.from[d] + (k + 0.5) / n * (s.to[d] - s.from[d]);
      cell_of(middle, c);
      pieces.push_back({(c[2] * count[1] + c[1]) * count[0] + c[0], a});
    }
  }
  std::sort(pieces.begin(), pieces.end());
}

double segment_distance2(const double *p1, const double *q1, const double *p2, const double *q2)
{
  double u[3], v[3], r[3], a = 0.0, e = 0.0, f = 0.0, b = 0.0, c = 0.0;
  for (int d = 0; d < 3; d++) {
    u[d] = q1[d] - p1[d];
    v[d] = q2[d] - p2[d];
    r[d] = p1[d] - p2[d];
    a += u[d] * u[d];
    e += v[d] * v[d];
    f += v[d] * r[d];
    b += u[d] * v[d];
    c += u[d] * r[d];
  }
  const auto clip = [](double t) { return t < 0.0 ? 0.0 : (t > 1.0 ? 1.0 : t); };
  const double det = a * e - b * b;
  double s = det > 1e-12 * a * e ? clip((b * f - c * e) / det) : 0.0;
  double t = e > 0.0 ? clip((b * s + f) / e) : 0.0;
  s = a > 0.0 ? clip((b * t - c) / a) : 0.0;
  t = e > 0.0 ? clip((b * s + f) / e) : 0.0;
  double d2 = 0.0;
  for (int d = 0; d < 3; d++) {
    const double q = r[d] + s * u[d] - t * v[d];
    d2 += q * q;
  }
  return d2;
}

}    // namespace cgfibre
