/* Measures runs sample by sample, so that their states need not be stored.

   It is included behind rows.h, advance.h and an emitted program, which defines

     EQT_SOURCES, EQT_ROWS   stretches of its inputs behind the state, and how many numbers they have
     eqt_lengths             of each stretch
     EQT_MEMORY, EQT_KEPT    how many numbers it keeps from sample to sample, and stores of each
     EQT_MEASURE(in, parameters, memory, after, kept)   calls it */
#ifndef EQT_MEASURE_H
#define EQT_MEASURE_H

struct eqt_measuring {
    const eqt_source *sources;
    const double *starts; /* (memory): before the first sample */
    double *memory;       /* (runs, memory): behind the last one */
    double *kept;         /* (runs, 1 + later, kept) */
};

/* Looks at the samples of some lanes; the start is sample 0 here. */
static void eqt_look(eqt_lanes *lanes, eqt_mask due, const int64_t *sample)
{
    const eqt_span *span = lanes->span;
    const struct eqt_measuring *measuring = span->measuring;
    eqt_real in[EQT_STATES + EQT_ROWS + 1], after[EQT_MEMORY + 1], kept[EQT_KEPT + 1];
    int64_t run[EQT_LANES], read = EQT_STATES;
    int lane, i, k;
    for (lane = 0; lane < EQT_LANES; lane++)
        run[lane] = lanes->run[lane] < 0 ? 0 : lanes->run[lane];
    for (i = 0; i < EQT_STATES; i++)
        in[i] = lanes->at[i];
    for (k = 0; k < EQT_SOURCES; k++) {
        eqt_read(measuring->sources + k, eqt_lengths[k], run, sample, in + read);
        read += eqt_lengths[k];
    }
    EQT_MEASURE(in, lanes->parameters, lanes->memory, after, kept);
    for (i = 0; i < EQT_MEMORY; i++)
        lanes->memory[i] = eqt_select(due, after[i], lanes->memory[i]);
    if (EQT_KEPT)
        for (lane = 0; lane < EQT_LANES; lane++)
            if (EQT_LANE(due, lane)) {
                double *row = measuring->kept
                              + (run[lane] * (span->later + 1) + sample[lane]) * EQT_KEPT;
                for (i = 0; i < EQT_KEPT; i++)
                    row[i] = EQT_LANE(kept[i], lane);
            }
}

static void eqt_at_start(eqt_lanes *lanes, eqt_mask starts)
{
    const int64_t first[EQT_LANES] = {0};
    int i;
    for (i = 0; i < EQT_STATES; i++)
        lanes->at[i] = lanes->y[i];
    for (i = 0; i < EQT_MEMORY; i++)
        lanes->memory[i] = eqt_select(starts, eqt_constant(lanes->span->measuring->starts[i]),
                                      lanes->memory[i]);
    eqt_look(lanes, starts, first);
}

static void eqt_at_samples(eqt_lanes *lanes, eqt_mask due)
{
    int64_t sample[EQT_LANES];
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++)
        sample[lane] = lanes->sample[lane] < lanes->span->later ? lanes->sample[lane] + 1 : 0;
    eqt_look(lanes, due, sample);
}

/* Of a run that has failed, no further sample is a number. */
static void eqt_end_samples(eqt_lanes *lanes, int lane, int64_t end)
{
    const eqt_span *span = lanes->span;
    double *memory = span->measuring->memory + lanes->run[lane] * EQT_MEMORY;
    int only[EQT_LANES] = {0}, i;
    only[lane] = 1;
    if (end != EQT_THROUGH) {
        for (i = 0; i < EQT_STATES; i++)
            lanes->at[i] = eqt_nan();
        for (; lanes->sample[lane] < span->later; lanes->sample[lane]++)
            eqt_at_samples(lanes, eqt_lanes_where(only));
    }
    for (i = 0; i < EQT_MEMORY; i++) {
        lanes->memory[i] = eqt_canonical(lanes->memory[i]);
        memory[i] = EQT_LANE(lanes->memory[i], lane);
    }
}

#endif
