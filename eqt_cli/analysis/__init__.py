"""Analyses of experiments and results: certificates, margins, comparisons, recordings."""
