"""Builds experiments, and studies of many experiments, from the sections of a configuration."""
