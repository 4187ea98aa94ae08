// The kernels for processors with AVX-512: eight lanes a register.
#include "capsule_lanes.h"    // what others share comes first, for any processor
#include "crossing_law.h"

#ifdef __x86_64__
#include <immintrin.h>
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma"))), apply_to = function)
#else
#pragma GCC target("avx512f,avx512dq,avx512vl,avx2,fma")
#endif
#define WIDTH 8
#define KERNELS LANES_AVX512
#define KERNEL_LANES "eight"
#include "capsule_kernel.h"
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
