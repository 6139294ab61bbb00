"""What follows from experiments and results: comparisons and searches."""
