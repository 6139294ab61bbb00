"""The version of eqt."""

__version__ = "0.1.0"
