from eqt_cli.extensions.thrusters.thrusters import Thrusters as Thrusters
