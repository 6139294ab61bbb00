/* The types and elementary functions of emitted programs in float, for a unit that has no other.

   As functions.h, they consist of operations that IEEE 754 and C fix, and special values are those
   of C99, Annex F. Angles may have any size. No function loops, so that its time is bounded.

   Largest errors against mpmath, in units in the last place, of some 100,000 normal results each:
       eqt_sin   2.2
       eqt_cos   2.2
       eqt_tan   3.6
       eqt_asin  2.4
       eqt_acos  1.5
       eqt_atan  1.0
       eqt_sinh  1.6
       eqt_cosh  1.4
       eqt_tanh  2.6
       eqt_asinh 2.0
       eqt_acosh 2.0
       eqt_atanh 2.2
       eqt_exp   0.9
       eqt_log   1.1
       eqt_sqrt  0.5
       eqt_abs   0.0
       eqt_floor 0.0
       eqt_pow   0.6

   They sum the series of sin, cos, sinh and atanh, whose coefficients need no source; those of atan
   and asin interpolate them at Chebyshev's points. Angles are reduced after Payne and Hanek (1983). */
#ifndef EQT_FLOAT_FUNCTIONS_H
#define EQT_FLOAT_FUNCTIONS_H

#include <stdint.h>

typedef uint32_t eqt_uint32;
typedef uint64_t eqt_uint64;

#define EQT_INFINITY __builtin_inff()
#define EQT_NAN __builtin_nanf("")
#define EQT_INLINE static inline
#define EQT_RARE static

typedef float eqt_real;
typedef eqt_uint32 eqt_bits;
typedef int eqt_mask; /* all bits, or none */

#define EQT_MASK(condition) (-(condition))
#define EQT_SIGN_BIT 0x80000000u

EQT_INLINE eqt_real eqt_constant(double number) { return (eqt_real)number; }
EQT_INLINE eqt_real eqt_select(eqt_mask holds, eqt_real a, eqt_real b) { return holds ? a : b; }
EQT_INLINE eqt_real eqt_sqrt(eqt_real x) { return __builtin_sqrtf(x); }
EQT_INLINE eqt_mask eqt_less(eqt_real a, eqt_real b) { return EQT_MASK(a < b); }

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

EQT_INLINE eqt_real eqt_abs(eqt_real x) { return eqt_of_bits(eqt_bits_of(x) & ~EQT_SIGN_BIT); }

/* x, which is not negative, with the sign of another number. */
EQT_INLINE eqt_real eqt_with_sign(eqt_real x, eqt_real sign)
{
    return eqt_of_bits(eqt_bits_of(x) | (eqt_bits_of(sign) & EQT_SIGN_BIT));
}

/* The largest whole number that is not above x. */
EQT_INLINE eqt_real eqt_floor(eqt_real x)
{
    const eqt_real shift = 8388608.0f, size = eqt_abs(x); /* 2^23 */
    const eqt_real nearest = eqt_with_sign((size + shift) - shift, x);
    return size < shift ? nearest - (x < nearest ? 1.0f : 0.0f) : x;
}

/* x, but no less than a bound and no more than another; NaN stays. */
EQT_INLINE eqt_real eqt_within(eqt_real x, eqt_real least, eqt_real most)
{
    return x < least ? least : most < x ? most : x;
}

/* 2^n of a whole number from -126 to 127. */
EQT_INLINE eqt_real eqt_power_of_2(eqt_real n)
{
    return eqt_of_bits(eqt_bits_of(n + 12583039.0f) << 23); /* 1.5 2^23 + 127 */
}

/* sin, cos, tan -------------------------------------------------------------------------------- */

/* 0, and 2 / pi in words of 32 bits. */
static const eqt_uint32 eqt_2_over_pi[9] = {0x00000000u, 0xa2f9836eu, 0x4e441529u, 0xfc2757d1u, 0xf534ddc0u,
                                            0xdb629599u, 0x3c439041u, 0xfe5163abu, 0xdebbc561u};

typedef struct {
    eqt_real angle;      /* from -pi/4 to pi/4 */
    eqt_uint32 quadrant; /* how many right angles were subtracted, in the last two bits */
} eqt_reduced;

/* By whole numbers: x = whole 2^shift, and bits of 2 / pi that only give multiples of four right
   angles are left out. */
EQT_INLINE eqt_reduced eqt_reduce(eqt_real x)
{
    const eqt_real size = eqt_abs(x);
    const eqt_bits bits = eqt_bits_of(size);
    eqt_reduced reduced;
    reduced.angle = x;
    reduced.quadrant = 0;
    if (!(size < 0.785398185f)) {
        const eqt_uint64 whole = (bits & 0x007fffffu) | 0x00800000u;
        const int place = (int)(bits >> 23) - 150 + 30; /* of the first bit that counts */
        const eqt_uint32 *word = eqt_2_over_pi + place / 32;
        const int left = place % 32;
        const eqt_uint64 first = ((eqt_uint64)word[0] << 32) | word[1];
        const eqt_uint64 second = ((eqt_uint64)word[1] << 32) | word[2];
        const eqt_uint64 third = ((eqt_uint64)word[2] << 32) | word[3];
        const eqt_uint64 low = whole * (eqt_uint32)(third >> (32 - left));
        const eqt_uint64 middle = whole * (eqt_uint32)(second >> (32 - left)) + (low >> 32);
        const eqt_uint64 high = whole * (eqt_uint32)(first >> (32 - left)) + (middle >> 32);
        const eqt_uint32 top = (eqt_uint32)high;
        /* Its first two bits are the quadrant; what follows is a fraction, which is rounded. */
        eqt_uint64 fraction =
            ((eqt_uint64)((top << 2) | ((eqt_uint32)middle >> 30)) << 32) |
            (eqt_uint32)(((eqt_uint32)middle << 2) | ((eqt_uint32)low >> 30));
        const int negative = (int)(fraction >> 63);
        eqt_real angle;
        reduced.quadrant = (top >> 30) + (eqt_uint32)negative;
        if (negative)
            fraction = ~fraction;
        angle = (eqt_real)fraction * 8.51530395e-20f; /* a right angle over 2^64 */
        reduced.angle = negative ? -angle : angle;
        if (x < 0.0f) {
            reduced.angle = -reduced.angle;
            reduced.quadrant = 0u - reduced.quadrant;
        }
        if (bits > 0x7f7fffffu) /* infinite, or no number */
            reduced.angle = EQT_NAN;
    }
    return reduced;
}

EQT_INLINE eqt_real eqt_sine_part(eqt_real x)
{
    const eqt_real z = x * x;
    const eqt_real less =
        x * (z * ((eqt_real)(1.0 / 6.0) -
                  z * ((eqt_real)(1.0 / 120.0) -
                       z * ((eqt_real)(1.0 / 5040.0) - z * (eqt_real)(1.0 / 362880.0)))));
    return x == 0.0f ? x : x - less; /* the sine of -0 is -0 */
}

EQT_INLINE eqt_real eqt_cosine_part(eqt_real x)
{
    const eqt_real z = x * x, half = 0.5f * z, parabola = 1.0f - half;
    const eqt_real rest = z * z *
                          ((eqt_real)(1.0 / 24.0) +
                           z * ((eqt_real)(-1.0 / 720.0) +
                                z * ((eqt_real)(1.0 / 40320.0) + z * (eqt_real)(-1.0 / 3628800.0))));
    return parabola + (((1.0f - parabola) - half) + rest);
}

EQT_INLINE eqt_real eqt_sin(eqt_real x)
{
    const eqt_reduced turn = eqt_reduce(x);
    const eqt_real size =
        turn.quadrant & 1u ? eqt_cosine_part(turn.angle) : eqt_sine_part(turn.angle);
    return turn.quadrant & 2u ? -size : size;
}

EQT_INLINE eqt_real eqt_cos(eqt_real x)
{
    const eqt_reduced turn = eqt_reduce(x);
    const eqt_real size =
        turn.quadrant & 1u ? eqt_sine_part(turn.angle) : eqt_cosine_part(turn.angle);
    return (turn.quadrant + 1u) & 2u ? -size : size;
}

EQT_INLINE eqt_real eqt_tan(eqt_real x)
{
    const eqt_reduced turn = eqt_reduce(x);
    const eqt_real sine = eqt_sine_part(turn.angle), cosine = eqt_cosine_part(turn.angle);
    return turn.quadrant & 1u ? -cosine / sine : sine / cosine;
}

/* exp and the hyperbolic functions ------------------------------------------------------------- */

#define EQT_LN2_HIGH 0.693359375f /* 9 bits */
#define EQT_LN2_LOW -2.12194440e-4f

/* exp(x) 2^more of a number from -104 to 89; NaN stays. */
EQT_INLINE eqt_real eqt_exp_times(eqt_real x, eqt_real more)
{
    const eqt_real shift = 12582912.0f; /* 1.5 2^23 */
    const eqt_real n = (x * 1.44269504f + shift) - shift;
    const eqt_real near = x - n * EQT_LN2_HIGH, low = n * EQT_LN2_LOW;
    const eqt_real r = near - low, lost = (near - r) - low, z = r * r;
    const eqt_real rest =
        z * (0.5f +
             r * ((eqt_real)(1.0 / 6.0) +
                  r * ((eqt_real)(1.0 / 24.0) +
                       r * ((eqt_real)(1.0 / 120.0) +
                            r * ((eqt_real)(1.0 / 720.0) + r * (eqt_real)(1.0 / 5040.0))))));
    const eqt_real sum = 1.0f + r;
    const eqt_real factor = sum + (((1.0f - sum) + r) + (lost + rest));
    const eqt_real all = n + more, half = (0.5f * all + shift) - shift;
    return (factor * eqt_power_of_2(half)) * eqt_power_of_2(all - half);
}

EQT_INLINE eqt_real eqt_exp(eqt_real x)
{
    return eqt_exp_times(eqt_within(x, -104.0f, 89.0f), 0.0f);
}

/* sinh and cosh of a number from -1 to 1, the first less it. */
EQT_INLINE eqt_real eqt_sinh_less(eqt_real x)
{
    const eqt_real z = x * x;
    return x * (z * ((eqt_real)(1.0 / 6.0) +
                     z * ((eqt_real)(1.0 / 120.0) +
                          z * ((eqt_real)(1.0 / 5040.0) +
                               z * ((eqt_real)(1.0 / 362880.0) + z * (eqt_real)(1.0 / 39916800.0))))));
}

EQT_INLINE eqt_real eqt_sinh(eqt_real x)
{
    const eqt_real size = eqt_abs(x), inside = size < 1.0f ? size : 1.0f;
    const eqt_real half = eqt_exp_times(eqt_within(size, 0.0f, 90.0f), -1.0f);
    const eqt_real large = half - 0.25f / half;
    return eqt_with_sign(size < 1.0f ? inside + eqt_sinh_less(inside) : large, x);
}

EQT_INLINE eqt_real eqt_cosh(eqt_real x)
{
    const eqt_real half = eqt_exp_times(eqt_within(eqt_abs(x), 0.0f, 90.0f), -1.0f);
    return half + 0.25f / half;
}

EQT_INLINE eqt_real eqt_tanh(eqt_real x)
{
    const eqt_real size = eqt_abs(x), inside = size < 1.0f ? size : 1.0f;
    const eqt_real sine = inside + eqt_sinh_less(inside);
    const eqt_real small = sine / eqt_sqrt(1.0f + sine * sine);
    const eqt_real power = eqt_exp_times(eqt_within(size, 0.0f, 10.0f), 0.0f);
    const eqt_real large = 1.0f - 2.0f / (power * power + 1.0f);
    return eqt_with_sign(size < 1.0f ? small : large, x);
}

/* log and the functions that follow from it ---------------------------------------------------- */

EQT_INLINE eqt_real eqt_log(eqt_real x)
{
    /* log(1 + f) = 2 atanh(s) = 2 (s + s^3 / 3 + s^5 / 5 + ...), s = f / (2 + f) */
    const int tiny = x < 1.17549435e-38f;
    const eqt_bits bits = eqt_bits_of(tiny ? x * 33554432.0f : x) + (0x3f800000u - 0x3f3504f3u);
    const eqt_real n = (eqt_real)(int)(bits >> 23) - (tiny ? 152.0f : 127.0f);
    const eqt_real f = eqt_of_bits((bits & 0x007fffffu) + 0x3f3504f3u) - 1.0f;
    const eqt_real s = f / (2.0f + f), z = s * s;
    const eqt_real rest =
        z * ((eqt_real)(2.0 / 3.0) +
             z * ((eqt_real)(2.0 / 5.0) + z * ((eqt_real)(2.0 / 7.0) + z * (eqt_real)(2.0 / 9.0))));
    const eqt_real logarithm = n * EQT_LN2_HIGH + (f - (s * (f - rest) - n * EQT_LN2_LOW));
    if (x > 0.0f && x < EQT_INFINITY)
        return logarithm;
    return x == 0.0f ? -EQT_INFINITY : x > 0.0f ? x : EQT_NAN;
}

/* log(1 + x) of a number that is not below -1/2. */
EQT_INLINE eqt_real eqt_log_of_1_and(eqt_real x)
{
    const eqt_real sum = 1.0f + x;
    const eqt_real lost = x < 1.0f ? x - (sum - 1.0f) : 1.0f - (sum - x);
    return eqt_log(sum) + lost / sum;
}

EQT_INLINE eqt_real eqt_asinh(eqt_real x)
{
    const eqt_real size = eqt_abs(x), near = size < 4096.0f ? size : 4096.0f, z = near * near;
    const eqt_real small = eqt_log_of_1_and(near + z / (1.0f + eqt_sqrt(1.0f + z)));
    const eqt_real large = eqt_log(size) + 0.693147182f;
    return eqt_with_sign(size < 4096.0f ? small : eqt_abs(large), x);
}

EQT_INLINE eqt_real eqt_acosh(eqt_real x)
{
    const eqt_real above = (x < 4096.0f ? x : 4096.0f) - 1.0f;
    const eqt_real small = eqt_log_of_1_and(above + eqt_sqrt(above * (above + 2.0f)));
    if (!(x >= 1.0f))
        return EQT_NAN;
    return x < 4096.0f ? small : eqt_log(x) + 0.693147182f;
}

EQT_INLINE eqt_real eqt_atanh(eqt_real x)
{
    const eqt_real size = eqt_abs(x), near = size < 1.0f ? size : 0.0f;
    const eqt_real logarithm = 0.5f * eqt_log_of_1_and((near + near) / (1.0f - near));
    const eqt_real limit = size == 1.0f ? EQT_INFINITY : EQT_NAN;
    return eqt_with_sign(size < 1.0f ? logarithm : limit, x);
}

/* asin, acos, atan ----------------------------------------------------------------------------- */

#define EQT_RIGHT_ANGLE 1.57079637f
#define EQT_RIGHT_ANGLE_LOW -4.37113883e-8f

/* asin(x) - x of a number up to 1/2, whose square is z. */
EQT_INLINE eqt_real eqt_asin_less(eqt_real x, eqt_real z)
{
    return x * (z * (0.166666663365f +
                     z * (0.0750009476117f +
                          z * (0.0445993191629f +
                               z * (0.0311017278291f +
                                    z * (0.0171437168192f + z * 0.0337007263215f))))));
}

EQT_INLINE eqt_real eqt_asin(eqt_real x)
{
    const eqt_real size = eqt_abs(x), half = 0.5f * (1.0f - size);
    const eqt_real root = eqt_sqrt(half < 0.0f ? 0.0f : half);
    const eqt_real small = size + eqt_asin_less(size, size * size);
    const eqt_real arc = 2.0f * (root + eqt_asin_less(root, half));
    const eqt_real large = EQT_RIGHT_ANGLE - (arc - EQT_RIGHT_ANGLE_LOW);
    return size <= 1.0f ? eqt_with_sign(size < 0.5f ? small : large, x) : EQT_NAN;
}

EQT_INLINE eqt_real eqt_acos(eqt_real x)
{
    const eqt_real size = eqt_abs(x), half = 0.5f * (1.0f - size);
    const eqt_real root = eqt_sqrt(half < 0.0f ? 0.0f : half);
    const eqt_real small = x + eqt_asin_less(x, x * x);
    const eqt_real arc = 2.0f * (root + eqt_asin_less(root, half));
    const eqt_real middle = EQT_RIGHT_ANGLE - (small - EQT_RIGHT_ANGLE_LOW);
    const eqt_real outer = x < 0.0f ? 2.0f * EQT_RIGHT_ANGLE - (arc - 2.0f * EQT_RIGHT_ANGLE_LOW) : arc;
    return size <= 1.0f ? (size < 0.5f ? middle : outer) : EQT_NAN;
}

EQT_INLINE eqt_real eqt_atan(eqt_real x)
{
    /* atan(x) = atan(c) + atan((x - c) / (1 + c x)) with c = 0, 1/2, 1, 3/2 or infinity. */
    const eqt_real size = eqt_abs(x);
    eqt_real above = size, below = 1.0f, high = 0.0f, low = 0.0f, t, z, less;
    if (size > 2.4375f) {
        above = -1.0f;
        below = size;
        high = EQT_RIGHT_ANGLE;
        low = EQT_RIGHT_ANGLE_LOW;
    } else if (size > 1.1875f) {
        above = size - 1.5f;
        below = 1.0f + 1.5f * size;
        high = 0.982793748f;
        low = -2.43187859e-8f;
    } else if (size > 0.6875f) {
        above = size - 1.0f;
        below = size + 1.0f;
        high = 0.785398185f;
        low = -2.18556941e-8f;
    } else if (size > 0.4375f) {
        above = (size + size) - 1.0f;
        below = 2.0f + size;
        high = 0.463647604f;
        low = 5.01215869e-9f;
    }
    t = above / below;
    z = t * t;
    less = t * (z * (0.333333307125f +
                     z * (-0.199993134595f +
                          z * (0.142565370879f + z * (-0.106680186989f + z * 0.0621472267021f)))));
    return eqt_with_sign(size == size ? high - ((less - low) - t) : size, x);
}

/* pow, by way of double ------------------------------------------------------------------------ */

/* |x|^y of numbers that are finite and not 0, to about 30 bits. */
EQT_INLINE eqt_real eqt_power(eqt_real x, eqt_real y)
{
    const int tiny = x < 1.17549435e-38f;
    const eqt_bits bits = eqt_bits_of(tiny ? x * 33554432.0f : x) + (0x3f800000u - 0x3f3504f3u);
    const double n = (double)(int)(bits >> 23) - (tiny ? 152.0 : 127.0);
    const double f = (double)eqt_of_bits((bits & 0x007fffffu) + 0x3f3504f3u) - 1.0;
    const double s = f / (2.0 + f), z = s * s;
    const double series =
        1.0 + z * (1.0 / 3.0 +
                   z * (1.0 / 5.0 +
                        z * (1.0 / 7.0 +
                             z * (1.0 / 9.0 + z * (1.0 / 11.0 + z * (1.0 / 13.0 + z / 15.0))))));
    const double exponent = y * (n + 2.0 * 1.4426950408889634 * s * series); /* to the base 2 */
    const double near = exponent < -160.0 ? -160.0 : exponent > 130.0 ? 130.0 : exponent;
    const double whole = (near + 6755399441055744.0) - 6755399441055744.0; /* 1.5 2^52 */
    const double r = (near - whole) * 0.6931471805599453;
    const double factor =
        1.0 +
        r * (1.0 +
             r * (1.0 / 2.0 +
                  r * (1.0 / 6.0 +
                       r * (1.0 / 24.0 +
                            r * (1.0 / 120.0 +
                                 r * (1.0 / 720.0 + r * (1.0 / 5040.0 + r / 40320.0)))))));
    const eqt_uint64 scale = (eqt_uint64)((int)whole + 1023) << 52;
    double power;
    __builtin_memcpy(&power, &scale, sizeof power);
    return (eqt_real)(factor * power);
}

/* Whether a number that is not negative is whole. */
EQT_INLINE int eqt_whole(eqt_real x)
{
    return x >= 8388608.0f || ((x + 8388608.0f) - 8388608.0f) == x; /* 2^23 */
}

EQT_INLINE eqt_real eqt_pow(eqt_real x, eqt_real y)
{
    const eqt_real size = eqt_abs(x), degree = eqt_abs(y);
    const int minus = (eqt_bits_of(x) & EQT_SIGN_BIT) != 0;
    const int proper = size > 0.0f && size < EQT_INFINITY;
    const eqt_real shrinks = y < 0.0f ? 0.0f : EQT_INFINITY, grows = y < 0.0f ? EQT_INFINITY : 0.0f;
    eqt_real power = size < 1.0f ? grows : shrinks;
    if (y == 0.0f || x == 1.0f)
        return 1.0f;
    if (x != x || y != y)
        return EQT_NAN;
    if (size == 1.0f && degree == EQT_INFINITY)
        return 1.0f;
    if (proper && degree < EQT_INFINITY)
        power = eqt_power(size, y);
    if (!minus)
        return power;
    if (eqt_whole(degree))
        return eqt_whole(0.5f * degree) ? power : -power;
    return proper ? EQT_NAN : power;
}

#endif
