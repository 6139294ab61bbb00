"""Results as pictures, still and moving; this package is the only importer of matplotlib."""

from eqt_cli.core.surroundings import at_import

with at_import():
    import matplotlib  # noqa: F401  # reads `matplotlibrc` of the current folder
