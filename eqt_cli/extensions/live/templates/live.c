/* What a page calls: numbers of some runs in, their samples and metrics out; it allocates nothing.

   It stands behind the programs of a loop: eqt_advance, and eqt_evaluate_NAME of begin, look, end and,
   of a sampled law, instant. The macros L_… are the lengths of its arrays. */
#define EXPORT(name) __attribute__((export_name(#name))) __attribute__((used))

typedef struct {
    double start, stop, first_inside, last_inside, longest, first, later, sampled_start, tick;
} live_span;

static double parameters[L_RUNS][L_PARAMETERS], starts[L_RUNS][L_START], held[L_SPANS][L_HELD + 1],
    held_at_samples[L_SAMPLES][L_HELD_AT_SAMPLES + 1], held_at_start[L_HELD_AT_START + 1],
    times[L_SAMPLES], columns[L_SAMPLES][L_COLUMNS + 1], memory_before[L_MEMORY + 1],
    errors[L_RUNS][L_TICKS + 1][L_ERRORS + 1], kept[L_RUNS][L_SAMPLES][L_KEPT],
    numbers[L_NUMBERS][L_RUNS], ended[L_RUNS][3], pose[L_RUNS][L_POSE], velocity[L_RUNS][L_VELOCITY],
    states[L_RUNS][L_STATE], commanded[L_RUNS][L_STATE], samples[L_RUNS][L_SAMPLES][L_STATE],
    memory[2][L_RUNS][L_MEMORY + 1], reference[L_REFERENCE], lengths[L_RUNS], ended_at[L_RUNS];
static live_span spans[L_SPANS];
static int64_t counts[L_RUNS], ends[L_RUNS], stopped;

/* The arrays that the page fills in and reads, by their number; rows are as long as eqt_read steps. */
EXPORT(place) double *place(int array)
{
    double *const places[] = {parameters[0], starts[0], held[0], held_at_samples[0], held_at_start,
                              times, columns[0], memory_before, errors[0][0], &spans[0].start,
                              kept[0][0], numbers[0], ended[0]};
    return places[array];
}

/* a b + c, for the page to find out whether it is rounded once. */
EXPORT(fused) double fused(double a, double b, double c)
{
    eqt_real sum = eqt_fma(eqt_constant(a), eqt_constant(b), eqt_constant(c));
    return EQT_LANE(sum, 0);
}

static int is_finite(const double *values, int count)
{
    int i;
    for (i = 0; i < count; i++)
        if (!(values[i] - values[i] == 0.0))
            return 0;
    return 1;
}

static void leave(int run, double t)
{
    ends[run] = 2; /* not finite, as in advance.h */
    ended_at[run] = t;
}

#ifdef L_SAMPLED
static void act(int runs, int index)
{
    const live_span *here = spans + index;
    const eqt_source sources[] = {
        {states[0], L_STATE, 0}, {&here->start, 0, 0}, {parameters[0], L_PARAMETERS, 0}, {held[index], 0, 0},
        {errors[0][(int)here->tick], (L_TICKS + 1) * (L_ERRORS + 1), 0}};
    double *const outputs[] = {commanded[0]};
    const eqt_evaluations law = {runs, 1, L_ERRORS ? 5 : 4, sources, outputs};
    int run, i;
    eqt_evaluate_instant(&law);
    for (run = 0; run < runs; run++) {
        if (ends[run])
            continue;
        if (!is_finite(commanded[run], L_STATE) || (L_LOST >= 0 && commanded[run][L_LOST] != 0.0))
            leave(run, here->start);
        for (i = 0; i < L_STATE; i++)
            states[run][i] = commanded[run][i];
    }
}
#endif

/* Begins the runs and walks them through all spans; samples that they do not reach are NaN. */
static void walk(int runs, double rtol, double atol, double most_steps)
{
    const eqt_source sources[] = {
        {starts[0], L_START, 0}, {times, 0, 0}, {parameters[0], L_PARAMETERS, 0}, {held_at_start, 0, 0}};
    double *const outputs[] = {pose[0], velocity[0], states[0]};
    const eqt_evaluations begin = {runs, 1, 4, sources, outputs};
    eqt_span span = {0};
    int run, index, sample, i;
    for (run = 0; run < runs; run++)
        lengths[run] = ended_at[run] = 0.0, counts[run] = ends[run] = 0;
    eqt_evaluate_begin(&begin);
    span.runs = runs, span.row = L_STATE, span.to_next_run = L_SAMPLES * L_STATE;
    span.rtol = rtol, span.atol = atol, span.most_steps = (int64_t)most_steps;
    span.parameters = parameters[0], span.states = states[0], span.steps = lengths, span.counts = counts;
    span.ends = ends, span.times = ended_at, span.stopped = &stopped;
    for (index = 0; index < L_SPANS; index++) {
        const live_span *here = spans + index;
        const int first = (int)here->first, stop = first + (int)here->later;
#ifdef L_SAMPLED
        if (here->tick >= 0)
            act(runs, index);
#endif
        if (here->sampled_start)
            for (run = 0; run < runs; run++)
                for (i = 0; i < L_STATE; i++)
                    samples[run][first - 1][i] = states[run][i];
        span.later = (int64_t)here->later, span.start = here->start, span.stop = here->stop;
        span.first_inside = here->first_inside, span.last_inside = here->last_inside;
        span.longest = here->longest, span.grid = times + first, span.held = held[index];
        span.samples = samples[0][first];
        eqt_advance(&span);
        for (run = 0; run < runs; run++) {
            if (!ends[run] && !is_finite(states[run], L_STATE))
                leave(run, here->start);
            for (sample = first; sample < stop; sample++)
                for (i = EQT_STATES; i < L_STATE; i++)
                    samples[run][sample][i] = states[run][i];
        }
    }
    for (run = 0; run < runs; run++) {
        int lost = 0;
        for (sample = 0; sample < L_SAMPLES; sample++) {
            lost |= (ends[run] && times[sample] > ended_at[run]) || !is_finite(samples[run][sample], L_STATE);
            for (i = 0; lost && i < L_STATE; i++)
                samples[run][sample][i] = EQT_NAN;
        }
    }
}

/* Looks at the samples in order, and at their end. */
static void measure(int runs)
{
    double *rows[L_NUMBERS];
    int sample, run, i;
    for (run = 0; run < runs; run++)
        for (i = 0; i < L_MEMORY; i++)
            memory[0][run][i] = memory_before[i];
    for (sample = 0; sample < L_SAMPLES; sample++) {
        double (*before)[L_MEMORY + 1] = memory[sample % 2], (*after)[L_MEMORY + 1] = memory[1 - sample % 2];
        static double next[L_RUNS][L_MEMORY + 1], now[L_RUNS][L_KEPT];
        const eqt_source sources[] = {
            {samples[0][sample], L_SAMPLES * L_STATE, 0}, {reference, 0, 0}, {times + sample, 0, 0},
            {parameters[0], L_PARAMETERS, 0}, {held_at_samples[sample], 0, 0}, {columns[sample], 0, 0},
            {before[0], L_MEMORY + 1, 0}};
        double *const outputs[] = {next[0], now[0]};
        const eqt_evaluations look = {runs, 1, 7, sources, outputs};
        eqt_evaluate_look(&look);
        for (run = 0; run < runs; run++) {
            for (i = 0; i < L_MEMORY; i++)
                after[run][i] = next[0][run * L_MEMORY + i];
            for (i = 0; i < L_KEPT; i++)
                kept[run][sample][i] = now[0][run * L_KEPT + i];
        }
    }
    for (i = 0; i < L_NUMBERS; i++)
        rows[i] = numbers[i];
    {
        const eqt_source sources[] = {{memory[L_SAMPLES % 2][0], L_MEMORY + 1, 0}};
        const eqt_evaluations end = {runs, 1, 1, sources, rows};
        eqt_evaluate_end(&end);
    }
}

EXPORT(live) void live(int runs, double rtol, double atol, double most_steps)
{
    int run;
    walk(runs, rtol, atol, most_steps);
    measure(runs);
    for (run = 0; run < runs; run++) {
        ended[run][0] = (double)ends[run];
        ended[run][1] = (double)counts[run];
        ended[run][2] = ended_at[run];
    }
}

/* No library is linked; compilers call these two. */
typedef __SIZE_TYPE__ live_size;
__attribute__((used)) void *memcpy(void *to, const void *from, live_size count)
{
    char *a = to;
    const char *b = from;
    while (count--)
        *a++ = *b++;
    return to;
}
__attribute__((used)) void *memset(void *to, int value, live_size count)
{
    char *a = to;
    while (count--)
        *a++ = (char)value;
    return to;
}
