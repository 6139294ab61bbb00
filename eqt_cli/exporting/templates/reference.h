
/* Sets $told of what the law is told. */
void ${label}_reference($real t, ${label}_input *input);
