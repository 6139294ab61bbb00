"""Actuators, from command to torque: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.vehicle.actuators.base import Actuator as Actuator

actuators = Registry("actuator", __name__, Actuator)
