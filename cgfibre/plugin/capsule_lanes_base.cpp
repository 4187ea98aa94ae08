// The kernels for any processor: two lanes a register where it has such.
#define WIDTH 2
#define KERNELS LANES_BASE
#define KERNEL_LANES "two"
#include "capsule_kernel.h"
