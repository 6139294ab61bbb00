"""What follows from experiments and results: comparisons, certificates, margins, searches."""
