"""Compares controllers run by run: intervals, effect sizes, claims of papers."""

from eqt_cli.analysis.comparison.compare import Comparison, compare
from eqt_cli.results.time_windows import Window

__all__ = ["Comparison", "Window", "compare"]
