/* Calls the network of a law for rows, one a run. The text before this file defines `network`, and

   EQT_INPUTS, EQT_OUTPUTS, EQT_AXES   how many it reads and commands, and of the torque
   EQT_HIDDEN, EQT_MEMORY              its states, and these with the outputs that it remembers
   EQT_REMEMBERS, EQT_LAST_AT          how many of its last outputs it reads, and where
   EQT_LAST_SCALE, EQT_LIMITED         their scale, and y[i] within its limits
   EQT_OFFSET, EQT_LINEAR, EQT_SQUARE  the curve of each command
   EQT_MATRIX                          from the commands to the torque, row by row */

static const double offset[] = {EQT_OFFSET}, linear[] = {EQT_LINEAR},
    square[] = {EQT_SQUARE}, to_torque[] = {EQT_MATRIX};

/* States are those of the network, and its last outputs. */
void eqt_code(long runs, int how, double period, const double *options, double *states,
              const double *inputs, double *torques, unsigned char *outcomes, double *apart)
{
    long run, i, k;
    (void)how, (void)period, (void)options, (void)outcomes, (void)apart;
    for (run = 0; run < runs; run++) {
        double x[EQT_INPUTS], y[EQT_OUTPUTS], u[EQT_OUTPUTS];
        double *h = states + run * EQT_MEMORY, *last = h + EQT_HIDDEN;
        for (i = 0; i < EQT_INPUTS; i++) x[i] = inputs[run * EQT_INPUTS + i];
        for (i = 0; i < EQT_OUTPUTS * EQT_REMEMBERS; i++)
            x[EQT_LAST_AT + i] = EQT_LAST_SCALE * last[i];
        network(x, h, y);
        for (i = EQT_OUTPUTS; i < EQT_OUTPUTS * EQT_REMEMBERS; i++) last[i - EQT_OUTPUTS] = last[i];
        for (i = 0; i < EQT_OUTPUTS; i++) {
            y[i] = EQT_LIMITED;
            if (EQT_REMEMBERS) last[EQT_OUTPUTS * (EQT_REMEMBERS - 1) + i] = y[i];
            u[i] = offset[i] + (linear[i] + square[i] * y[i]) * y[i];
        }
        for (k = 0; k < EQT_AXES; k++) {
            double sum = 0.0;
            for (i = 0; i < EQT_OUTPUTS; i++) sum += to_torque[EQT_OUTPUTS * k + i] * u[i];
            torques[run * EQT_AXES + k] = sum;
        }
    }
}
