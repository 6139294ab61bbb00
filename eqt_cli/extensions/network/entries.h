/* Functions of single numbers, behind functions.h with one lane. */

EQT_INLINE double eqt_limited(double x) { return x < 0.0 ? 0.0 : x > 1.0 ? 1.0 : x; }

/* log(1 + exp(x)), of any x. */
EQT_INLINE double eqt_softplus(double x)
{
    return x > 0.0 ? x + eqt_log(1.0 + eqt_exp(-x)) : eqt_log(1.0 + eqt_exp(x));
}

/* The series 2 / sqrt(pi) exp(-x^2) (x + 2/3 x^3 + 4/15 x^5 + ...), whose terms have one sign;
   beyond 6, erf is 1 to the last bit. */
EQT_INLINE double eqt_erf(double x)
{
    double term = x, sum = x, k = 1.0;
    if (x > 6.0 || x < -6.0)
        return x > 0.0 ? 1.0 : -1.0;
    while (eqt_abs(term) > 1e-17 * eqt_abs(sum)) {
        k = k + 2.0;
        term = term * (2.0 * x * x / k);
        sum = sum + term;
    }
    return 1.1283791670955126 * eqt_exp(-x * x) * sum;
}

/* Whole powers of any number are products, other powers those of positive numbers. */
EQT_INLINE double eqt_power(double x, double y)
{
    double product = 1.0;
    long k, n = (long)eqt_abs(y);
    if (!(eqt_abs(y) <= 64.0) || (double)n != eqt_abs(y))
        return eqt_pow(x, y);
    for (k = 0; k < n; k++)
        product = product * x;
    return y < 0.0 ? 1.0 / product : product;
}
