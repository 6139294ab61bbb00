{% set moments = law.moments %}
/* The reference at some times, the last of which is the end of its bounds. */
enum { TIMES = ${moments.times | length} };

static const double times[TIMES] =
    ${wrapped(row(moments.times), "    ").lstrip()};

{% for name, values in moments.values.items() %}
static const double expected_${name}[TIMES][${values.shape[1]}] = {
{% for numbers in values %}
${wrapped(row(numbers), "     ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

static const double bound_${name}[TIMES][${values.shape[1]}] = {
{% for numbers in moments.bounds[name] %}
${wrapped(row(numbers), "     ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

{% endfor %}
static void check_reference(void)
{
    int k, entry;
    for (k = 0; k < TIMES; k++) {
        ${label}_input input;
        ${label}_reference(times[k], &input);
{% for name, values in moments.values.items() %}
        for (entry = 0; entry < ${values.shape[1]}; entry++) {
            const double found = (double)input.${name}[entry];
            const double error = found - expected_${name}[k][entry];
            if (!((error < 0.0 ? -error : error) <= bound_${name}[k][entry])) {
                printf("${label}: the reference at t = %.17g s: ${name}[%d] is %.9g; expected %.9g "
                       "to within %.2g\n", times[k], entry, found, expected_${name}[k][entry],
                       bound_${name}[k][entry]);
                wrong = 1;
            }
        }
{% endfor %}
    }
    if (!wrong)
        printf("${label}: the reference passes at %d times until t = %g s\n", TIMES, times[TIMES - 1]);
}
