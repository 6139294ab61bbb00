/* The kernel that integrates one run a work item. It is included behind advance.h and what is done at
   samples; its arguments are those of eqt_span and eqt_measuring. The sources of a program that
   measures lie in `rows`; `places` has the first number of each, and how far it is to the next run
   and to the next sample. */
#ifndef EQT_KERNEL_H
#define EQT_KERNEL_H

__kernel void eqt_runs(long later, long most_steps, double start, double stop, double first_inside,
                       double last_inside, double rtol, double atol, double longest,
                       __global const double *grid, __global const double *held, __global const double *parameters,
                       __global double *states, __global double *samples, __global double *steps,
                       __global long *counts, __global long *ends, __global double *times,
                       __global const double *rows, __global const long *places,
                       __global const double *starts, __global double *memory,
                       __global double *kept)
{
    const long run = get_global_id(0), to_next_run = later * EQT_STATES;
    eqt_span span = {1,    later,        most_steps,  to_next_run, EQT_STATES, start, stop, first_inside,
                     last_inside, rtol, atol, longest, grid, held};
#ifdef EQT_MEASURE
    eqt_source sources[EQT_SOURCES];
    struct eqt_measuring measuring = {sources, starts, memory + run * EQT_MEMORY,
                                      kept + run * (later + 1) * EQT_KEPT};
    int k;
    for (k = 0; k < EQT_SOURCES; k++) {
        sources[k].from = rows + places[3 * k] + run * places[3 * k + 1];
        sources[k].to_next_run = places[3 * k + 1];
        sources[k].to_next_sample = places[3 * k + 2];
    }
    span.measuring = &measuring;
#else
    span.samples = samples + run * to_next_run;
#endif
    span.parameters = parameters + run * EQT_PARAMETERS;
    span.states = states + run * EQT_STATES;
    span.steps = steps + run;
    span.counts = counts + run;
    span.ends = ends + run;
    span.times = times + run;
    eqt_advance(&span);
}

#endif
