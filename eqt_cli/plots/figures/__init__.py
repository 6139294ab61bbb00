"""Figures of results: one file per figure, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.plots.base import Figure

figures = Registry("figure", __name__, Figure, "eqt.plots")

__all__ = ["figures"]
