/* Integrates runs of a closed loop through one span by DOP853, EQT_LANES of them side by side.

   It is included behind lanes.h and the emitted program, which defines

     EQT_STATES, EQT_PARAMETERS, EQT_HELD, EQT_COMPARISONS   how many numbers there are
     EQT_MEMORY            how many numbers measure.h keeps of a run
     eqt_all, eqt_seen     which states there are, and which are looked at: 1 or 0 of each
     eqt_field(state, time, parameters, held, sides, derivative, left, right)

   and before one of store.h and measure.h, which say what is done at samples. Each lane has its own
   time, step and acceptance, and takes the next run when its own is through.
   In a step every comparison of the law, left < right, keeps the side that it had at the start of
   the step, so that the field is smooth there. A step that crosses a comparison is taken again up to
   the crossing. */
#ifndef EQT_ADVANCE_H
#define EQT_ADVANCE_H

enum { EQT_THROUGH, EQT_STEP_LIMIT, EQT_NOT_FINITE, EQT_STEP_TOO_SHORT, EQT_SWITCHING,
       EQT_STOPPED };

/* Runs and a span, as the caller gives them. Arrays go row by row, with a row for each run. */
typedef struct {
    int64_t runs, later, most_steps;
    int64_t to_next_run;              /* in samples: from one run to the next */
    int64_t row;                      /* in states and samples: at least EQT_STATES */
    int64_t to_next_held;             /* in held: from one run to the next; 0: all share it */
    double start, stop;
    double first_inside, last_inside; /* the field is evaluated between these times */
    double rtol, atol;                /* tolerances of a step */
    double longest;                   /* no step is longer, s */
    const double *grid;               /* (later): sample times behind the start */
    const double *held;               /* (held), or a row of each run */
    const double *parameters;         /* (runs, parameters) */
    double *states;                   /* (runs, row): at the start, then where a run has ended */
    double *samples;                  /* store.h: (later, row) of each run */
    double *steps;                    /* (runs): length of the next step, s; 0: not known */
    int64_t *counts;                  /* (runs): steps taken so far */
    int64_t *ends;                    /* (runs): how it has ended; others than 0 are left alone */
    double *times;                    /* (runs): where it has ended, s */
    const volatile int64_t *stopped;  /* not 0, as soon as runs are to end unfinished */
    const double *periods;            /* (runs, 4): start, stop, first_inside and last_inside of each
                                         run; NULL: all share those above */
    const struct eqt_measuring *measuring; /* measure.h */
} eqt_span;

#define EQT_WIDTH 1e-12     /* how far a comparison passes 0, relative to its scale, to be crossed */
#define EQT_AT_ONCE 1e-6    /* s: a crossing so soon behind another may be the return from it */
#define EQT_MOST_RETURNS 10 /* so many in a row are no motion but a sliding mode */
#define EQT_SHRINK 0.2
#define EQT_GROW 10.0

typedef struct {
    const eqt_span *span;
    eqt_real parameters[EQT_PARAMETERS + 1], held[EQT_HELD + 1];
    eqt_real sides[EQT_COMPARISONS + 1]; /* -1 where left < right, else 1 */
    eqt_real left[EQT_COMPARISONS + 1], right[EQT_COMPARISONS + 1];
    eqt_real y[EQT_STATES], k[16][EQT_STATES], next[EQT_STATES], at[EQT_STATES];
    eqt_real memory[EQT_MEMORY + 1]; /* of a program that measures */
    eqt_real due;                /* time of the next sample behind the start */
    eqt_real stop, first_inside, last_inside; /* of the run of each lane */
    eqt_real t, h, step;         /* h is what is taken of the step that the tolerance allows */
    eqt_real crossed_at, width;  /* the last crossing, and the width of comparisons since then */
    double shortest[EQT_LANES];  /* a step below this is too short */
    int64_t run[EQT_LANES];      /* -1: idle */
    int64_t sample[EQT_LANES];   /* its number; the first is 0 */
    int64_t returns[EQT_LANES];
    int fresh[EQT_LANES];        /* 1: at a new start; 2: behind a crossing */
    int last[EQT_LANES];         /* whether h ends the span */
    int pinned[EQT_LANES];       /* whether h ends at a crossing */
    int rejected[EQT_LANES];     /* whether the step before was */
} eqt_lanes;

/* What is done with the states `at` in the lanes that are due, at their sample. */
static void eqt_at_samples(eqt_lanes *lanes, eqt_mask due);
/* The same at the start, before the first sample. */
static void eqt_at_start(eqt_lanes *lanes, eqt_mask starts);
/* What is done when a run leaves its lane. */
static void eqt_end_samples(eqt_lanes *lanes, int lane, int64_t end);

EQT_INLINE eqt_real eqt_least(eqt_real a, eqt_real b) { return eqt_select(eqt_less(a, b), a, b); }
EQT_INLINE eqt_real eqt_most(eqt_real a, eqt_real b) { return eqt_select(eqt_less(a, b), b, a); }

/* The eighth root, by which the length of a step depends on its error. */
EQT_INLINE eqt_real eqt_eighth_root(eqt_real x) { return eqt_sqrt(eqt_sqrt(eqt_sqrt(x))); }

EQT_INLINE eqt_mask eqt_lanes_where(const int *holds)
{
    eqt_real found = eqt_constant(0.0);
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++)
        EQT_LANE(found, lane) = holds[lane] != 0;
    return eqt_less(eqt_constant(0.0), found);
}

EQT_INLINE int eqt_any_of(const int *holds)
{
    int lane, any = 0;
    for (lane = 0; lane < EQT_LANES; lane++)
        any |= holds[lane];
    return any;
}

static void eqt_derivative(eqt_lanes *lanes, eqt_real t, const eqt_real *state, eqt_real *slope)
{
    eqt_real inside = eqt_least(eqt_most(t, lanes->first_inside), lanes->last_inside);
    eqt_field(state, &inside, lanes->parameters, lanes->held, lanes->sides, slope, lanes->left,
              lanes->right);
}

/* The tolerance of a state in a step. */
EQT_INLINE eqt_real eqt_tolerance(const eqt_lanes *lanes, int i)
{
    eqt_real most = eqt_most(eqt_abs(lanes->y[i]), eqt_abs(lanes->next[i]));
    return lanes->span->atol + lanes->span->rtol * most;
}

/* The norm of a vector in units of the tolerance at y: a root mean square. */
static eqt_real eqt_in_tolerances(const eqt_lanes *lanes, const eqt_real *values)
{
    const eqt_span *span = lanes->span;
    eqt_real sum = eqt_constant(0.0);
    int i;
    for (i = 0; i < EQT_STATES; i++) {
        eqt_real part = values[i] / (span->atol + span->rtol * eqt_abs(lanes->y[i]));
        sum = sum + part * part;
    }
    return eqt_sqrt(sum / (double)EQT_STATES);
}

/* The length of a first step, by Hairer, Norsett and Wanner, section II.4. */
static eqt_real eqt_first_step(eqt_lanes *lanes)
{
    eqt_real size = eqt_in_tolerances(lanes, lanes->y);
    eqt_real rate = eqt_in_tolerances(lanes, lanes->k[0]);
    eqt_mask little = eqt_less(eqt_least(size, rate), eqt_constant(1e-5));
    eqt_real trial = eqt_select(little, eqt_constant(1e-6), 0.01 * size / rate);
    eqt_real bend, most, step;
    int i;
    trial = eqt_least(trial, lanes->stop - lanes->t);
    for (i = 0; i < EQT_STATES; i++)
        lanes->at[i] = lanes->y[i] + trial * lanes->k[0][i];
    eqt_derivative(lanes, lanes->t + trial, lanes->at, lanes->k[1]);
    for (i = 0; i < EQT_STATES; i++)
        lanes->at[i] = (lanes->k[1][i] - lanes->k[0][i]) / trial;
    bend = eqt_in_tolerances(lanes, lanes->at);
    most = eqt_most(rate, bend);
    step = eqt_select(eqt_less(most, eqt_constant(1e-15)), eqt_most(eqt_constant(1e-6), 1e-3 * trial),
                      eqt_eighth_root(0.01 / most));
    step = eqt_least(100.0 * trial, step);
    /* Where the field is not finite, the first step will say so. */
    return eqt_select(eqt_less(eqt_constant(0.0), step), step, eqt_constant(1e-6));
}

/* Where a comparison is on the wrong side of its kept one, by more than a width. */
EQT_INLINE eqt_mask eqt_wrong(const eqt_lanes *lanes, int j, eqt_real width)
{
    eqt_real a = lanes->left[j], b = lanes->right[j];
    eqt_real scale = eqt_most(eqt_constant(1.0), eqt_least(eqt_abs(a), eqt_abs(b)));
    return eqt_less((a - b) * lanes->sides[j], -(width * scale));
}

/* Which lanes have a comparison on the wrong side, for the derivative that was evaluated last. */
EQT_INLINE eqt_mask eqt_wrong_somewhere(const eqt_lanes *lanes, eqt_real width)
{
    eqt_mask any = eqt_less(eqt_constant(0.0), eqt_constant(0.0));
    int j;
    for (j = 0; j < EQT_COMPARISONS; j++)
        any |= eqt_wrong(lanes, j, width);
    return any;
}

/* Lets the sides of some lanes follow until all are right: one may depend on another. Those that a
   crossing has just changed, `kept`, stay. Where no side has turned, none will in the next round.
   Returns whether `at` then holds the slopes. */
static int eqt_settle_sides(eqt_lanes *lanes, eqt_mask where, const eqt_mask *kept)
{
    int j, round;
    for (round = 0; round <= EQT_COMPARISONS; round++) {
        eqt_mask any = eqt_less(eqt_constant(0.0), eqt_constant(0.0));
        eqt_derivative(lanes, lanes->t, lanes->y, lanes->at);
        for (j = 0; j < EQT_COMPARISONS; j++) {
            eqt_mask turned = where & ~kept[j] & eqt_wrong(lanes, j, eqt_constant(0.0));
            lanes->sides[j] = eqt_select(turned, -lanes->sides[j], lanes->sides[j]);
            any |= turned;
        }
        if (!eqt_any(any))
            return 1;
    }
    return 0;
}

/* The slope of a stage, by the names y, k, h and i of the function around it. */
#define EQT_STAGE(number, where, increment)                                                        \
    for (i = 0; i < EQT_STATES; i++) {                                                             \
        eqt_real sum = eqt_constant(0.0);                                                          \
        increment lanes->at[i] = eqt_fma(h, sum, y[i]);                                            \
    }                                                                                              \
    eqt_derivative(lanes, lanes->t + where * h, lanes->at, k[number]);

/* The stages that the polynomial of the step in hand needs besides. */
static void eqt_prepare_dense(eqt_lanes *lanes)
{
    eqt_real(*k)[EQT_STATES] = lanes->k, *y = lanes->y, h = lanes->h;
    int i;
#define ADD(a, j) sum = eqt_fma(eqt_constant(a), k[j][i], sum);
    EQT_DENSE_STAGES(EQT_STAGE)
#undef ADD
}

/* How much that polynomial errs, in 20 tolerances of a step. It magnifies what a step leaves of a mode
   that is fast beside it, which the error of the step does not tell. */
static eqt_real eqt_dense_error(const eqt_lanes *lanes)
{
    const eqt_real(*k)[EQT_STATES] = lanes->k;
    eqt_real squares = eqt_constant(0.0);
    int i;
#define ADD(a, j) sum = eqt_fma(eqt_constant(a), k[j][i], sum);
    for (i = 0; i < EQT_STATES; i++) {
        eqt_real sum = eqt_constant(0.0);
        EQT_DENSE_ERROR sum = sum / eqt_tolerance(lanes, i);
        squares = eqt_fma(sum, sum, squares);
    }
#undef ADD
    return lanes->h * eqt_sqrt(squares / (double)EQT_STATES);
}

/* That polynomial at 0 <= theta < 1, by a weight for each stage: few samples lie in a step, so that
   its coefficients would not pay. Only the states that are `wanted`. */
static void eqt_in_step(const eqt_lanes *lanes, eqt_real theta, const char *wanted, eqt_real *state)
{
    const eqt_real(*k)[EQT_STATES] = lanes->k, *y = lanes->y, h = lanes->h;
    const eqt_real rest = 1.0 - theta, part = theta * rest, bend = theta * part;
    const eqt_real change = theta - part + 2.0 * bend;
    eqt_real weights[16] = {part - bend}, power = bend;
    int i, j;
    for (j = 1; j < 16; j++)
        weights[j] = eqt_constant(0.0);
    weights[12] = -bend;
#define ADD(a, j) weights[j] = eqt_fma(eqt_constant(a), power, weights[j]);
    power = power * rest;
    EQT_DENSE_3
    power = power * theta;
    EQT_DENSE_4
    power = power * rest;
    EQT_DENSE_5
    power = power * theta;
    EQT_DENSE_6
#undef ADD
    for (j = 0; j < 16; j++)
        weights[j] = h * weights[j];
    for (i = 0; i < EQT_STATES; i++) {
        eqt_real found;
        if (!wanted[i])
            continue;
        found = eqt_fma(change, lanes->next[i] - y[i], y[i]);
#define ADD(j) found = eqt_fma(weights[j], k[j][i], found);
        EQT_DENSE_USES(ADD)
#undef ADD
        state[i] = found;
    }
}

/* Tries a step of every lane; returns its error in units of the tolerance. `suspected` are the lanes
   with a comparison on the wrong side at a stage. */
static eqt_real eqt_try_step(eqt_lanes *lanes, eqt_mask *suspected)
{
    eqt_real(*k)[EQT_STATES] = lanes->k, *y = lanes->y, *next = lanes->next, h = lanes->h;
    eqt_real third = eqt_constant(0.0), fifth = third, both;
    eqt_mask wrong = eqt_less(third, third);
    int i;
#define ADD(a, j) sum = eqt_fma(eqt_constant(a), k[j][i], sum);
#define STAGE(number, where, increment)                                                            \
    EQT_STAGE(number, where, increment)                                                            \
    if (EQT_COMPARISONS)                                                                           \
        wrong |= eqt_wrong_somewhere(lanes, lanes->width);
    EQT_STAGES(STAGE)
#undef STAGE
    for (i = 0; i < EQT_STATES; i++) {
        eqt_real sum = eqt_constant(0.0), per_tolerance;
        EQT_STEP next[i] = eqt_fma(h, sum, y[i]);
        per_tolerance = 1.0 / eqt_tolerance(lanes, i);
        sum = eqt_constant(0.0);
        EQT_ERROR_3 sum = sum * per_tolerance;
        third = eqt_fma(sum, sum, third);
        sum = eqt_constant(0.0);
        EQT_ERROR_5 sum = sum * per_tolerance;
        fifth = eqt_fma(sum, sum, fifth);
    }
#undef ADD
    *suspected = wrong;
    both = fifth + 0.01 * third;
    return eqt_select(eqt_less(both, eqt_constant(1e-300)), both,
                      h * fifth / eqt_sqrt(both * (double)EQT_STATES));
}

/* Copies what the step of a lane depends on into all lanes of `all`. */
static void eqt_spread(const eqt_lanes *lanes, int lane, eqt_lanes *all)
{
    int i, j;
#define SPREAD(name) all->name = eqt_constant(EQT_LANE(lanes->name, lane));
    all->span = lanes->span;
    SPREAD(t)
    SPREAD(h)
    for (i = 0; i < EQT_PARAMETERS; i++)
        SPREAD(parameters[i])
    SPREAD(first_inside)
    SPREAD(last_inside)
    for (i = 0; i < EQT_HELD; i++)
        SPREAD(held[i])
    for (i = 0; i < EQT_COMPARISONS; i++)
        SPREAD(sides[i])
    for (i = 0; i < EQT_STATES; i++) {
        SPREAD(y[i])
        SPREAD(next[i])
        for (j = 0; j < 16; j++)
            SPREAD(k[j][i])
    }
#undef SPREAD
}

/* Where in a step, a fraction for each lane, a comparison is on the wrong side: 1 or 0. The slopes
   there go to stage 1, which the dense output does not need. */
static eqt_real eqt_wrong_at(eqt_lanes *lanes, eqt_real theta, double width)
{
    eqt_in_step(lanes, theta, eqt_all, lanes->at);
    eqt_derivative(lanes, lanes->t + theta * lanes->h, lanes->at, lanes->k[1]);
    return eqt_select(eqt_wrong_somewhere(lanes, eqt_constant(width)), eqt_constant(1.0),
                      eqt_constant(0.0));
}

/* How much of the step of a lane leads up to its first crossing of a comparison; more than 1: there
   is none. `all` are copies of that lane, so that several places are looked at together: in the
   bisection, a tree of all places that the next halvings may come to. */
static double eqt_crossing(eqt_lanes *all, double width, int crosses_at_end)
{
    enum {
        LOOKS = 16,
        HALVINGS = 48,
        AT_ONCE = EQT_LANES >= 7 ? 3 : EQT_LANES >= 3 ? 2 : 1,
        NODES = 1 << AT_ONCE
    };
    double before = 0.0, behind = 2.0;
    int look, halving, lane, node;
    for (look = 1; look <= LOOKS && behind > 1.0; look += EQT_LANES) {
        eqt_real theta = eqt_constant(1.0), wrong;
        for (lane = 0; lane < EQT_LANES && look + lane <= LOOKS; lane++)
            EQT_LANE(theta, lane) = (double)(look + lane) / LOOKS;
        wrong = eqt_wrong_at(all, theta, width);
        for (lane = 0; lane < EQT_LANES && look + lane <= LOOKS && behind > 1.0; lane++)
            if (EQT_LANE(wrong, lane) > 0.0 || (look + lane == LOOKS && crosses_at_end))
                behind = EQT_LANE(theta, lane);
            else
                before = EQT_LANE(theta, lane);
    }
    if (behind > 1.0)
        return behind;
    for (halving = 0; halving < HALVINGS; halving += AT_ONCE) {
        double low[2 * NODES], high[2 * NODES];
        eqt_real theta = eqt_constant(0.5 * (before + behind)), wrong;
        low[1] = before;
        high[1] = behind;
        for (node = 1; node < NODES; node++) {
            double middle = 0.5 * (low[node] + high[node]);
            EQT_LANE(theta, node - 1) = middle;
            low[2 * node] = low[node];
            high[2 * node] = low[2 * node + 1] = middle;
            high[2 * node + 1] = high[node];
        }
        wrong = eqt_wrong_at(all, theta, 0.0);
        for (node = 1; node < NODES;)
            node = 2 * node + !(EQT_LANE(wrong, node - 1) > 0.0);
        before = low[node];
        behind = high[node];
    }
    return behind;
}

static void eqt_take(eqt_lanes *lanes, int lane, int64_t run)
{
    const eqt_span *span = lanes->span;
    const double shared[4] = {span->start, span->stop, span->first_inside, span->last_inside};
    const double *times = span->periods ? span->periods + 4 * run : shared;
    int i;
    if (span->to_next_held)
        for (i = 0; i < EQT_HELD; i++)
            EQT_LANE(lanes->held[i], lane) = span->held[run * span->to_next_held + i];
    for (i = 0; i < EQT_STATES; i++)
        EQT_LANE(lanes->y[i], lane) = span->states[run * span->row + i];
    for (i = 0; i < EQT_PARAMETERS; i++)
        EQT_LANE(lanes->parameters[i], lane) = span->parameters[run * EQT_PARAMETERS + i];
    for (i = 0; i < EQT_COMPARISONS; i++)
        EQT_LANE(lanes->sides[i], lane) = 1.0;
    EQT_LANE(lanes->t, lane) = times[0];
    EQT_LANE(lanes->stop, lane) = times[1];
    EQT_LANE(lanes->first_inside, lane) = times[2];
    EQT_LANE(lanes->last_inside, lane) = times[3];
    lanes->shortest[lane] = 1e-16 * (times[1] - times[0]);
    EQT_LANE(lanes->step, lane) = span->steps[run];
    EQT_LANE(lanes->crossed_at, lane) = -EQT_INFINITY;
    EQT_LANE(lanes->width, lane) = EQT_WIDTH;
    lanes->run[lane] = run;
    lanes->sample[lane] = 0;
    EQT_LANE(lanes->due, lane) = span->later ? span->grid[0] : EQT_INFINITY;
    lanes->returns[lane] = 0;
    lanes->fresh[lane] = 1;
    lanes->pinned[lane] = lanes->rejected[lane] = 0;
}

static void eqt_leave(eqt_lanes *lanes, int lane, int64_t end)
{
    const eqt_span *span = lanes->span;
    int64_t run = lanes->run[lane];
    int i;
    eqt_end_samples(lanes, lane, end);
    for (i = 0; i < EQT_STATES; i++)
        span->states[run * span->row + i] = EQT_LANE(lanes->y[i], lane);
    span->steps[run] = EQT_LANE(lanes->step, lane);
    span->times[run] = EQT_LANE(lanes->t, lane);
    span->ends[run] = end;
    lanes->run[lane] = -1;
    EQT_LANE(lanes->h, lane) = 0.0;
}

/* Slopes, sides and step lengths of lanes that begin, or go on behind a crossing. */
static void eqt_begin(eqt_lanes *lanes)
{
    eqt_mask kept[EQT_COMPARISONS + 1], fresh = eqt_lanes_where(lanes->fresh), unknown;
    int i, known = 0, starts[EQT_LANES];
    for (i = 0; i < EQT_LANES; i++)
        starts[i] = lanes->fresh[i] == 1;
    if (EQT_COMPARISONS && eqt_any_of(starts)) {
        for (i = 0; i < EQT_COMPARISONS; i++)
            kept[i] = eqt_less(eqt_constant(1.0), eqt_constant(0.0));
        known = eqt_settle_sides(lanes, eqt_lanes_where(starts), kept);
    }
    if (!known)
        eqt_derivative(lanes, lanes->t, lanes->y, lanes->at);
    for (i = 0; i < EQT_STATES; i++)
        lanes->k[0][i] = eqt_select(fresh, lanes->at[i], lanes->k[0][i]);
    if (eqt_any_of(starts))
        eqt_at_start(lanes, eqt_lanes_where(starts));
    unknown = fresh & ~eqt_less(eqt_constant(0.0), lanes->step);
    for (i = 0; i < EQT_LANES; i++)
        if (lanes->fresh[i] && !(EQT_LANE(lanes->step, i) > 0.0)) {
            lanes->step = eqt_select(unknown, eqt_first_step(lanes), lanes->step);
            break;
        }
    for (i = 0; i < EQT_LANES; i++)
        lanes->fresh[i] = 0;
}

/* How much is taken of each lane's step: all, unless it is longer than any may be, or the span ends
   before or little behind. */
static void eqt_choose_lengths(eqt_lanes *lanes)
{
    int lane;
    for (lane = 0; lane < EQT_LANES; lane++) {
        double left = EQT_LANE(lanes->stop, lane) - EQT_LANE(lanes->t, lane);
        double step = EQT_LANE(lanes->step, lane);
        if (lanes->run[lane] < 0 || lanes->pinned[lane])
            continue;
        if (step > lanes->span->longest)
            step = lanes->span->longest;
        lanes->last[lane] = left <= 1.01 * step;
        EQT_LANE(lanes->h, lane) = lanes->last[lane] ? left : step;
    }
}

/* The samples that lie in the steps of some lanes. */
static void eqt_sample(eqt_lanes *lanes, eqt_mask accepted)
{
    const eqt_span *span = lanes->span;
    const eqt_real never = eqt_constant(EQT_INFINITY), one = eqt_constant(1.0);
    const eqt_mask last = eqt_lanes_where(lanes->last);
    eqt_real known = eqt_select(last, lanes->stop, lanes->t + lanes->h);
    eqt_mask errs = last, unused;
    int lane, i, prepared = 0;
    known = eqt_select(accepted, known, -never);
    for (;;) {
        eqt_mask due = ~eqt_less(known, lanes->due) & eqt_less(lanes->due, never), inside;
        eqt_real theta = (lanes->due - lanes->t) / lanes->h;
        if (!eqt_any(due))
            return;
        inside = due & eqt_less(lanes->due, lanes->stop) & eqt_less(theta, one);
        if (eqt_any(inside)) {
            if (!prepared) {
                eqt_prepare_dense(lanes);
                errs = eqt_less(eqt_constant(1.0), eqt_dense_error(lanes));
            }
            prepared = 1;
            eqt_in_step(lanes, theta, eqt_seen, lanes->at);
            if (eqt_any(inside & errs)) {
                /* A step of its own, which ends at the sample: those of the run stay as they are. */
                eqt_lanes aside = *lanes;
                aside.h = theta * lanes->h;
                eqt_try_step(&aside, &unused);
                for (i = 0; i < EQT_STATES; i++)
                    lanes->at[i] = eqt_select(errs, aside.next[i], lanes->at[i]);
            }
        }
        for (i = 0; i < EQT_STATES; i++)
            lanes->at[i] = eqt_select(inside, lanes->at[i], lanes->next[i]);
        eqt_at_samples(lanes, due);
        for (lane = 0; lane < EQT_LANES; lane++)
            if (EQT_LANE(due, lane)) {
                int64_t next = ++lanes->sample[lane];
                EQT_LANE(lanes->due, lane) = next < span->later ? span->grid[next] : EQT_INFINITY;
            }
    }
}

/* Ends the steps of some lanes that cross a comparison at the crossing: these are to be taken again,
   and are accepted no longer. */
static void eqt_pin_crossings(eqt_lanes *lanes, eqt_lanes *all, int *accepted, eqt_mask suspected)
{
    const eqt_real one = eqt_constant(1.0), zero = eqt_constant(0.0);
    eqt_mask wrong = eqt_wrong_somewhere(lanes, lanes->width);
    eqt_real at_end = eqt_select(wrong, one, zero), marked = eqt_select(suspected | wrong, one, zero);
    int lane, prepared = 0;
    for (lane = 0; lane < EQT_LANES; lane++) {
        double theta;
        if (!accepted[lane] || lanes->pinned[lane] || !(EQT_LANE(marked, lane) > 0.0))
            continue;
        if (!prepared)
            eqt_prepare_dense(lanes);
        prepared = 1;
        eqt_spread(lanes, lane, all);
        theta = eqt_crossing(all, EQT_LANE(lanes->width, lane), EQT_LANE(at_end, lane) > 0.0);
        if (theta > 1.0)
            continue;
        EQT_LANE(lanes->h, lane) = theta * EQT_LANE(lanes->h, lane);
        lanes->pinned[lane] = 1;
        lanes->last[lane] = lanes->last[lane] && theta == 1.0;
        accepted[lane] = 0;
    }
}

/* Changes the sides of comparisons that lanes have come to. */
static void eqt_cross(eqt_lanes *lanes, const int *crossing)
{
    eqt_mask kept[EQT_COMPARISONS + 1], where = eqt_lanes_where(crossing);
    eqt_real turned = eqt_constant(0.0);
    int j, lane;
    eqt_derivative(lanes, lanes->t, lanes->y, lanes->at);
    for (j = 0; j < EQT_COMPARISONS; j++) {
        kept[j] = where & eqt_wrong(lanes, j, eqt_constant(0.0));
        turned = eqt_select(kept[j], eqt_constant(1.0), turned);
        lanes->sides[j] = eqt_select(kept[j], -lanes->sides[j], lanes->sides[j]);
    }
    eqt_settle_sides(lanes, where, kept);
    for (lane = 0; lane < EQT_LANES; lane++)
        if (crossing[lane] && EQT_LANE(turned, lane) > 0.0) {
            double since = EQT_LANE(lanes->t, lane) - EQT_LANE(lanes->crossed_at, lane);
            lanes->returns[lane] = since < EQT_AT_ONCE ? lanes->returns[lane] + 1 : 0;
            EQT_LANE(lanes->crossed_at, lane) = EQT_LANE(lanes->t, lane);
            EQT_LANE(lanes->width, lane) =
                EQT_WIDTH * (double)(INT64_C(1) << (lanes->returns[lane] & 31));
            if (lanes->returns[lane] > EQT_MOST_RETURNS + EQT_COMPARISONS)
                eqt_leave(lanes, lane, EQT_SWITCHING);
        }
}

void eqt_advance(const eqt_span *span)
{
    eqt_lanes lanes = {0}, all;
    int64_t next_run = 0;
    int lane, i;
    lanes.span = span;
    for (i = 0; i < EQT_HELD; i++)
        lanes.held[i] = eqt_constant(span->held[i]);
    for (lane = 0; lane < EQT_LANES; lane++)
        lanes.run[lane] = -1;
    for (;;) {
        int accepted[EQT_LANES], crossing[EQT_LANES], active = 0, slopes = EQT_COMPARISONS;
        eqt_real error, factor;
        eqt_mask suspected, taken;
        if (*span->stopped) {
            for (lane = 0; lane < EQT_LANES; lane++)
                if (lanes.run[lane] >= 0)
                    eqt_leave(&lanes, lane, EQT_STOPPED);
            for (; next_run < span->runs; next_run++)
                if (span->ends[next_run] == EQT_THROUGH)
                    span->ends[next_run] = EQT_STOPPED;
            return;
        }
        for (lane = 0; lane < EQT_LANES; lane++) {
            while (lanes.run[lane] < 0 && next_run < span->runs) {
                int64_t run = next_run++;
                if (span->ends[run] == EQT_THROUGH)
                    eqt_take(&lanes, lane, run);
            }
            active |= lanes.run[lane] >= 0;
        }
        if (!active)
            return;
        if (eqt_any_of(lanes.fresh))
            eqt_begin(&lanes);
        eqt_choose_lengths(&lanes);
        error = eqt_try_step(&lanes, &suspected);
        factor = eqt_least(eqt_most(0.9 / eqt_eighth_root(error), eqt_constant(EQT_SHRINK)),
                           eqt_constant(EQT_GROW));
        for (lane = 0; lane < EQT_LANES; lane++) {
            int64_t sample = lanes.sample[lane];
            accepted[lane] = lanes.run[lane] >= 0 && EQT_LANE(error, lane) <= 1.0;
            slopes |= accepted[lane]
                      && (!lanes.last[lane]
                          || (sample < span->later && span->grid[sample] < EQT_LANE(lanes.stop, lane)));
        }
        /* Not needed at the end of a span where no sample lies in the last step. */
        if (slopes)
            eqt_derivative(&lanes, lanes.t + lanes.h, lanes.next, lanes.k[12]);
        for (lane = 0; lane < EQT_LANES; lane++) {
            double t = EQT_LANE(lanes.t, lane), h = EQT_LANE(lanes.h, lane);
            int64_t run = lanes.run[lane];
            if (run < 0)
                continue;
            span->counts[run]++;
            if (accepted[lane])
                continue;
            lanes.pinned[lane] = 0;
            lanes.rejected[lane] = 1;
            EQT_LANE(lanes.step, lane) =
                h * (EQT_LANE(error, lane) < EQT_INFINITY ? EQT_LANE(factor, lane) : 0.1);
            if (t + EQT_LANE(lanes.step, lane) == t
                || EQT_LANE(lanes.step, lane) < lanes.shortest[lane])
                eqt_leave(&lanes, lane,
                          EQT_LANE(error, lane) < EQT_INFINITY ? EQT_STEP_TOO_SHORT : EQT_NOT_FINITE);
            else if (span->counts[run] >= span->most_steps)
                eqt_leave(&lanes, lane, EQT_STEP_LIMIT);
        }
        if (EQT_COMPARISONS)
            eqt_pin_crossings(&lanes, &all, accepted, suspected);
        taken = eqt_lanes_where(accepted);
        if (span->later)
            eqt_sample(&lanes, taken);
        for (i = 0; i < EQT_STATES; i++) {
            lanes.y[i] = eqt_select(taken, lanes.next[i], lanes.y[i]);
            lanes.k[0][i] = eqt_select(taken, lanes.k[12][i], lanes.k[0][i]);
        }
        for (lane = 0; lane < EQT_LANES; lane++) {
            double h = EQT_LANE(lanes.h, lane), grown = h * EQT_LANE(factor, lane);
            int cut = lanes.last[lane] || lanes.pinned[lane];
            crossing[lane] = 0;
            if (!accepted[lane])
                continue;
            if (lanes.rejected[lane] && grown > h)
                grown = h;
            /* Of a step that was cut short, the error tells no more than that it may grow. */
            if (!(cut && EQT_LANE(factor, lane) == EQT_GROW && grown < EQT_LANE(lanes.step, lane)))
                EQT_LANE(lanes.step, lane) = grown;
            lanes.rejected[lane] = 0;
            crossing[lane] = lanes.fresh[lane] = 0;
            if (lanes.pinned[lane]) {
                crossing[lane] = 1;
                lanes.fresh[lane] = 2;
                lanes.pinned[lane] = 0;
            }
            if (lanes.last[lane]) {
                EQT_LANE(lanes.t, lane) = EQT_LANE(lanes.stop, lane);
                crossing[lane] = lanes.fresh[lane] = 0;
                eqt_leave(&lanes, lane, EQT_THROUGH);
            } else {
                EQT_LANE(lanes.t, lane) = EQT_LANE(lanes.t, lane) + h;
                if (span->counts[lanes.run[lane]] >= span->most_steps)
                    eqt_leave(&lanes, lane, EQT_STEP_LIMIT);
            }
        }
        if (EQT_COMPARISONS && eqt_any_of(crossing))
            eqt_cross(&lanes, crossing);
    }
}

#endif
