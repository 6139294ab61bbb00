/* Elementary functions of eqt_real, in all lanes at once, the same bits on every machine.

   They consist of + - * / sqrt, comparisons, selections and operations on bits, which IEEE 754 and
   C fix where the compiler contracts nothing (-ffp-contract=off) and rounds to nearest. No lane
   sees another. Special values are those of C99, Annex F. A NaN is 0x7ff8000000000000, but for
   those of eqt_sqrt and eqt_abs. Angles may have any size.

   Largest errors against mpmath, in units in the last place, of some 100,000 normal results each:
       eqt_sin   0.80
       eqt_cos   0.80
       eqt_tan   0.90
       eqt_asin  0.85
       eqt_acos  0.90
       eqt_atan  0.75
       eqt_sinh  0.80
       eqt_cosh  0.80
       eqt_tanh  0.85
       eqt_asinh 1.10
       eqt_acosh 1.00
       eqt_atanh 0.80
       eqt_exp   0.65
       eqt_log   0.80
       eqt_sqrt  0.50
       eqt_abs   0.00
       eqt_floor 0.00
       eqt_pow   0.70

   The coefficients of sin, cos, log, asin, acos and atan are those of fdlibm 5.3 (Sun
   Microsystems, 1993, "freely granted"). exp, sinh, cosh and tanh sum the series of sinh and cosh,
   and pow that of atanh, whose coefficients need no source. Sums and products with their errors
   are Dekker's (1971); angles beyond 1e8 are reduced after Payne and Hanek (1983). */
/* It is included behind lanes.h. */
#ifndef EQT_FUNCTIONS_H
#define EQT_FUNCTIONS_H

/* Signs, special values, exact operations ------------------------------------------------------ */

typedef struct {
    eqt_real high, low;
} eqt_pair; /* stands for high + low, where low is at most a rounding error of high */

#define EQT_SIGN_BIT 0x8000000000000000ULL

EQT_INLINE eqt_real eqt_infinity(void)
{
    return eqt_of_bits(eqt_bits_constant(0x7ff0000000000000ULL));
}

EQT_INLINE eqt_real eqt_nan(void)
{
    return eqt_of_bits(eqt_bits_constant(0x7ff8000000000000ULL));
}

EQT_INLINE eqt_real eqt_abs(eqt_real x)
{
    return eqt_of_bits(eqt_bits_of(x) & eqt_bits_constant(~EQT_SIGN_BIT));
}

/* x, which is not negative, with the sign of another number. */
EQT_INLINE eqt_real eqt_with_sign(eqt_real x, eqt_real sign)
{
    return eqt_of_bits(eqt_bits_of(x) | (eqt_bits_of(sign) & eqt_bits_constant(EQT_SIGN_BIT)));
}

/* x, and the one NaN for any NaN. */
EQT_INLINE eqt_real eqt_canonical(eqt_real x)
{
    return eqt_select(eqt_equal(x, x), x, eqt_nan());
}

EQT_INLINE eqt_pair eqt_pair_of(eqt_real x)
{
    eqt_pair pair;
    pair.high = x;
    pair.low = eqt_constant(0.0);
    return pair;
}

/* x, but no more than a bound, or no less and no more; NaN stays. */
EQT_INLINE eqt_real eqt_at_most(eqt_real x, double most)
{
    return eqt_select(eqt_less(eqt_constant(most), x), eqt_constant(most), x);
}

EQT_INLINE eqt_real eqt_within(eqt_real x, double least, double most)
{
    const eqt_real bound = eqt_constant(least);
    return eqt_at_most(eqt_select(eqt_less(x, bound), bound, x), most);
}

/* a + b, where |a| >= |b| or a is a multiple of the last place of b. */
EQT_INLINE eqt_pair eqt_ordered_sum(eqt_real a, eqt_real b)
{
    eqt_pair sum;
    sum.high = a + b;
    sum.low = b - (sum.high - a);
    return sum;
}

/* The upper 26 bits of a number below 1e300. */
EQT_INLINE eqt_real eqt_upper_half(eqt_real x)
{
    const eqt_real shifted = x * eqt_constant(134217729.0); /* 2^27 + 1 */
    return shifted - (shifted - x);
}

EQT_INLINE eqt_pair eqt_exact_product(eqt_real a, eqt_real b)
{
    const eqt_real a1 = eqt_upper_half(a), a2 = a - a1;
    const eqt_real b1 = eqt_upper_half(b), b2 = b - b1;
    eqt_pair product;
    product.high = a * b;
    product.low = a2 * b2 - (((product.high - a1 * b1) - a2 * b1) - a1 * b2);
    return product;
}

EQT_INLINE eqt_pair eqt_pair_product(eqt_pair a, eqt_pair b)
{
    const eqt_pair product = eqt_exact_product(a.high, b.high);
    return eqt_ordered_sum(product.high, product.low + (a.high * b.low + a.low * b.high));
}

/* a / b, to about 100 bits. */
EQT_INLINE eqt_pair eqt_pair_quotient(eqt_pair a, eqt_pair b)
{
    const eqt_real inverse = eqt_constant(1.0) / b.high;
    const eqt_real guess = a.high * inverse;
    const eqt_pair product = eqt_exact_product(guess, b.high);
    const eqt_real rest = ((a.high - product.high) - product.low) + (a.low - guess * b.low);
    return eqt_ordered_sum(guess, rest * inverse);
}

/* Powers of two -------------------------------------------------------------------------------- */

/* 2^n of a whole number from -1022 to 1023. */
EQT_INLINE eqt_real eqt_power_of_2(eqt_real n)
{
    const eqt_real shifted = n + eqt_constant(6755399441056767.0); /* 1.5 2^52 + 1023 */
    return eqt_of_bits(eqt_bits_of(shifted) << eqt_bits_constant(52));
}

typedef struct {
    eqt_real factor, exponent;
} eqt_parts;

/* x > 0 as factor 2^exponent, with the factor between sqrt(1/2) and sqrt(2). */
EQT_INLINE eqt_parts eqt_split(eqt_real x)
{
    const eqt_mask tiny = eqt_less(x, eqt_constant(2.2250738585072014e-308));
    const eqt_real normal = eqt_select(tiny, x * eqt_constant(18014398509481984.0), x);
    const eqt_bits half_root = eqt_bits_constant(0x3fe6a09e667f3bcdULL);
    const eqt_bits one = eqt_bits_constant(0x3ff0000000000000ULL);
    const eqt_bits bits = eqt_bits_of(normal) + (one - half_root);
    const eqt_bits two_to_52 = eqt_bits_constant(0x4330000000000000ULL);
    const eqt_bits biased = (bits >> eqt_bits_constant(52)) | two_to_52;
    eqt_parts parts;
    parts.exponent = (eqt_of_bits(biased) - eqt_constant(4503599627371519.0)) /* 2^52 + 1023 */
                     - eqt_select(tiny, eqt_constant(54.0), eqt_constant(0.0));
    parts.factor = eqt_of_bits((bits & eqt_bits_constant(0x000fffffffffffffULL)) + half_root);
    return parts;
}

#define EQT_LN2_HIGH 6.93147180369123816490e-01 /* 32 bits */
#define EQT_LN2_LOW 1.90821492927058770002e-10

/* sin, cos, tan -------------------------------------------------------------------------------- */

typedef struct {
    eqt_pair angle;    /* from -pi/4 to pi/4 */
    eqt_bits quadrant; /* how many right angles were subtracted, in the last two bits */
} eqt_reduced;

/* An angle less the nearest multiple of a right angle, which is 27 + 24 + 24 + 53 bits: products
   with its first three parts are exact up to 2^26 right angles. */
EQT_INLINE eqt_reduced eqt_reduce(eqt_real x)
{
    const eqt_real shift = eqt_constant(6755399441055744.0); /* 1.5 2^52 */
    const eqt_real shifted = x * eqt_constant(6.36619772367581382433e-01) + shift;
    const eqt_real n = shifted - shift;
    const eqt_real first = x - n * eqt_constant(1.57079632580280303955e+00);
    const eqt_pair second = eqt_ordered_sum(first, -(n * eqt_constant(9.92093573959351715530e-10)));
    const eqt_pair third =
        eqt_ordered_sum(second.high, -(n * eqt_constant(5.72118870966357490380e-18)));
    eqt_reduced reduced;
    reduced.angle.high = third.high;
    reduced.angle.low = (second.low + third.low) - n * eqt_constant(1.64462569363242576015e-26);
    reduced.quadrant = eqt_bits_of(shifted);
    return reduced;
}

/* 0, and 2 / pi in words of 32 bits. */
static const eqt_uint32 eqt_2_over_pi[39] = {
    0x00000000u, 0xa2f9836eu, 0x4e441529u, 0xfc2757d1u, 0xf534ddc0u, 0xdb629599u, 0x3c439041u,
    0xfe5163abu, 0xdebbc561u, 0xb7246e3au, 0x424dd2e0u, 0x06492eeau, 0x09d1921cu, 0xfe1deb1cu,
    0xb129a73eu, 0xe88235f5u, 0x2ebb4484u, 0xe99c7026u, 0xb45f7e41u, 0x3991d639u, 0x835339f4u,
    0x9c845f8bu, 0xbdf9283bu, 0x1ff897ffu, 0xde05980fu, 0xef2f118bu, 0x5a0a6d1fu, 0x6d367ecfu,
    0x27cb09b7u, 0x4f463f66u, 0x9e5fea2du, 0x7527bac7u, 0xebe5f17bu, 0x3d0739f7u, 0x8a5292eau,
    0x6bfb5fb1u, 0x1f8d5d08u, 0x56033046u, 0xfc7b6babu
};

/* A finite number above 2^26 over a right angle, by whole numbers: x = whole 2^shift, and bits of
   2 / pi that only give multiples of four right angles are left out. */
EQT_RARE void eqt_far_turn(double x, double fraction[3], eqt_uint64 *quadrant)
{
    eqt_uint32 product[6], window[6];
    union {
        double number;
        eqt_uint64 bits;
    } of_x;
    eqt_uint64 bits, whole, sum, carry = 0;
    int shift, place, word, negative;
    const double two_to_48 = 281474976710656.0;
    of_x.number = x;
    bits = of_x.bits;
    whole = (bits & 0x000fffffffffffffULL) | 0x0010000000000000ULL;
    shift = (int)((bits >> 52) & 0x7ff) - 1075;
    place = (shift + 30) & 1023; /* of the first bit that counts; a near angle finds bits, too */
    for (word = 0; word < 6; word++) {
        const int from = place / 32 + word;
        sum = ((eqt_uint64)eqt_2_over_pi[from] << 32) | eqt_2_over_pi[from + 1];
        window[word] = (eqt_uint32)(sum >> (32 - place % 32));
    }
    for (word = 5; word >= 0; word--) {
        sum = window[word] * (whole & 0xffffffffu) + carry;
        product[word] = (eqt_uint32)sum;
        carry = sum >> 32;
    }
    carry = 0;
    for (word = 5; word >= 1; word--) {
        sum = window[word] * (whole >> 32) + product[word - 1] + carry;
        product[word - 1] = (eqt_uint32)sum;
        carry = sum >> 32;
    }
    /* Its first two bits are the quadrant; what follows is a fraction, which is rounded. */
    *quadrant = product[0] >> 30;
    for (word = 0; word < 5; word++)
        product[word] = (product[word] << 2) | (product[word + 1] >> 30);
    negative = product[0] >> 31;
    if (negative) {
        *quadrant += 1;
        for (word = 0; word < 5; word++)
            product[word] = ~product[word];
    }
    fraction[0] = (double)(((eqt_uint64)product[0] << 16) | (product[1] >> 16)) / two_to_48;
    fraction[1] = (double)(((eqt_uint64)(product[1] & 0xffffu) << 32) | product[2]) / two_to_48;
    fraction[2] = (double)(((eqt_uint64)product[3] << 16) | (product[4] >> 16)) / two_to_48;
    fraction[1] /= two_to_48;
    fraction[2] /= two_to_48 * two_to_48;
    for (word = 0; word < 3; word++)
        fraction[word] = negative != (int)(bits >> 63) ? -fraction[word] : fraction[word];
    if (bits >> 63)
        *quadrant = 0 - *quadrant;
    if (shift > 971) /* infinite, or no number */
        fraction[0] = x - x;
}

EQT_INLINE eqt_mask eqt_is_far(eqt_real x)
{
    return eqt_less(eqt_constant(105414356.0), eqt_abs(x));
}

EQT_INLINE eqt_reduced eqt_reduce_far(eqt_real x)
{
    double fraction[3];
    eqt_uint64 quadrant;
    eqt_real high, middle, low;
    eqt_pair turn, right;
    eqt_reduced reduced;
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++) {
        eqt_far_turn(EQT_LANE(x, lane), fraction, &quadrant);
        EQT_LANE(high, lane) = fraction[0];
        EQT_LANE(middle, lane) = fraction[1];
        EQT_LANE(low, lane) = fraction[2];
        EQT_LANE(reduced.quadrant, lane) = quadrant;
    }
    turn = eqt_ordered_sum(high, middle);
    turn = eqt_ordered_sum(turn.high, turn.low + low);
    right.high = eqt_constant(1.57079632679489655800e+00);
    right.low = eqt_constant(6.12323399573676603587e-17);
    reduced.angle = eqt_pair_product(turn, right);
    return reduced;
}

/* The sine of a reduced angle. */
EQT_INLINE eqt_pair eqt_sine_part(eqt_pair angle)
{
    const eqt_real x = angle.high, z = x * x, w = z * z;
    const eqt_real odd = eqt_constant(8.33333333332248946124e-03) +
                         w * (eqt_constant(2.75573137070700676789e-06) +
                              w * eqt_constant(1.58969099521155010221e-10));
    const eqt_real even =
        eqt_constant(-1.98412698298579493134e-04) + w * eqt_constant(-2.50507602534068634195e-08);
    const eqt_real cubic = z * x;
    /* What x exceeds its sine by: subtracted, so that the sine of -0 is -0. */
    const eqt_real halved = eqt_constant(0.5) * angle.low - cubic * (odd + z * even);
    const eqt_real excess =
        (z * halved - angle.low) - cubic * eqt_constant(-1.66666666666666324348e-01);
    return eqt_ordered_sum(x, -excess);
}

/* The cosine of a reduced angle. */
EQT_INLINE eqt_pair eqt_cosine_part(eqt_pair angle)
{
    const eqt_real x = angle.high, z = x * x, w = z * z;
    const eqt_real even = eqt_constant(4.16666666666666019037e-02) +
                          w * (eqt_constant(2.48015872894767294178e-05) +
                               w * eqt_constant(2.08757232129817482790e-09));
    const eqt_real odd = eqt_constant(-1.38888888888741095749e-03) +
                         w * (eqt_constant(-2.75573143513906633035e-07) +
                              w * eqt_constant(-1.13596475577881948265e-11));
    const eqt_pair parabola = eqt_ordered_sum(eqt_constant(1.0), eqt_constant(-0.5) * z);
    return eqt_ordered_sum(parabola.high, parabola.low + (w * (even + z * odd) - x * angle.low));
}

typedef struct {
    eqt_real sine, cosine;
} eqt_sine_and_cosine;

EQT_INLINE eqt_sine_and_cosine eqt_sincos_of(eqt_reduced reduced)
{
    const eqt_real sine = eqt_sine_part(reduced.angle).high;
    const eqt_real cosine = eqt_cosine_part(reduced.angle).high;
    const eqt_mask odd = eqt_any_bit(reduced.quadrant & eqt_bits_constant(1));
    const eqt_bits next = reduced.quadrant + eqt_bits_constant(1);
    const eqt_bits sign = eqt_bits_constant(EQT_SIGN_BIT), left = eqt_bits_constant(62);
    const eqt_bits s = eqt_bits_of(eqt_select(odd, cosine, sine));
    const eqt_bits c = eqt_bits_of(eqt_select(odd, sine, cosine));
    eqt_sine_and_cosine both;
    both.sine = eqt_canonical(eqt_of_bits(s ^ ((reduced.quadrant << left) & sign)));
    both.cosine = eqt_canonical(eqt_of_bits(c ^ ((next << left) & sign)));
    return both;
}

EQT_INLINE eqt_real eqt_tan_of(eqt_reduced reduced)
{
    const eqt_pair sine = eqt_sine_part(reduced.angle), cosine = eqt_cosine_part(reduced.angle);
    const eqt_mask odd = eqt_any_bit(reduced.quadrant & eqt_bits_constant(1));
    eqt_pair above, below;
    above.high = eqt_select(odd, -cosine.high, sine.high);
    above.low = eqt_select(odd, -cosine.low, sine.low);
    below.high = eqt_select(odd, sine.high, cosine.high);
    below.low = eqt_select(odd, sine.low, cosine.low);
    return eqt_canonical(eqt_pair_quotient(above, below).high);
}

EQT_RARE void eqt_far_sincos(const eqt_real *x, eqt_sine_and_cosine *both)
{
    *both = eqt_sincos_of(eqt_reduce_far(*x));
}

EQT_RARE void eqt_far_tan(const eqt_real *x, eqt_real *tangent)
{
    *tangent = eqt_tan_of(eqt_reduce_far(*x));
}

/* Both at once. After inlining, compilers also find what eqt_sin(x) and eqt_cos(x) share. */
EQT_INLINE eqt_sine_and_cosine eqt_sincos(eqt_real x)
{
    const eqt_mask is_far = eqt_is_far(x);
    eqt_sine_and_cosine both = eqt_sincos_of(eqt_reduce(x));
    if (eqt_any(is_far)) {
        const eqt_real copy = x;
        eqt_sine_and_cosine far;
        eqt_far_sincos(&copy, &far);
        both.sine = eqt_select(is_far, far.sine, both.sine);
        both.cosine = eqt_select(is_far, far.cosine, both.cosine);
    }
    return both;
}

EQT_INLINE eqt_real eqt_sin(eqt_real x) { return eqt_sincos(x).sine; }
EQT_INLINE eqt_real eqt_cos(eqt_real x) { return eqt_sincos(x).cosine; }

EQT_INLINE eqt_real eqt_tan(eqt_real x)
{
    const eqt_mask is_far = eqt_is_far(x);
    eqt_real tangent = eqt_tan_of(eqt_reduce(x));
    if (eqt_any(is_far)) {
        const eqt_real copy = x;
        eqt_real far;
        eqt_far_tan(&copy, &far);
        tangent = eqt_select(is_far, far, tangent);
    }
    return eqt_select(eqt_less(eqt_abs(x), eqt_constant(1e-8)), x, tangent);
}

/* exp and the hyperbolic functions ------------------------------------------------------------- */

typedef struct {
    eqt_real n;            /* how many ln 2 were subtracted */
    eqt_pair x;            /* what is left, from -ln(2)/2 to ln(2)/2 */
    eqt_real sine, cosine; /* sinh of it less it, cosh of it less 1 */
} eqt_hyperbola;

/* high + low less the nearest multiple of ln 2, and what exponentials of it consist of. */
EQT_INLINE eqt_hyperbola eqt_hyperbolic(eqt_real high, eqt_real low)
{
    const eqt_real shift = eqt_constant(6755399441055744.0); /* 1.5 2^52 */
    eqt_hyperbola parts;
    eqt_real z, x;
    parts.n = (high * eqt_constant(1.44269504088896338700) + shift) - shift;
    parts.x = eqt_ordered_sum(high - parts.n * eqt_constant(EQT_LN2_HIGH),
                              low - parts.n * eqt_constant(EQT_LN2_LOW));
    x = parts.x.high;
    z = x * x;
    parts.cosine =
        z * (eqt_constant(1.0 / 2.0) +
             z * (eqt_constant(1.0 / 24.0) +
                  z * (eqt_constant(1.0 / 720.0) +
                       z * (eqt_constant(1.0 / 40320.0) +
                            z * (eqt_constant(1.0 / 3628800.0) +
                                 z * eqt_constant(1.0 / 479001600.0)))))) +
        x * parts.x.low;
    parts.sine =
        x * (z * (eqt_constant(1.0 / 6.0) +
                  z * (eqt_constant(1.0 / 120.0) +
                       z * (eqt_constant(1.0 / 5040.0) +
                            z * (eqt_constant(1.0 / 362880.0) +
                                 z * (eqt_constant(1.0 / 39916800.0) +
                                      z * eqt_constant(1.0 / 6227020800.0))))))) +
        parts.x.low;
    return parts;
}

/* exp(high + low) of numbers from -746 to 710; NaN stays. */
EQT_INLINE eqt_real eqt_exp_of_sum(eqt_real high, eqt_real low)
{
    const eqt_hyperbola parts = eqt_hyperbolic(high, low);
    const eqt_pair first = eqt_ordered_sum(eqt_constant(1.0), parts.x.high);
    const eqt_real factor = first.high + (first.low + (parts.cosine + parts.sine));
    const eqt_real shift = eqt_constant(6755399441055744.0); /* 1.5 2^52 */
    const eqt_real halved = (eqt_constant(0.5) * parts.n + shift) - shift;
    return (factor * eqt_power_of_2(halved)) * eqt_power_of_2(parts.n - halved);
}

EQT_INLINE eqt_real eqt_exp(eqt_real x)
{
    const eqt_real near = eqt_within(x, -746.0, 710.0);
    return eqt_canonical(eqt_exp_of_sum(near, eqt_constant(0.0)));
}

typedef struct {
    eqt_real sine, cosine;
} eqt_sinh_and_cosh;

/* sinh and cosh of a number from 0 to 711, times 2^-512 above 600. */
EQT_INLINE eqt_sinh_and_cosh eqt_sinhcosh(eqt_real x)
{
    const eqt_hyperbola parts = eqt_hyperbolic(x, eqt_constant(0.0));
    const eqt_real n = parts.n - eqt_select(eqt_less(eqt_constant(600.0), x), eqt_constant(512.0),
                                            eqt_constant(0.0));
    const eqt_real up = eqt_power_of_2(n - eqt_constant(1.0));
    const eqt_real down = eqt_power_of_2(eqt_constant(-1.0) - n);
    const eqt_pair plus = eqt_ordered_sum(up, down), minus = eqt_ordered_sum(up, -down);
    const eqt_real rising = up * parts.x.high, falling = down * parts.x.high;
    const eqt_pair s1 = eqt_ordered_sum(minus.high, rising), s2 = eqt_ordered_sum(s1.high, falling);
    const eqt_pair c1 = eqt_ordered_sum(plus.high, rising), c2 = eqt_ordered_sum(c1.high, -falling);
    eqt_sinh_and_cosh both;
    both.sine = s2.high + ((s1.low + s2.low + minus.low) +
                           (parts.cosine * minus.high + parts.sine * plus.high));
    both.cosine = c2.high + ((c1.low + c2.low + plus.low) +
                             (parts.cosine * plus.high + parts.sine * minus.high));
    return both;
}

EQT_INLINE eqt_real eqt_unscaled(eqt_real scaled, eqt_real x)
{
    return scaled * eqt_select(eqt_less(eqt_constant(600.0), x),
                               eqt_constant(1.3407807929942597e154), /* 2^512 */
                               eqt_constant(1.0));
}

EQT_INLINE eqt_real eqt_sinh(eqt_real x)
{
    const eqt_real size = eqt_abs(x);
    const eqt_real near = eqt_at_most(size, 711.0);
    const eqt_real sine = eqt_unscaled(eqt_sinhcosh(near).sine, near);
    const eqt_mask tiny = eqt_less(size, eqt_constant(1e-8));
    return eqt_canonical(eqt_with_sign(eqt_select(tiny, size, sine), x));
}

EQT_INLINE eqt_real eqt_cosh(eqt_real x)
{
    const eqt_real size = eqt_abs(x);
    const eqt_real near = eqt_at_most(size, 711.0);
    return eqt_canonical(eqt_unscaled(eqt_sinhcosh(near).cosine, near));
}

EQT_INLINE eqt_real eqt_tanh(eqt_real x)
{
    /* (e^2x - 1) / (e^2x + 1), whose errors above and below are the same and nearly cancel */
    const eqt_real size = eqt_abs(x), one = eqt_constant(1.0);
    const eqt_mask tiny = eqt_less(size, eqt_constant(1e-8));
    const eqt_real near = eqt_at_most(size, 22.0);
    const eqt_hyperbola parts = eqt_hyperbolic(near + near, eqt_constant(0.0));
    const eqt_real power = eqt_power_of_2(parts.n);
    const eqt_pair sum = eqt_ordered_sum(power, power * parts.x.high);
    const eqt_real more = sum.low + power * (parts.cosine + parts.sine);
    eqt_pair above = eqt_ordered_sum(sum.high, -one), below = eqt_ordered_sum(sum.high, one);
    eqt_real quotient;
    above = eqt_ordered_sum(above.high, above.low + more);
    below = eqt_ordered_sum(below.high, below.low + more);
    quotient = eqt_pair_quotient(above, below).high;
    return eqt_canonical(eqt_with_sign(eqt_select(tiny, size, quotient), x));
}

/* log and the inverse hyperbolic functions ----------------------------------------------------- */

/* log(factor 2^exponent (1 + rest)), where rest is tiny. */
EQT_INLINE eqt_real eqt_log_of_parts(eqt_parts parts, eqt_real rest)
{
    const eqt_real f = parts.factor - eqt_constant(1.0), s = f / (eqt_constant(2.0) + f);
    const eqt_real z = s * s, w = z * z, halved = eqt_constant(0.5) * f * f;
    const eqt_real even = w * (eqt_constant(3.999999999940941908e-01) +
                               w * (eqt_constant(2.222219843214978396e-01) +
                                    w * eqt_constant(1.531383769920937332e-01)));
    const eqt_real odd = z * (eqt_constant(6.666666666666735130e-01) +
                              w * (eqt_constant(2.857142874366239149e-01) +
                                   w * (eqt_constant(1.818357216161805012e-01) +
                                        w * eqt_constant(1.479819860511658591e-01))));
    const eqt_real low = parts.exponent * eqt_constant(EQT_LN2_LOW) + rest;
    return parts.exponent * eqt_constant(EQT_LN2_HIGH) -
           ((halved - (s * (halved + (even + odd)) + low)) - f);
}

EQT_INLINE eqt_real eqt_log(eqt_real x)
{
    const eqt_real finite = eqt_log_of_parts(eqt_split(x), eqt_constant(0.0));
    const eqt_real limit = eqt_select(eqt_equal(x, eqt_constant(0.0)), -eqt_infinity(),
                                      eqt_select(eqt_equal(x, eqt_infinity()), x, eqt_nan()));
    return eqt_select(eqt_less(eqt_constant(0.0), x) & eqt_less(x, eqt_infinity()), finite, limit);
}

/* log(1 + high + low) of what is not negative and not above 1e300. */
EQT_INLINE eqt_real eqt_log_of_1_and(eqt_real high, eqt_real low)
{
    const eqt_mask above = eqt_less(eqt_constant(1.0), high);
    const eqt_real one = eqt_constant(1.0);
    const eqt_pair sum =
        eqt_ordered_sum(eqt_select(above, high, one), eqt_select(above, one, high));
    return eqt_log_of_parts(eqt_split(sum.high), (sum.low + low) / sum.high);
}

EQT_INLINE eqt_real eqt_asinh(eqt_real x)
{
    const eqt_real size = eqt_abs(x), one = eqt_constant(1.0);
    const eqt_mask large = eqt_less(eqt_constant(1e9), size);
    const eqt_real near = eqt_select(large, one, size), square = near * near;
    const eqt_pair sum = eqt_ordered_sum(near, square / (one + eqt_sqrt(one + square)));
    const eqt_real within = eqt_log_of_1_and(sum.high, sum.low);
    const eqt_real beyond = eqt_log(size) + eqt_constant(6.93147180559945286227e-01);
    return eqt_canonical(eqt_with_sign(eqt_select(large, beyond, within), x));
}

EQT_INLINE eqt_real eqt_acosh(eqt_real x)
{
    /* log(1 + t + sqrt(t (t + 2))), t = x - 1 */
    const eqt_real one = eqt_constant(1.0), two = eqt_constant(2.0);
    const eqt_mask large = eqt_less(eqt_constant(1e9), x), far = eqt_less(one, x);
    const eqt_real t = eqt_select(large, one, x) - one;
    const eqt_pair factor = eqt_ordered_sum(eqt_select(eqt_less(t, two), two, t),
                                            eqt_select(eqt_less(t, two), t, two));
    const eqt_pair product = eqt_exact_product(t, factor.high);
    const eqt_real root = eqt_sqrt(product.high);
    const eqt_pair square = eqt_exact_product(root, root);
    const eqt_real missing =
        (product.high - square.high) + ((product.low - square.low) + t * factor.low);
    const eqt_pair sum = eqt_ordered_sum(root, t);
    const eqt_real rest = missing / (two * eqt_select(far, root, one));
    const eqt_real within = eqt_log_of_1_and(sum.high, sum.low + rest);
    const eqt_real beyond = eqt_log(x) + eqt_constant(6.93147180559945286227e-01);
    const eqt_real arc = eqt_select(large, beyond, within);
    return eqt_canonical(eqt_select(eqt_less(x, one), eqt_nan(), arc));
}

EQT_INLINE eqt_real eqt_atanh(eqt_real x)
{
    const eqt_real size = eqt_abs(x), one = eqt_constant(1.0);
    const eqt_mask inside = eqt_less(size, one);
    const eqt_real near = eqt_select(inside, size, eqt_constant(0.0));
    const eqt_mask tiny = eqt_less(size, eqt_constant(1e-8));
    const eqt_pair sum = eqt_pair_quotient(eqt_pair_of(near + near), eqt_ordered_sum(one, -near));
    const eqt_real logarithm = eqt_log_of_1_and(sum.high, sum.low);
    const eqt_real within = eqt_select(tiny, near, eqt_constant(0.5) * logarithm);
    const eqt_real limit = eqt_select(eqt_equal(size, one), eqt_infinity(), eqt_nan());
    return eqt_canonical(eqt_with_sign(eqt_select(inside, within, limit), x));
}

/* asin, acos, atan ----------------------------------------------------------------------------- */

typedef struct {
    eqt_mask small;           /* |x| < 1/2 */
    eqt_real x;               /* then |x|, else sqrt((1 - |x|) / 2) */
    eqt_real upper, rest;     /* the latter's upper half, and the root less it */
    eqt_real more;            /* asin(x) - x */
} eqt_arc;

EQT_INLINE eqt_arc eqt_arc_of(eqt_real size)
{
    const eqt_real one = eqt_constant(1.0), halved = eqt_constant(0.5);
    eqt_arc arc;
    eqt_real z, above, below, sum;
    arc.small = eqt_less(size, halved);
    z = eqt_select(arc.small, size * size, (one - size) * halved);
    arc.x = eqt_select(arc.small, size, eqt_sqrt(z));
    arc.upper = eqt_upper_half(arc.x);
    sum = arc.x + arc.upper;
    arc.rest = (z - arc.upper * arc.upper) / eqt_select(eqt_less(eqt_constant(0.0), sum), sum, one);
    above = z * (eqt_constant(1.66666666666666657415e-01) +
                 z * (eqt_constant(-3.25565818622400915405e-01) +
                      z * (eqt_constant(2.01212532134862925881e-01) +
                           z * (eqt_constant(-4.00555345006794114027e-02) +
                                z * (eqt_constant(7.91534994289814532176e-04) +
                                     z * eqt_constant(3.47933107596021167570e-05))))));
    below = one + z * (eqt_constant(-2.40339491173441421878e+00) +
                       z * (eqt_constant(2.02094576023350569471e+00) +
                            z * (eqt_constant(-6.88283971605453293030e-01) +
                                 z * eqt_constant(7.70381505559019352791e-02))));
    arc.more = arc.x * (above / below);
    return arc;
}

#define EQT_RIGHT_ANGLE 1.57079632679489655800e+00
#define EQT_RIGHT_ANGLE_LOW 6.12323399573676603587e-17
#define EQT_ABOVE_1 1.0000000000000002

EQT_INLINE eqt_real eqt_asin(eqt_real x)
{
    const eqt_real size = eqt_abs(x), two = eqt_constant(2.0);
    const eqt_arc arc = eqt_arc_of(size);
    const eqt_real eighth = eqt_constant(7.85398163397448278999e-01); /* half a right angle */
    const eqt_real low = two * (arc.more + arc.rest) - eqt_constant(EQT_RIGHT_ANGLE_LOW);
    const eqt_real large = eighth - (low - (eighth - two * arc.upper));
    const eqt_real angle = eqt_select(arc.small, size + arc.more, large);
    const eqt_mask defined = eqt_less(size, eqt_constant(EQT_ABOVE_1));
    return eqt_select(defined, eqt_with_sign(angle, x), eqt_nan());
}

EQT_INLINE eqt_real eqt_acos(eqt_real x)
{
    const eqt_real size = eqt_abs(x), two = eqt_constant(2.0);
    const eqt_arc arc = eqt_arc_of(size);
    const eqt_real right = eqt_constant(EQT_RIGHT_ANGLE), low = eqt_constant(EQT_RIGHT_ANGLE_LOW);
    const eqt_real more = eqt_with_sign(arc.more, x);
    const eqt_real middle = right - (x - (low - more));
    const eqt_real positive = two * (arc.upper + (arc.more + arc.rest));
    const eqt_real negative = two * right - two * (arc.x + (arc.more - low));
    const eqt_real outer = eqt_select(eqt_less(x, eqt_constant(0.0)), negative, positive);
    const eqt_real angle = eqt_select(arc.small, middle, outer);
    const eqt_mask defined = eqt_less(size, eqt_constant(EQT_ABOVE_1));
    return eqt_select(defined, angle, eqt_nan());
}

EQT_INLINE eqt_real eqt_atan(eqt_real x)
{
    /* atan(x) = atan(c) + atan((x - c) / (1 + c x)) with c = 0, 1/2, 1, 3/2 or infinity. */
    const eqt_real size = eqt_abs(x), zero = eqt_constant(0.0), one = eqt_constant(1.0);
    const eqt_mask from_half = eqt_less(eqt_constant(0.4375), size);
    const eqt_mask from_1 = eqt_less(eqt_constant(0.6875), size);
    const eqt_mask from_3_halves = eqt_less(eqt_constant(1.1875), size);
    const eqt_mask from_far = eqt_less(eqt_constant(2.4375), size);
    eqt_real above = size, below = one, high = zero, low = zero, t, z, w, even, odd;
    above = eqt_select(from_half, (size + size) - one, above);
    below = eqt_select(from_half, eqt_constant(2.0) + size, below);
    high = eqt_select(from_half, eqt_constant(4.63647609000806093515e-01), high);
    low = eqt_select(from_half, eqt_constant(2.26987774529616870924e-17), low);
    above = eqt_select(from_1, size - one, above);
    below = eqt_select(from_1, size + one, below);
    high = eqt_select(from_1, eqt_constant(7.85398163397448278999e-01), high);
    low = eqt_select(from_1, eqt_constant(3.06161699786838301793e-17), low);
    above = eqt_select(from_3_halves, size - eqt_constant(1.5), above);
    below = eqt_select(from_3_halves, one + eqt_constant(1.5) * size, below);
    high = eqt_select(from_3_halves, eqt_constant(9.82793723247329054082e-01), high);
    low = eqt_select(from_3_halves, eqt_constant(1.39033110312309984516e-17), low);
    above = eqt_select(from_far, -one, above);
    below = eqt_select(from_far, size, below);
    high = eqt_select(from_far, eqt_constant(EQT_RIGHT_ANGLE), high);
    low = eqt_select(from_far, eqt_constant(EQT_RIGHT_ANGLE_LOW), low);
    t = above / below;
    z = t * t;
    w = z * z;
    odd = z * (eqt_constant(3.33333333333329318027e-01) +
               w * (eqt_constant(1.42857142725034663711e-01) +
                    w * (eqt_constant(9.09088713343650656196e-02) +
                         w * (eqt_constant(6.66107313738753120669e-02) +
                              w * (eqt_constant(4.97687799461593236017e-02) +
                                   w * eqt_constant(1.62858201153657823623e-02))))));
    even = w * (eqt_constant(-1.99999999998764832476e-01) +
                w * (eqt_constant(-1.11111104054623557880e-01) +
                     w * (eqt_constant(-7.69187620504482999495e-02) +
                          w * (eqt_constant(-5.83357013379057348645e-02) +
                               w * eqt_constant(-3.65315727442169155270e-02)))));
    return eqt_canonical(eqt_with_sign(high - ((t * (odd + even) - low) - t), x));
}

/* pow ------------------------------------------------------------------------------------------ */

/* log(x) of x > 0, to about 65 bits. */
EQT_INLINE eqt_pair eqt_log_pair(eqt_real x)
{
    /* log(1 + f) = 2 atanh(s) = 2 (s + s^3 / 3 + s^5 / 5 + ...), s = f / (2 + f) */
    const eqt_parts parts = eqt_split(x);
    const eqt_real f = parts.factor - eqt_constant(1.0);
    const eqt_pair s = eqt_pair_quotient(eqt_pair_of(f), eqt_ordered_sum(eqt_constant(2.0), f));
    const eqt_pair square = eqt_pair_product(s, s);
    const eqt_real z = square.high;
    const eqt_real tail =
        z * (eqt_constant(1.0 / 5.0) +
             z * (eqt_constant(1.0 / 7.0) +
                  z * (eqt_constant(1.0 / 9.0) +
                       z * (eqt_constant(1.0 / 11.0) +
                            z * (eqt_constant(1.0 / 13.0) +
                                 z * (eqt_constant(1.0 / 15.0) +
                                      z * (eqt_constant(1.0 / 17.0) +
                                           z * (eqt_constant(1.0 / 19.0) +
                                                z * (eqt_constant(1.0 / 21.0) +
                                                     z * eqt_constant(1.0 / 23.0))))))))));
    eqt_pair third, factor, cubic, power, sum;
    third.high = eqt_constant(1.0 / 3.0);
    third.low = eqt_constant(1.850371707708594235e-17);
    factor = eqt_ordered_sum(third.high, tail);
    factor.low = factor.low + third.low;
    cubic = eqt_pair_product(s, eqt_pair_product(square, factor));
    factor = eqt_ordered_sum(s.high, cubic.high);
    factor.low = factor.low + (s.low + cubic.low);
    power.high = parts.exponent * eqt_constant(EQT_LN2_HIGH);
    power.low = parts.exponent * eqt_constant(EQT_LN2_LOW);
    sum = eqt_ordered_sum(power.high, eqt_constant(2.0) * factor.high);
    return eqt_ordered_sum(sum.high, sum.low + (power.low + eqt_constant(2.0) * factor.low));
}

/* The largest whole number that is not above x. */
EQT_INLINE eqt_real eqt_floor(eqt_real x)
{
    const eqt_real shift = eqt_constant(4503599627370496.0), size = eqt_abs(x); /* 2^52 */
    const eqt_real nearest = eqt_with_sign((size + shift) - shift, x);
    const eqt_real above = eqt_select(eqt_less(x, nearest), eqt_constant(1.0), eqt_constant(0.0));
    return eqt_canonical(eqt_select(eqt_less(size, shift), nearest - above, x));
}

/* Whether a number that is not negative is whole. */
EQT_INLINE eqt_mask eqt_whole(eqt_real x) { return eqt_equal(eqt_floor(x), x); }

EQT_INLINE eqt_real eqt_pow(eqt_real x, eqt_real y)
{
    const eqt_real zero = eqt_constant(0.0), one = eqt_constant(1.0), infinity = eqt_infinity();
    const eqt_real size = eqt_abs(x), degree = eqt_abs(y);
    const eqt_mask minus = eqt_any_bit(eqt_bits_of(x) & eqt_bits_constant(EQT_SIGN_BIT));
    const eqt_mask even = eqt_whole(eqt_constant(0.5) * degree), whole = eqt_whole(degree);
    const eqt_mask proper = eqt_less(zero, size) & eqt_less(size, infinity);
    const eqt_real exponent = eqt_within(y, -1e20, 1e20);
    const eqt_pair product = eqt_pair_product(eqt_log_pair(size), eqt_pair_of(exponent));
    const eqt_real near = eqt_within(product.high, -746.0, 710.0);
    const eqt_mask moved = eqt_equal(near, product.high);
    const eqt_real usual = eqt_exp_of_sum(near, eqt_select(moved, product.low, zero));
    const eqt_real grows = eqt_select(eqt_less(y, zero), infinity, zero);   /* of 0 */
    const eqt_real shrinks = eqt_select(eqt_less(y, zero), zero, infinity); /* of infinity */
    const eqt_real limit = eqt_select(eqt_less(size, one), grows, shrinks);
    const eqt_real positive = eqt_select(proper, usual, limit);
    const eqt_real fraction = eqt_select(proper, eqt_nan(), positive);
    const eqt_real negative = eqt_select(whole, eqt_select(even, positive, -positive), fraction);
    eqt_real power = eqt_select(minus, negative, positive);
    power = eqt_select(eqt_equal(x, x) & eqt_equal(y, y), eqt_canonical(power), eqt_nan());
    return eqt_select(eqt_equal(y, zero) | eqt_equal(x, one), one, power);
}

#endif
