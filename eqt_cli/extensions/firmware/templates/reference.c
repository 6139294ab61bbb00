{% set found = law.reference %}
{% set pieces = found.starts | length %}

{% if pieces %}
/* When each piece of the reference begins, s, and its numbers. */
static const ${real} ${label}_starts[${pieces}] =
    ${wrapped(braced(found.starts, law.by), "    ").lstrip()};

static const ${real} ${label}_pieces[${pieces}][${found.held.shape[1]}] = {
{% for numbers in found.held %}
${wrapped(braced(numbers, law.by), "     ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

{% else %}

{% endif %}
static ${emitted(found.motion, label ~ "_motion")}
void ${label}_reference(${real} t, ${label}_input *input)
{
{% if pieces %}
    int piece = 0;
    while (piece < ${pieces - 1} && ${label}_starts[piece + 1] <= t)
        piece++;
{% else %}

{% endif %}
    input->t = t;
    ${label}_motion(&input->t, {% if pieces %}${label}_pieces[piece]{% else %}&input->t{% endif %}, {% for output in found.motion.outputs %}input->${output.name}${"" if loop.last else ", "}{% endfor %});
}
