#include "capsule_lanes.h"

#include "crossing_law.h"
#include "vector3.h"

#include <cmath>
#include <cstdlib>
#include <cstring>

namespace cgfibre {

const LaneKernels *lane_kernels()
{
  const LaneKernels *known[3] = {nullptr, nullptr, &LANES_BASE};
#ifdef __x86_64__
  const bool fma = __builtin_cpu_supports("fma");
  if (fma && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
    known[0] = &LANES_AVX512;
  if (fma && __builtin_cpu_supports("avx2")) known[1] = &LANES_AVX2;
#endif
  const char *asked = std::getenv("CGFIBRE_LANES");
  for (const LaneKernels *one : known)
    if (one && (!asked || std::strcmp(asked, one->lanes) == 0)) return one;
  return nullptr;
}

void law_of_lanes(PressLanes &all, int point, int first, int count, const double *overlap, const double *size, double *elastic)
{
  for (int l = 0; l < count; l++) {
    const NormalLaw &law = *all.law[first + l];
    if (law.has_history()) {
      double deepest = all.history[first + l][4 + point];
      elastic[l] = law.force(overlap[l], size[l], deepest);
      if (all.advance) all.history[first + l][4 + point] = deepest;
    } else
      elastic[l] = law.force(overlap[l], size[l]);
  }
}

void shape_of_lanes(int count, double *sin2)
{
  for (int l = 0; l < count; l++) sin2[l] = hertz_shape(sin2[l]);
}

// a unit vector across both axes: any will do
void across_of_lanes(const PressLanes &all, int lane, double *n)
{
  const double *u = all.A[lane]->t, *v = all.B[lane]->t;
  cross(u, v, n);
  double size = std::sqrt(dot(n, n));
  if (size < 1e-9) {
    const double e[3] = {std::fabs(u[0]) < 0.8 ? 1.0 : 0.0, std::fabs(u[0]) < 0.8 ? 0.0 : 1.0, 0.0};
    cross(u, e, n);
    size = std::sqrt(dot(n, n));
  }
  for (int d = 0; d < 3; d++) n[d] /= size;
}

}    // namespace cgfibre
