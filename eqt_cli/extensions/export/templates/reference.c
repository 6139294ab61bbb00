{% set found = law.reference %}
{% set pieces = found.starts | length %}
{% set first, last = found.ends %}

{% if pieces %}
/* When each piece of the reference begins, s, and its numbers. */
static const double ${label}_starts[${pieces}] =
    ${wrapped(row(found.starts), "    ").lstrip()};

static const double ${label}_pieces[${pieces}][${found.held.shape[1]}] = {
{% for numbers in found.held %}
${wrapped(row(numbers), "     ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

{% else %}

{% endif %}
static ${emitted(found.motion, label ~ "_motion")}
void ${label}_reference(double t, ${label}_input *input)
{
{% if real == "float" or (found.stops and found.rates) %}
    int k;
{% endif %}
{% if real == "float" %}
{% for output in found.motion.outputs %}
    double ${output.name}[${output.entries | length}];
{% endfor %}
{% endif %}
{% if found.stops and found.rates %}
    const double asked = t;
{% endif %}
{% if pieces %}
    int piece = 0;
{% elif real == "double" and not found.stops %}

{% endif %}
    input->t = {% if real == "float" %}(float){% endif %}t;
{% if found.stops %}
    t = t < ${first} ? ${first} : t > ${last} ? ${last} : t;
{% endif %}
{% if pieces %}
    while (piece < ${pieces - 1} && ${label}_starts[piece + 1] <= t)
        piece++;
{% endif %}
    ${label}_motion(&t, {% if pieces %}${label}_pieces[piece]{% else %}&t{% endif %}, {% for output in found.motion.outputs %}{% if real == "double" %}input->{% endif %}${output.name}${"" if loop.last else ", "}{% endfor %});
{% if real == "float" %}
{% for output in found.motion.outputs %}
    for (k = 0; k < ${output.entries | length}; k++)
        input->${output.name}[k] = (float)${output.name}[k];
{% endfor %}
{% endif %}
{% if found.stops and found.rates %}
    for (k = 0; k < ${m} && t != asked; k++)
        ${"input->" ~ found.rates | join("[k] = input->") ~ "[k] = 0;"}
{% endif %}
}
