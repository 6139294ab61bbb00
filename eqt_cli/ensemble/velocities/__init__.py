"""Distributions of the initial velocity: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.ensemble.velocities.base import VelocityDistribution as VelocityDistribution

velocity_distributions = Registry("velocity distribution", __name__, VelocityDistribution)
