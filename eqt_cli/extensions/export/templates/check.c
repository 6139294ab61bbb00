/* Exported by eqt ${version}: checks ${label}.c at ${examples | length} states of the experiment ${comment(law.experiment.name)}.

       cc -std=c99 -O2 -ffp-contract=off -fno-math-errno ${label}_check.c ${label}.c -o ${label}_check

   It prints the largest errors, and its exit status is 0 where every torque is within the bound of its
   rounding, else 1. Give them with the exit status as evidence: it holds for this compiler and
   this processor. */
#include <stdio.h>

#include "${label}.h"

enum { STATES = ${examples | length}, TORQUES = ${m}, MEMORY = ${law.program.memory | sum(attribute="size")},
       OUTPUTS = ${law.program.outputs | sum(attribute="size")} };

/* A state, and what exact numbers give of it. */
typedef struct {
    ${label}_input input;
    ${label}_memory memory;
    double torque[TORQUES], torque_bound[TORQUES];
    double after[MEMORY + 1], after_bound[MEMORY + 1];
    double given[OUTPUTS + 1], given_bound[OUTPUTS + 1];
    int singular; /* near a singularity, such as a half turn, where bounds are large */
} example;

static const example examples[STATES] = {
{% for state in examples %}
    {
${state}
    }${"" if loop.last else ","}
{% endfor %}
};

static const double start[MEMORY + 1] = ${start}, start_bound[MEMORY + 1] = ${start_bound};

/* Away from singularities, and near them. */
static double largest[2], allowed[2];
static int wrong;

static void compare(const char *what, int state, int entry, double found, double expected,
                    double bound)
{
    const double error = found < expected ? expected - found : found - expected;
    if (error <= bound) {
        const int near = examples[state].singular;
        if (error * allowed[near] > largest[near] * bound || allowed[near] == 0.0) {
            largest[near] = error;
            allowed[near] = bound;
        }
        return;
    }
    if (!wrong)
        printf("${label}: state %d of %d{% if not law.adapter %}, t = %.9g s{% endif %}: %s[%d] is %.9g; expected %.9g to within %.2g\n",
               state, STATES, {% if not law.adapter %}(double)examples[state].input.t, {% endif %}what, entry, found, expected, bound);
    wrong = 1;
}

{% if law.reference %}{% include "reference_check.c" %}

{% endif %}
{% if law.filter %}{% include "filter_check.c" %}{% else %}static void check_filter(void)
{
}
{% endif +%}
int main(void)
{
    int state, entry, near = 0;
    for (state = 0; state < STATES; state++) {
        const example *each = &examples[state];
        ${label}_memory memory = each->memory;
        const ${real} *numbers = (const ${real} *)&memory;
        ${real} torque[TORQUES];
{% if law.program.outputs %}
        ${label}_outputs outputs;
        const ${real} *given = (const ${real} *)&outputs;
        ${label}_give(&${label}_defaults, &memory, &each->input, &outputs);
        for (entry = 0; entry < OUTPUTS; entry++)
            compare("output", state, entry, (double)given[entry], each->given[entry],
                    each->given_bound[entry]);
{% endif %}
        near += each->singular;
        ${label}_torque(&${label}_defaults, &memory, &each->input, torque);
        for (entry = 0; entry < TORQUES; entry++)
            compare("torque", state, entry, (double)torque[entry], each->torque[entry],
                    each->torque_bound[entry]);
        for (entry = 0; entry < MEMORY; entry++)
            compare("memory", state, entry, (double)numbers[entry], each->after[entry],
                    each->after_bound[entry]);
        if (state == 0) {
            ${label}_start(&${label}_defaults, &memory, &each->input);
            for (entry = 0; entry < MEMORY; entry++)
                compare("memory at the start", state, entry, (double)numbers[entry], start[entry],
                        start_bound[entry]);
        }
    }
    check_filter();
{% if law.reference %}
    check_reference();
{% endif %}
    if (wrong)
        return 1;
    if (near < STATES)
        printf("${label}: %d states pass; the largest error is %.2g, where %.2g is allowed\n",
               STATES - near, largest[0], allowed[0]);
    if (near)
        printf("${label}: %d states near a singularity, such as a half turn, pass; the largest error "
               "is %.2g, where %.2g is allowed\n", near, largest[1], allowed[1]);
    return 0;
}
