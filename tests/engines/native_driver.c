/* Integrates one problem without Python. It is compiled behind the C of eqt_advance and, where the
   law is sampled, that of eqt_evaluate for the state after an instant. From stdin it reads numbers of
   8 bytes as test_native.py lays them out, and it writes all that it finds to stdout. */
#include <stdio.h>
#include <stdlib.h>

static void take(void *to, int64_t count)
{
    if (fread(to, 8, (size_t)count, stdin) != (size_t)count)
        exit(1);
}

static void give(const void *from, int64_t count)
{
    if (fwrite(from, 8, (size_t)count, stdout) != (size_t)count)
        exit(1);
}

static void *room(int64_t count) { return calloc((size_t)(count + 1), 8); }

int main(void)
{
    int64_t sizes[5], k;
    double tolerances[2];
    take(sizes, 5); /* runs, spans, most steps, numbers of errors of pose and of velocity */
    take(tolerances, 2);
    {
        const int64_t runs = sizes[0];
        double *states = room(runs * EQT_STATES), *parameters = room(runs * EQT_PARAMETERS);
        double *held = room(EQT_HELD), *steps = room(runs), *times = room(runs);
        double *pose = room(runs * sizes[3]), *velocity = room(runs * sizes[4]);
        int64_t *counts = room(runs), *ends = room(runs);
        take(states, runs * EQT_STATES);
        take(parameters, runs * EQT_PARAMETERS);
        for (k = 0; k < sizes[1]; k++) {
            int64_t later, instant;
            double limits[4], *grid, *samples;
            take(&later, 1);
            take(&instant, 1);
            take(limits, 4); /* start, stop, and between which times the field is evaluated */
            grid = room(later);
            samples = room(runs * later * EQT_STATES);
            take(grid, later);
            take(held, EQT_HELD);
            if (instant) {
                take(pose, runs * sizes[3]);
                take(velocity, runs * sizes[4]);
#ifdef EQT_SOURCES
                {
                    const eqt_source sources[] = {{states, EQT_STATES, 0},
                                                  {limits, 0, 0},
                                                  {parameters, EQT_PARAMETERS, 0},
                                                  {held, 0, 0},
                                                  {pose, sizes[3], 0},
                                                  {velocity, sizes[4], 0}};
                    double *after = room(runs * EQT_STATES), *found[1];
                    const eqt_evaluations asked = {runs, 1, sizeof sources / sizeof *sources, sources, found};
                    found[0] = after;
                    eqt_evaluate(&asked);
                    free(states);
                    states = after;
                }
#endif
            }
            give(states, runs * EQT_STATES);
            {
                const int64_t stopped = 0;
                const eqt_span span = {.stopped = &stopped,
                                       .runs = runs,
                                       .later = later,
                                       .most_steps = sizes[2],
                                       .to_next_run = later * EQT_STATES,
                                       .row = EQT_STATES,
                                       .start = limits[0],
                                       .stop = limits[1],
                                       .longest = limits[1] - limits[0],
                                       .first_inside = limits[2],
                                       .last_inside = limits[3],
                                       .rtol = tolerances[0],
                                       .atol = tolerances[1],
                                       .grid = grid,
                                       .held = held,
                                       .parameters = parameters,
                                       .states = states,
                                       .samples = samples,
                                       .steps = steps,
                                       .counts = counts,
                                       .ends = ends,
                                       .times = times};
                eqt_advance(&span);
            }
            give(samples, runs * later * EQT_STATES);
            free(grid);
            free(samples);
        }
        give(states, runs * EQT_STATES);
        give(counts, runs);
        give(ends, runs);
    }
    return 0;
}
