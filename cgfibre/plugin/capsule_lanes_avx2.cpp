// The kernels for processors with AVX2: four lanes a register.
#include "capsule_lanes.h"    // what others share comes first, for any processor
#include "crossing_law.h"

#ifdef __x86_64__
#include <immintrin.h>
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#else
#pragma GCC target("avx2,fma")
#endif
#define WIDTH 4
#define KERNELS LANES_AVX2
#define KERNEL_LANES "four"
#include "capsule_kernel.h"
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
