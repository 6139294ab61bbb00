"""From the text of a configuration to an experiment, and to a study of many points."""
