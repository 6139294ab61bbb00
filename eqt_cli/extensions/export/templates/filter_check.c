{% set count = law.filter.estimates | length %}
{% set numbers = law.filter.estimates.shape[1] %}

/* The filter through ${count} instants, against what eqt computes. */
static const ${label}_measured measurements[${count}] = {
{% for each in measurements(law) %}
${wrapped(each, "     ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

static const double estimates[${count}][${numbers}] = {
{% for each in law.filter.estimates %}
${wrapped(row(each), "     ", "    ")}${"" if loop.last else ","}
{% endfor %}
};

static void check_filter(void)
{
    static const ${label}_filter none;
    ${label}_filter filter = none;
    ${label}_input input = examples[0].input;
    int instant, entry;
    for (instant = 0; instant < ${count}; instant++) {
        ${label}_estimate(&${label}_defaults, &${label}_default_options, &filter,
                          &measurements[instant], &input);
        for (entry = 0; entry < ${numbers}; entry++) {
            const double found = entry < ${law.loop.group.size ** 2} ? (double)input.pose[entry]
                                                  : (double)input.velocity[entry - ${law.loop.group.size ** 2}];
            const double off = found - estimates[instant][entry];
            if ((off < 0 ? -off : off) <= ${tolerance[real]})
                continue;
            if (!wrong)
                printf("${label}: filter, instant %d of ${count}: number %d is %.9g; expected %.9g\n",
                       instant, entry, found, estimates[instant][entry]);
            wrong = 1;
        }
    }
}
