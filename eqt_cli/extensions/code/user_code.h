/* Calls a C function of a user's own for many runs, one after the other.

   It is included behind the user's text, and behind the definitions of

     EQT_NUMBER_TYPE, EQT_MEMORY_TYPE, EQT_INPUT_TYPE, EQT_TORQUE   the user's names
     EQT_CODE_REAL                 double or float
     EQT_CODE_AXES                 numbers that it returns
     EQT_SET_INPUT, EQT_SET_NUMBERS, EQT_READ_MEMORY, EQT_WRITE_MEMORY
                                   a call of the macros below for each name
     EQT_LIST_INPUT, EQT_LIST_NUMBERS, EQT_LIST_MEMORY   sizeof of each, with commas
     EQT_DEFAULT_NUMBERS           the numbers before they are set
     EQT_CODE_START, EQT_SET_PERIOD   defined where there is such a function, or such a number
     EQT_RETURN                    what the function returns: void, or int, which is 0 if it succeeds
     EQT_FAILED(call)              the call, and what follows where it fails
     EQT_INPUTS                    the number of its inputs
     EQT_DECISIONS                 defined behind decisions.h: the number of decisions */
#ifndef EQT_USER_CODE_H
#define EQT_USER_CODE_H

#define EQT_NAN ((EQT_CODE_REAL)__builtin_nan(""))
#define EQT_IN(to, from)                                                                   \
    for (eqt_k = 0; eqt_k < (long)(sizeof(to) / sizeof(EQT_CODE_REAL)); eqt_k++)           \
        ((EQT_CODE_REAL *)(void *)&(to))[eqt_k] = (EQT_CODE_REAL)(from)[eqt_k];            \
    (from) += sizeof(to) / sizeof(EQT_CODE_REAL)
#define EQT_OUT(to, from)                                                                  \
    for (eqt_k = 0; eqt_k < (long)(sizeof(from) / sizeof(EQT_CODE_REAL)); eqt_k++)         \
        (to)[eqt_k] = ((const EQT_CODE_REAL *)(const void *)&(from))[eqt_k];               \
    (to) += sizeof(from) / sizeof(EQT_CODE_REAL)

/* What the caller compares with its own: the bytes of the input and of its every field, whether the function
   has the right arguments, and the bytes of the whole memory, of every number, and of every part of
   the memory. */
#ifdef __cplusplus
#define EQT_C extern "C"
template <typename T> constexpr long eqt_is(T, T) { return 1; }
constexpr long eqt_is(...) { return 0; }
#define EQT_IS(function, type) eqt_is(&(function), (type)0)
#else
#define EQT_C
#define EQT_IS(function, type) __builtin_types_compatible_p(__typeof__(&(function)), type)
#endif
typedef EQT_RETURN (*eqt_law)(const EQT_NUMBER_TYPE *, EQT_MEMORY_TYPE *, const EQT_INPUT_TYPE *,
                        EQT_CODE_REAL *);
EQT_C const long eqt_code_sizes[] = {
    (long)sizeof(EQT_INPUT_TYPE),
    EQT_LIST_INPUT
    EQT_IS(EQT_TORQUE, eqt_law),
    (long)sizeof(EQT_MEMORY_TYPE),
    EQT_LIST_NUMBERS EQT_LIST_MEMORY 0};

/* Where the number of the row is written that is being called, if anybody looks. */
#ifdef __cplusplus
extern "C" { volatile long long *eqt_row; }
#else
volatile long long *eqt_row;
#endif

/* Rows, one a run: what is given for the numbers, the memory, which goes on, and the inputs. begins: 1
   calls the start; with 2, what is not named of the memory is filled; with 4, a row with inputs that
   are not finite, as of a run that has ended, is not called. */
EQT_C void eqt_code(long runs, int begins, double period, const double *options, double *states,
              const double *inputs, double *torques, unsigned char *outcomes, double *apart)
{
    long run, eqt_k;
    for (run = 0; run < runs; run++) {
        EQT_NUMBER_TYPE numbers = EQT_DEFAULT_NUMBERS;
        EQT_MEMORY_TYPE memory;
        EQT_INPUT_TYPE input;
        EQT_CODE_REAL torque[EQT_CODE_AXES] = {0};
        const double *before = states, *given = inputs;
        double finite = 0;
        unsigned char *bytes = (unsigned char *)&input; /* of a field that is not ours, too */
        for (eqt_k = 0; eqt_k < (long)sizeof input; eqt_k++)
            bytes[eqt_k] = 0;
        bytes = (unsigned char *)&memory;
        for (eqt_k = 0; eqt_k < (long)sizeof memory; eqt_k++)
            bytes[eqt_k] = begins & 2 ? 0x3f : 0; /* 4.8e-4 in double, 0.75 in float */
        (void)before;
        (void)period;
        (void)outcomes;
        (void)apart;
#ifdef EQT_DECISIONS
        EQT_WATCH(run, EQT_DECISIONS);
#endif
        EQT_SET_NUMBERS
#ifdef EQT_SET_PERIOD
        numbers.period = (EQT_CODE_REAL)period;
#endif
        EQT_READ_MEMORY
        EQT_SET_INPUT
        for (eqt_k = 0; eqt_k < EQT_INPUTS && begins & 4; eqt_k++)
            finite += given[eqt_k] - given[eqt_k];
        if (eqt_row)
            *eqt_row = run;
        if (finite != 0) {
            for (eqt_k = 0; eqt_k < EQT_CODE_AXES; eqt_k++)
                torque[eqt_k] = EQT_NAN;
        } else if (begins & 1) {
#ifdef EQT_CODE_START
            EQT_CODE_START(&numbers, &memory, &input);
#endif
        } else {
            for (eqt_k = 0; eqt_k < EQT_CODE_AXES; eqt_k++)
                torque[eqt_k] = EQT_NAN; /* what the function does not write is no number */
            EQT_FAILED(EQT_TORQUE(&numbers, &memory, &input, torque));
        }
        EQT_WRITE_MEMORY
        for (eqt_k = 0; eqt_k < EQT_CODE_AXES; eqt_k++)
            *torques++ = torque[eqt_k];
    }
}

#endif
