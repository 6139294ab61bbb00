/* Rows of numbers of many runs at many samples, as an emitted program takes them: a number of each
   lane side by side. */
#ifndef EQT_ROWS_H
#define EQT_ROWS_H

/* Where a stretch of the inputs lies: its first number, and how far it is to the next run and to the
   next sample. */
typedef struct {
    const double *from;
    int64_t to_next_run, to_next_sample;
} eqt_source;

/* What evaluate.h computes. */
typedef struct {
    int64_t runs, samples, count; /* the last: how many sources there are */
    const eqt_source *sources;
    double *const *outputs; /* of each array (runs, samples, its length) */
} eqt_evaluations;

/* A stretch, of a run and a sample for each lane. */
static void eqt_read(const eqt_source *source, int64_t length, const int64_t *run,
                     const int64_t *sample, eqt_real *in)
{
    const double *from[EQT_LANES];
    int64_t i;
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++)
        from[lane] = source->from + run[lane] * source->to_next_run
                     + sample[lane] * source->to_next_sample;
#define NUMBER(lane) from[lane][i]
    for (i = 0; i < length; i++) {
        eqt_real numbers = EQT_EACH_LANE(NUMBER);
        in[i] = numbers;
    }
#undef NUMBER
}

#endif
