"""Distributions of the initial pose: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.ensemble.poses.base import PoseDistribution as PoseDistribution

pose_distributions = Registry("pose distribution", __name__, PoseDistribution)
