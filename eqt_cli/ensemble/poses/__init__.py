"""Distributions of the initial pose: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.ensemble.poses.base import PoseDistribution

pose_distributions = Registry("pose distribution", __name__, PoseDistribution)

__all__ = ["PoseDistribution", "pose_distributions"]
