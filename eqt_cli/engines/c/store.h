/* Stores the states at samples. It is included behind advance.h. */
#ifndef EQT_STORE_H
#define EQT_STORE_H

static void eqt_at_start(eqt_lanes *lanes, eqt_mask starts) { (void)lanes, (void)starts; }

static void eqt_at_samples(eqt_lanes *lanes, eqt_mask due)
{
    const eqt_span *span = lanes->span;
    int lane, i;
    for (lane = 0; lane < EQT_LANES; lane++)
        if (EQT_LANE(due, lane)) {
            double *row = span->samples + lanes->run[lane] * span->to_next_run
                          + lanes->sample[lane] * span->row;
            for (i = 0; i < EQT_STATES; i++)
                row[i] = EQT_LANE(lanes->at[i], lane);
        }
}

static void eqt_end_samples(eqt_lanes *lanes, int lane, int64_t end)
{
    (void)lanes, (void)lane, (void)end;
}

#endif
