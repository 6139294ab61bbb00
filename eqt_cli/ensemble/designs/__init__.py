"""Designs of sweeps: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.ensemble.designs.base import Design

designs = Registry("design", __name__, Design)

__all__ = ["Design", "designs"]
