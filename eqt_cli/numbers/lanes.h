/* The types of emitted programs: eqt_real is one double, or a vector of EQT_LANES doubles. Lanes
   never meet. A number is one bit pattern whatever the lanes are. */
#ifndef EQT_LANES_H
#define EQT_LANES_H

#include <stdint.h>
typedef uint32_t eqt_uint32;
typedef uint64_t eqt_uint64;

#ifndef EQT_LANES
#define EQT_LANES 1
#endif

#define EQT_INFINITY __builtin_inf()
#define EQT_NAN __builtin_nan("")

#if defined(__GNUC__)
#define EQT_INLINE static inline __attribute__((always_inline))
#else
#define EQT_INLINE static inline
#endif

/* A function that is called so rarely that it is not worth its place in others. */
#if defined(__GNUC__)
#define EQT_RARE __attribute__((noinline, cold, unused)) static
#else
#define EQT_RARE static
#endif

/* The body of a loop, which would make the function around it long to compile. */
#if defined(__GNUC__)
#define EQT_APART __attribute__((noinline))
#else
#define EQT_APART
#endif

#if EQT_LANES == 1

typedef double eqt_real;
typedef eqt_uint64 eqt_bits;
typedef int eqt_mask; /* all bits, or none */
#define EQT_MASK(condition) (-(condition))
#define EQT_LANE(values, lane) (values)
#define EQT_EACH_LANE(F) F(0)

EQT_INLINE eqt_real eqt_constant(double number) { return number; }
EQT_INLINE eqt_bits eqt_bits_constant(eqt_uint64 bits) { return bits; }
EQT_INLINE eqt_real eqt_select(eqt_mask holds, eqt_real a, eqt_real b) { return holds ? a : b; }
EQT_INLINE eqt_real eqt_sqrt(eqt_real x) { return __builtin_sqrt(x); }
EQT_INLINE eqt_bits eqt_bits_of(eqt_real x)
{
    eqt_bits bits;
    __builtin_memcpy(&bits, &x, sizeof bits);
    return bits;
}
EQT_INLINE eqt_real eqt_of_bits(eqt_bits bits)
{
    eqt_real x;
    __builtin_memcpy(&x, &bits, sizeof x);
    return x;
}

#else

typedef double eqt_real __attribute__((vector_size(8 * EQT_LANES)));
typedef eqt_uint64 eqt_bits __attribute__((vector_size(8 * EQT_LANES)));
typedef int64_t eqt_mask __attribute__((vector_size(8 * EQT_LANES))); /* all bits, or none */
#define EQT_MASK(condition) ((eqt_mask)(condition))
#define EQT_LANE(values, lane) ((values)[lane])

#if EQT_LANES == 2
#define EQT_IN_ALL_LANES(x) {x, x}
#define EQT_EACH_LANE(F) {F(0), F(1)}
#elif EQT_LANES == 4
#define EQT_IN_ALL_LANES(x) {x, x, x, x}
#define EQT_EACH_LANE(F) {F(0), F(1), F(2), F(3)}
#elif EQT_LANES == 8
#define EQT_IN_ALL_LANES(x) {x, x, x, x, x, x, x, x}
#define EQT_EACH_LANE(F) {F(0), F(1), F(2), F(3), F(4), F(5), F(6), F(7)}
#endif

EQT_INLINE eqt_real eqt_constant(double number)
{
    eqt_real all = EQT_IN_ALL_LANES(number);
    return all;
}
EQT_INLINE eqt_bits eqt_bits_constant(eqt_uint64 bits)
{
    eqt_bits all = EQT_IN_ALL_LANES(bits);
    return all;
}
EQT_INLINE eqt_bits eqt_bits_of(eqt_real x) { return (eqt_bits)x; }
EQT_INLINE eqt_real eqt_of_bits(eqt_bits bits) { return (eqt_real)bits; }
EQT_INLINE eqt_real eqt_select(eqt_mask holds, eqt_real a, eqt_real b)
{
    return (eqt_real)(((eqt_bits)holds & (eqt_bits)a) | (~(eqt_bits)holds & (eqt_bits)b));
}
EQT_INLINE eqt_real eqt_sqrt(eqt_real x)
{
    eqt_real root;
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++)
        root[lane] = __builtin_sqrt(x[lane]);
    return root;
}

#endif

/* Whether a mask holds in any lane: only to leave out what no lane needs. The instructions of x86
   are named because GCC takes a vector apart through memory. */
EQT_INLINE int eqt_any(eqt_mask mask)
{
#if EQT_LANES == 1
    return mask;
#elif EQT_LANES == 8 && defined(__AVX512DQ__)
    typedef long long lanes __attribute__((vector_size(64)));
    return __builtin_ia32_cvtq2mask512((lanes)mask) != 0;
#elif EQT_LANES >= 4 && defined(__AVX__)
    typedef double part __attribute__((vector_size(32)));
    part parts[EQT_LANES / 4];
    __builtin_memcpy(parts, &mask, sizeof parts);
#if EQT_LANES == 8
    return (__builtin_ia32_movmskpd256(parts[0]) | __builtin_ia32_movmskpd256(parts[1])) != 0;
#else
    return __builtin_ia32_movmskpd256(parts[0]) != 0;
#endif
#else
    int64_t lanes[EQT_LANES], any = 0;
    int lane;
    __builtin_memcpy(lanes, &mask, sizeof lanes);
    for (lane = 0; lane < EQT_LANES; lane++)
        any |= lanes[lane];
    return any != 0;
#endif
}

EQT_INLINE eqt_mask eqt_less(eqt_real a, eqt_real b) { return EQT_MASK(a < b); }
EQT_INLINE eqt_mask eqt_equal(eqt_real a, eqt_real b) { return EQT_MASK(a == b); }
EQT_INLINE eqt_mask eqt_any_bit(eqt_bits bits) { return EQT_MASK(bits != eqt_bits_constant(0)); }

/* a b + c, rounded once: the one operation beside + - * / and the root that IEEE 754 fixes. WebAssembly
   has it where "relaxed" instructions fuse; else it is rounded twice there, and whoever runs it says so. */
EQT_INLINE eqt_real eqt_fma(eqt_real a, eqt_real b, eqt_real c)
{
#if defined(__wasm_relaxed_simd__) && EQT_LANES == 2
    return (eqt_real)__builtin_wasm_relaxed_madd_f64x2(a, b, c);
#elif defined(__wasm__)
    return a * b + c;
#elif EQT_LANES == 1
    return __builtin_fma(a, b, c);
#elif EQT_LANES == 8 && defined(__AVX512F__) && !defined(__clang__)
    /* GCC makes two halves of the loop below. */
    return (eqt_real)__builtin_ia32_vfmaddpd512_mask(a, b, c, -1, 4);
#else
    eqt_real found;
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++)
        found[lane] = __builtin_fma(a[lane], b[lane], c[lane]);
    return found;
#endif
}

#endif
