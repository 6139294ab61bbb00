"""Compares recordings with runs of a result: aligns their clocks, and measures the errors."""
