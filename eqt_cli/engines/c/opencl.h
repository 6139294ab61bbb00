/* What OpenCL C calls otherwise than C; it precedes lanes.h in a kernel. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL FP_CONTRACT OFF

#define EQT_DEVICE
#define EQT_GLOBAL __global
#define EQT_CONSTANT __constant
typedef uint eqt_uint32;
typedef ulong eqt_uint64;
typedef long int64_t;
#define INT64_C(number) number##L
#define __restrict restrict
#define __builtin_sqrt sqrt
#define __builtin_fma fma
#define __builtin_inf() ((double)INFINITY)
#define __builtin_nan(text) ((double)NAN)
#define eqt_bits_of(x) as_ulong(x)
#define eqt_of_bits(bits) as_double(bits)
