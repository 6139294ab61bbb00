/* Walks runs of a sampled loop through its spans: the instant at the start of each, then advance.h.

   It is included behind advance.h, store.h and rows.h. A span in which something ends, or a run takes
   suspiciously many steps, is left to the caller, with everything as it was before it. */
#ifndef EQT_WALK_H
#define EQT_WALK_H

#include <string.h>

/* A span, as Span in engine.py. */
typedef struct {
    double start, stop, first_inside, last_inside, longest;
    int64_t first, later, sampled_start;
    int64_t tick, acts; /* tick -1: no instant at its start; whether the law acts there */
} eqt_walked_span;

/* One of the programs of an instant; its sources move from one span to the next. */
typedef struct {
    void (*evaluate)(const eqt_evaluations *);
    eqt_evaluations evaluations;
    eqt_source *moved;          /* its sources */
    const eqt_source *at_start; /* the same for the first span, or for tick 0 */
    const int64_t *by_tick;     /* whether one moves with the ticks, and not with the spans */
} eqt_instant;

/* A user's function, between the programs of an instant: see user_code.h. */
typedef void (*eqt_code)(long runs, int begins, double period, const double *options, double *states,
                         const double *inputs, double *torques, unsigned char *outcomes, double *apart);

typedef struct {
    eqt_span span;               /* of runs and engine; the rest is set for each span */
    int64_t place, stop;         /* the first span, and the one behind the last */
    int64_t suspicious;          /* so many steps in a span are suspicious */
    int64_t lost;                /* the place in a state that says that an estimate is lost; or -1 */
    const eqt_walked_span *list; /* of all spans */
    const double *times, *held;  /* sample times; (spans, held) */
    double *samples;             /* (samples, row) of each run */
    const double *commanded;     /* (runs, row): the states that the last program finds */
    double *before;              /* (runs, row + 2): states, lengths and times before the span */
    int64_t *counted;            /* (runs, 2): counts and ends before the span */
    eqt_instant programs[2];
    int64_t parts;               /* how many programs there are */
    eqt_code code;               /* called between both, if there are two */
    int64_t begins, memory_at, memory_length; /* the last two: the law's memory in a state */
    double period;
    const double *measured;      /* (runs, row): the states that the first program finds, or starts from */
    const double *options, *law_inputs;
    double *memory, *torques;
} eqt_walks;

static int eqt_is_finite(const double *values, int64_t count)
{
    int64_t i;
    for (i = 0; i < count; i++)
        if (!(values[i] - values[i] == 0.0))
            return 0;
    return 1;
}

/* Keeps what a span may change of a run, or puts it back. */
static void eqt_keep(const eqt_walks *walk, int64_t run)
{
    const eqt_span *span = &walk->span;
    double *kept = walk->before + run * (span->row + 2);
    memcpy(kept, span->states + run * span->row, (size_t)span->row * sizeof *kept);
    kept[span->row] = span->steps[run];
    kept[span->row + 1] = span->times[run];
    walk->counted[2 * run] = span->counts[run];
    walk->counted[2 * run + 1] = span->ends[run];
}

static void eqt_put_back(const eqt_walks *walk, int64_t run)
{
    const eqt_span *span = &walk->span;
    const double *kept = walk->before + run * (span->row + 2);
    memcpy(span->states + run * span->row, kept, (size_t)span->row * sizeof *kept);
    span->steps[run] = kept[span->row];
    span->times[run] = kept[span->row + 1];
    span->counts[run] = walk->counted[2 * run];
    span->ends[run] = walk->counted[2 * run + 1];
}

/* The states that an instant leads to, as `commanded`. */
static void eqt_command(const eqt_walks *walk, int64_t index)
{
    const eqt_walked_span *here = walk->list + index;
    int64_t part, k, run;
    for (part = 0; part < walk->parts; part++) {
        const eqt_instant *program = walk->programs + part;
        for (k = 0; k < program->evaluations.count; k++)
            program->moved[k].from = program->at_start[k].from
                                     + program->at_start[k].to_next_sample
                                           * (program->by_tick[k] ? here->tick : index);
        if (part) { /* the user's code is called behind the first program */
            const int64_t length = walk->memory_length;
            for (run = 0; run < walk->span.runs; run++)
                memcpy(walk->memory + run * length,
                       walk->measured + run * walk->span.row + walk->memory_at,
                       (size_t)length * sizeof(double));
            if (here->acts)
                walk->code((long)walk->span.runs, (int)walk->begins, walk->period, walk->options,
                           walk->memory, walk->law_inputs, walk->torques, NULL, NULL);
        }
        program->evaluate(&program->evaluations);
    }
}

static void eqt_store_row(const eqt_walks *walk, int64_t run, int64_t sample, int64_t from)
{
    const eqt_span *span = &walk->span;
    memcpy(walk->samples + run * span->to_next_run + sample * span->row + from,
           span->states + run * span->row + from, (size_t)(span->row - from) * sizeof(double));
}

/* Walks until a span is left to the caller; returns the place of that, or `stop`. */
int64_t eqt_walk(const eqt_walks *walk)
{
    eqt_span span = walk->span;
    const int64_t runs = span.runs, row = span.row;
    int64_t index, run, k;
    for (index = walk->place; index < walk->stop; index++) {
        const eqt_walked_span *here = walk->list + index;
        int64_t most = 0;
        int ends = 0;
        for (run = 0; run < runs; run++)
            eqt_keep(walk, run);
        if (here->tick >= 0) {
            eqt_command(walk, index);
            for (run = 0; run < runs; run++) {
                const double *after = walk->commanded + run * row;
                if (span.ends[run] == EQT_THROUGH
                    && (!eqt_is_finite(after, row)
                        || (walk->lost >= 0 && after[walk->lost] != 0.0)))
                    return index;
            }
            for (run = 0; run < runs; run++)
                if (span.ends[run] == EQT_THROUGH)
                    memcpy(span.states + run * row, walk->commanded + run * row,
                           (size_t)row * sizeof(double));
        }
        if (here->sampled_start)
            for (run = 0; run < runs; run++)
                eqt_store_row(walk, run, here->first - 1, 0);
        span.later = here->later;
        span.start = here->start;
        span.stop = here->stop;
        span.first_inside = here->first_inside;
        span.last_inside = here->last_inside;
        span.longest = here->longest;
        span.grid = walk->times + here->first;
        span.held = walk->held + index * EQT_HELD;
        span.samples = walk->samples + here->first * row;
        eqt_advance(&span);
        for (run = 0; run < runs; run++) {
            int64_t steps = span.counts[run] - walk->counted[2 * run];
            if (walk->counted[2 * run + 1] != EQT_THROUGH)
                continue;
            ends |= span.ends[run] != EQT_THROUGH || !eqt_is_finite(span.states + run * row, row);
            most = steps > most ? steps : most;
        }
        if (ends) {
            for (run = 0; run < runs; run++)
                eqt_put_back(walk, run);
            return index;
        }
        if (row > EQT_STATES)
            for (run = 0; run < runs; run++)
                for (k = 0; k < here->later; k++)
                    eqt_store_row(walk, run, here->first + k, EQT_STATES);
        if (most > walk->suspicious)
            return index + 1;
    }
    return index;
}

#endif
