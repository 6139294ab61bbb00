"""Draws the initial states of runs from seeds, and lists the points of sweeps."""
