"""A recording beside a run of a result: in time with it, and how much of it the run explains."""
