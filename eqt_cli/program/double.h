/* What an emitted program is written in, for one number at a time. Another header may have lanes of
   a vector as eqt_real. Besides, a program calls eqt_sin and other functions that it names. */
#ifndef EQT_DOUBLE_H
#define EQT_DOUBLE_H

#include <math.h>

typedef double eqt_real;
typedef int eqt_mask;

static inline eqt_real eqt_constant(double number) { return number; }
static inline eqt_mask eqt_less(eqt_real a, eqt_real b) { return a < b; }
static inline eqt_real eqt_select(eqt_mask holds, eqt_real a, eqt_real b) { return holds ? a : b; }
static inline eqt_real eqt_sqrt(eqt_real x) { return sqrt(x); }

#endif
