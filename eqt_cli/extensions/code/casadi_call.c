/* Calls a function that CasADi generated as a law: casadi_code.py replaces the names in braces.

   Inputs of laws are row by row; those of CasADi are column by column, without what is always 0. */
static void eqt_nonzeros(const long long *sp, long long row, long long column, double *x,
                         double *whole, int back)
{
    long long r, c, k, dense = sp[2];
    for (c = 0; c < sp[1]; c++)
        for (k = dense ? 0 : sp[2 + c]; k < (dense ? sp[0] : sp[3 + c]); k++, x++) {
            r = dense ? k : sp[3 + sp[1] + k];
            if (back) whole[r * row + c * column] = *x;
            else *x = whole[r * row + c * column];
        }
}
typedef struct { ${numbers} } ${name}_numbers;
typedef struct { double unused; } ${name}_memory;
typedef struct { ${inputs} } ${name}_input;
int ${name}_torque(const ${name}_numbers *n, ${name}_memory *m, const ${name}_input *in, double *torque)
{
    long long sizes[4];
    int k, mem, failed;
    (void)n, (void)m, (void)in;
    if (${name}_work(sizes, sizes + 1, sizes + 2, sizes + 3)) return 1;
    const double **arg = __builtin_alloca((sizes[0] + 1) * sizeof *arg);
    double **res = __builtin_alloca((sizes[1] + 1) * sizeof *res);
    long long *iw = __builtin_alloca((sizes[2] + 1) * sizeof *iw);
    double *w = __builtin_alloca((sizes[3] + 1) * sizeof *w);
    double given[${most}], back[${axes}];
    for (k = 0; k < sizes[1]; k++) res[k] = 0;
    res[0] = back;
    ${reads}
    mem = ${name}_checkout();
    failed = mem < 0 || ${name}(arg, res, iw, w, mem);
    if (mem >= 0) ${name}_release(mem);
    for (k = 0; k < ${axes}; k++) torque[k] = 0;
    eqt_nonzeros(${torque}, 1, ${axes}, back, torque, 1);
    return failed;
}
