/* Exported by eqt ${version}: ${comment(law.title)} on ${law.loop.group.name}. The file ${label}.h says what it does.

   It needs no header and no library. Compile it with -ffp-contract=off, for the same bits on every
   machine, and with -fno-math-errno, so that a square root is one instruction; the bounds of the
   header hold for every compiler that rounds as IEEE 754 says. */
#include "${label}.h"

#ifdef __FAST_MATH__
#error "the bounds of ${label}.h do not hold with -ffast-math; compile this file without it"
#endif
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

${functions}
const ${label}_numbers ${label}_defaults = {
{% for entry in law.program.numbers %}
${default(law, entry)}${"" if loop.last else ","}
{% endfor %}
};

/* One operation a line, as the law is written in eqt. */
static ${step}
${start}${output}
void ${label}_start(const ${label}_numbers *numbers, ${label}_memory *memory, const ${label}_input *input)
{
{% for line in starting %}
    ${line}
{% endfor %}
}

void ${label}_torque(const ${label}_numbers *numbers, ${label}_memory *memory, const ${label}_input *input,
        ${real} torque[${m}])
{
{% for line in stepping %}
    ${line}
{% endfor %}
}
{% if giving %}

void ${label}_give(const ${label}_numbers *numbers, const ${label}_memory *memory, const ${label}_input *input,
        ${label}_outputs *outputs)
{
    (void)numbers;
    (void)memory;
    (void)input;
    ${giving}
}
{% endif %}
${reference}{% if law.filter %}{% include "filter.c" %}{% endif %}{% if law.allocation %}{% include "allocation.c" %}{% endif +%}
