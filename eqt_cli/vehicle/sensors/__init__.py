"""Measurement errors: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.vehicle.sensors.base import Sensor as Sensor

sensors = Registry("sensor", __name__, Sensor)
