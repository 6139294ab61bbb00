
/* What is measured. */
typedef struct {
${declared(measured)}
} ${label}_measured;

/* The options of the filter '${law.filter.estimator.name}'. */
typedef struct {
${declared(options)}
} ${label}_options;

/* What the filter keeps; all 0 before its first call. */
typedef struct {
${declared(states)}
} ${label}_filter;

/* The options of the experiment. */
extern const ${label}_options ${label}_default_options;

/* The filter: sets pose and velocity of the input to its estimate of them.
   ${indented(comment(law.filter.about))} */
void ${label}_estimate(const ${label}_numbers *numbers, const ${label}_options *options,
        ${label}_filter *filter, const ${label}_measured *measured, ${label}_input *input);

/* All that happens every period: what is measured is estimated, and the law answers. The time and
   what is desired are in the input. The first call starts the filter at what is measured, and the
   memory of the law. */
void ${label}_update(const ${label}_numbers *numbers, const ${label}_options *options,
        ${label}_filter *filter, ${label}_memory *memory, const ${label}_measured *measured,
        ${label}_input *input, ${real} torque[${m}]);
