"""Results as pictures; nothing else imports Matplotlib."""

from eqt_cli.base.process import at_import

with at_import():
    import matplotlib  # noqa: F401  # reads `matplotlibrc` of the current folder
