"""Figures of results: one file per figure, found by scanning this folder."""

from eqt_cli.plots.base import figures

__all__ = ["figures"]
