/* Keeps the outcomes of the decisions in a C text, and how far a comparison was from its other side.

   A row of eqt_outcomes and of eqt_apart belongs to a call, an entry of it to a decision. */
static unsigned char *eqt_outcomes; /* 1: it was true; 2: it was false */
static double *eqt_apart;           /* left - right of the comparison, where that was nearest to 0 */

static int eqt_decided(long place, double apart, int holds)
{
    if (eqt_outcomes) {
        double kept = eqt_apart[place];
        if (!eqt_outcomes[place] || (apart < 0 ? -apart : apart) < (kept < 0 ? -kept : kept))
            eqt_apart[place] = apart;
        eqt_outcomes[place] |= holds ? 1 : 2;
    }
    return holds;
}

static double eqt_as_number(double x) { return x; }
static double eqt_no_number(const void *x) { (void)x; return __builtin_nan(""); }

#ifdef __cplusplus
#define __auto_type auto
#define EQT_NUMBER(x) eqt_number(x)
template <typename T> static double eqt_number(T x) { return (double)x; }
template <typename T> static double eqt_number(T *x) { return eqt_no_number(x); }
template <typename T> struct eqt_tested { static double apart() { return 0.0; } };
template <typename T> struct eqt_tested<T *> { static double apart() { return eqt_no_number(0); } };
template <typename T> struct eqt_tested<T &> : eqt_tested<T> {};
template <typename T> struct eqt_tested<T *const> : eqt_tested<T *> {};
#define EQT_TESTED(...) eqt_tested<decltype((__VA_ARGS__))>::apart()
#else
#define EQT_NUMBER(x)                                                                             \
    _Generic((x), float: eqt_as_number, double: eqt_as_number, long double: eqt_as_number,        \
             _Bool: eqt_as_number, char: eqt_as_number, signed char: eqt_as_number,               \
             unsigned char: eqt_as_number, short: eqt_as_number, unsigned short: eqt_as_number,   \
             int: eqt_as_number, unsigned: eqt_as_number, long: eqt_as_number,                    \
             unsigned long: eqt_as_number, long long: eqt_as_number,                              \
             unsigned long long: eqt_as_number, default: eqt_no_number)(x)
/* Of a condition, whose text is not evaluated here: NaN for a pointer. The type is that of ?:, in
   which a bit-field is a number. */
#define EQT_TESTED(...)                                                                           \
    _Generic(1 ? (__VA_ARGS__) : (__VA_ARGS__), float: 0.0, double: 0.0, long double: 0.0,        \
             int: 0.0, unsigned: 0.0, long: 0.0, unsigned long: 0.0, long long: 0.0,              \
             unsigned long long: 0.0, _Bool: 0.0, default: eqt_no_number(0))
#endif
#define EQT_WATCH(call, decisions)                                                                \
    eqt_outcomes = outcomes + (call) * (decisions), eqt_apart = apart + (call) * (decisions)
