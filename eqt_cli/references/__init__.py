"""Desired trajectories: one file per kind of reference, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.references.base import Reference as Reference

references = Registry("reference", __name__, Reference)
