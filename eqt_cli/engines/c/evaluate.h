/* Evaluates an emitted program for many runs at many samples, EQT_LANES of them side by side.

   It is included behind lanes.h, rows.h and the emitted program, which defines

     EQT_SOURCES, EQT_INPUTS     stretches of its inputs, and how many numbers they have in all
     EQT_ARRAYS, EQT_OUTPUTS     the same of its outputs
     eqt_lengths, eqt_found_lengths   of each stretch, and of each array
     EQT_CALL(in, out)           calls it */
#ifndef EQT_EVALUATE_H
#define EQT_EVALUATE_H

void eqt_evaluate(const eqt_evaluations *evaluations)
{
    eqt_real in[EQT_INPUTS + 1], out[EQT_OUTPUTS + 1];
    /* Lanes are neighbours in one of two directions: what is the same along it is read once. */
    const int by_sample = evaluations->samples > 1;
    const int64_t rows = by_sample ? evaluations->runs : 1;
    const int64_t columns = by_sample ? evaluations->samples : evaluations->runs;
    int64_t row, first, i;
    int lane, k;
    for (row = 0; row < rows; row++)
        for (first = 0; first < columns; first += EQT_LANES) {
            int64_t run[EQT_LANES], sample[EQT_LANES], read = 0, written = 0;
            for (lane = 0; lane < EQT_LANES; lane++) {
                int64_t column = first + lane < columns ? first + lane : columns - 1;
                run[lane] = by_sample ? row : column;
                sample[lane] = by_sample ? column : 0;
            }
            for (k = 0; k < EQT_SOURCES; k++) {
                const eqt_source *source = evaluations->sources + k;
                if (first == 0 || (by_sample ? source->to_next_sample : source->to_next_run))
                    eqt_read(source, eqt_lengths[k], run, sample, in + read);
                read += eqt_lengths[k];
            }
            EQT_CALL(in, out);
            for (i = 0; i < EQT_OUTPUTS; i++)
                out[i] = eqt_canonical(out[i]); /* processors differ in the bits of a NaN */
            for (k = 0; k < EQT_ARRAYS; k++) {
                const int64_t length = eqt_found_lengths[k];
                for (lane = 0; lane < EQT_LANES && first + lane < columns; lane++) {
                    double *to = evaluations->outputs[k]
                                 + (run[lane] * evaluations->samples + sample[lane]) * length;
                    for (i = 0; i < length; i++)
                        to[i] = EQT_LANE(out[written + i], lane);
                }
                written += length;
            }
        }
}

#endif
