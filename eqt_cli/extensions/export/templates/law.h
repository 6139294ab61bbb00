/* Exported by eqt ${version}: ${comment(law.title)} on ${law.loop.group.name}.

   ${indented(comment(law.about))}

   Experiment ${comment(law.experiment.name)}, configuration ${law.experiment.digest[:16]}.

   Arrays are row by row, coordinates in the order ${law.loop.group.axis_names | join(", ")}, and velocities,
   accelerations and torques are those of the body frame{% if law.adapter %}, unless the field says otherwise{% endif %}. At t = k period, call ${label}_torque with
   what is known at that time, and hold its torque until the next call. There is no other state than
   that of the structures below: two vehicles need two of them.

   Rounding, in ${real}: at ${law.states.along} states of ${law.states.runs} runs of this experiment, and at ${law.states.count - law.states.along} random
   ones of their size with any error of the pose, some of them half turns, the torque differs from
   that of exact numbers by at most
${wrapped(bounds_in_words(law), "       ")}
   ${indented(apart_in_words(law))}
{% if law.reads_time %}
   The law reads the time itself: these bounds hold until t = ${"%g" | format(law.latest)} s, the latest of these states.
{% endif %}

   ${law.program.step.operations} operations. ${label}_check.c checks all of this, and the file README.md has more. */
#ifndef ${label | upper}_H
#define ${label | upper}_H

#ifdef __cplusplus
extern "C" {
#endif

/* What the law is told. */
typedef struct {
${declared(input)}
} ${label}_input;

/* Its numbers. */
typedef struct {
${declared(numbers)}
} ${label}_numbers;

/* {% if law.program.memory %}Its memory, which a period changes.{% else %}It has no memory; there is a number all the same, since C has no empty structure.{% endif %} */
typedef struct {
${declared(memory)}
} ${label}_memory;

{% if outputs %}
/* Its other numbers, which change nothing. */
typedef struct {
${declared(outputs)}
} ${label}_outputs;

{% endif %}
/* The numbers of the experiment. */
extern const ${label}_numbers ${label}_defaults;

/* Sets the memory to that of the start: once, before the first torque. */
void ${label}_start(const ${label}_numbers *numbers, ${label}_memory *memory, const ${label}_input *input);

/* The {% if law.loop.controller.commands != "torque" %}${law.loop.controller.commands} in place of a torque{% if law.loop.group.dimension > 3 %}, then the force{% endif %}{% else %}torque{% endif %}, in ${comment(law.program.torque.unit)}; then the memory goes on by one period. */
void ${label}_torque(const ${label}_numbers *numbers, ${label}_memory *memory, const ${label}_input *input,
        ${real} torque[${m}]);
{% if outputs %}

/* Its other numbers for an input and the memory as it is: before ${label}_torque, or after it. */
void ${label}_give(const ${label}_numbers *numbers, const ${label}_memory *memory, const ${label}_input *input,
        ${label}_outputs *outputs);
{% endif %}
{% if law.reference %}{% include "reference.h" %}{% endif %}{% if law.filter %}{% include "filter.h" %}{% endif %}{% if law.allocation %}{% include "allocation.h" %}{% endif +%}
#ifdef __cplusplus
}
#endif

#endif
