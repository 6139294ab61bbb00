"""The parts between a law and the motion: actuators, sensors, estimators, forces, plant."""

from eqt_cli.vehicle.vehicle import Vehicle as Vehicle
