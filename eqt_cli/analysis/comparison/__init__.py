"""Compares controllers run by run: intervals, effect sizes, claims of papers."""
