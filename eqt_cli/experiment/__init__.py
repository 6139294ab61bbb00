"""Experiments: configs read from YAML, checked and run."""
