"""What is between a law and the motion: actuators, forces and the plant."""

from eqt_cli.vehicle.vehicle import Vehicle as Vehicle
