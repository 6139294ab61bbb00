"""Searches for gains and for the worst run: differential evolution over sweeps."""
