{% set found = law.allocation %}
{% set count = found.inverse | length %}
{% if found.program %}

static ${emitted(found.program, label ~ "_thrusts")}
void ${label}_allocate(const ${real} torque[${m}], ${real} found[${count}])
{
    ${label}_thrusts(torque, found);
}
{% else %}

static const ${real} ${label}_inverse[${count}][${m}] = {
{% for each in found.inverse %}
${wrapped(braced(each, law.by), "     ", "    ")},
{% endfor %}
};
{% for name, sign, numbers in found.limits %}
static const ${real} ${label}_${name}[${count}] =
${wrapped(braced(numbers, law.by), "    ")};
{% endfor %}

void ${label}_allocate(const ${real} torque[${m}], ${real} found[${count}])
{
    for (int i = 0; i < ${count}; i++) {
        ${real} sum = ${label}_inverse[i][0] * torque[0];
        for (int j = 1; j < ${m}; j++)
            sum += ${label}_inverse[i][j] * torque[j];
{% for name, sign, _ in found.limits %}
        if (sum ${sign} ${label}_${name}[i])
            sum = ${label}_${name}[i];
{% endfor %}
        found[i] = sum;
    }
}
{% endif %}
