"""Figures of results: one file per figure, found by scanning this folder.

This package is the only importer of matplotlib.
"""

from eqt_cli.core.registry import Registry
from eqt_cli.plots.base import Figure, OfCertificates

figures = Registry("figure", __name__, Figure)

__all__ = ["Figure", "OfCertificates", "figures"]
