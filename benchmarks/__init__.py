"""Measures eqt against other ways to integrate the same runs: `make bench`."""
