"""From the sections of a configuration to an experiment, and to a study of many of them."""
