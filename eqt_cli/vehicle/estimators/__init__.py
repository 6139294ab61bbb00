"""Estimates of pose and velocity for a law: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.vehicle.estimators.base import Estimator as Estimator

estimators = Registry("estimator", __name__, Estimator)
