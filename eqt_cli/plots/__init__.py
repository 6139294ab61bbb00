"""Figures and animations of results; this package is the only importer of Matplotlib."""

from eqt_cli.core.surroundings import at_import

with at_import():
    import matplotlib  # noqa: F401  # reads `matplotlibrc` of the current folder
