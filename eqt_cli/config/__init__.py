"""Reads a configuration as text, remembers the place of every value, and declares its keys."""
