"""Matrix Lie groups: one file per group, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.groups.base import MatrixLieGroup, Part

groups = Registry("group", __name__, MatrixLieGroup)

__all__ = ["MatrixLieGroup", "Part", "groups"]
