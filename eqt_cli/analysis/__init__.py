"""Numbers drawn from trajectories: metrics per run, and tables over runs."""
