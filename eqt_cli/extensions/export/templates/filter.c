{% set filter = law.filter %}

const ${label}_options ${label}_default_options = {
{% for each in filter.numbers %}
${wrapped("." ~ each.name ~ " = " ~ braced(filter.values[each.source].flat, law.by), "        ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

/* The filter, one operation a line. */
static ${emitted(filter.step, label ~ "_estimation")}
void ${label}_estimate(const ${label}_numbers *numbers, const ${label}_options *options,
        ${label}_filter *filter, const ${label}_measured *measured, ${label}_input *input)
{
    ${label}_filter next;
    ${wrapped(label ~ "_estimation(" ~ filter.arguments() | join(", ") ~ ");", "            ").lstrip()}
    *filter = next;
}

void ${label}_update(const ${label}_numbers *numbers, const ${label}_options *options,
        ${label}_filter *filter, ${label}_memory *memory, const ${label}_measured *measured,
        ${label}_input *input, ${real} torque[${m}])
{
    const int first = filter->begun[0] == 0;
    ${label}_estimate(numbers, options, filter, measured, input);
    if (first)
        ${label}_start(numbers, memory, input);
    ${label}_torque(numbers, memory, input, torque);
}
