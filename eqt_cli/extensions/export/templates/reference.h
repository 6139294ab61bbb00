{% set names = law.reference.motion.outputs | map(attribute="name") | list %}

{% if law.loop.period %}
/* The period, s: the time is a count of periods times this. */
#define ${label | upper}_PERIOD ${law.loop.period}

{% endif %}
/* Sets ${(["t"] + names[:-1]) | join(", ")} and ${names[-1]} of what the law is told at a time t, s.
{% if real == "float" %}
   The time is in double, and so is the motion: in float, hours would be milliseconds off.
{% endif %}
{% if law.reference.stops %}
   Before t = ${law.reference.ends[0]} s and after t = ${law.reference.ends[1]} s it stands still at the pose there.
{% endif %}
   Until t = ${"%g" | format(law.moments.until)} s, they differ from those of exact numbers by at most
${wrapped(law.moments.in_words(), "       ")} */
void ${label}_reference(double t, ${label}_input *input);
