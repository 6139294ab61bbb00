"""The parts of an experiment: groups, references, laws, vehicles, and the mechanics they share."""
