"""Gains found by search: evolution over sweeps, feasibility first, judged on held-out runs."""
