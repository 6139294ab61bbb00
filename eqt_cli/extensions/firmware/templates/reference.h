{% set names = law.reference.motion.outputs | map(attribute="name") | list %}

/* Sets ${(["t"] + names[:-1]) | join(", ")} and ${names[-1]} of what the law is told. */
void ${label}_reference(${real} t, ${label}_input *input);
