"""The exported allocation against the actuator, and against its own bound."""

import ctypes
import re
import subprocess

import numpy as np
import pytest
from exported_laws import FLAGS, compilers

import eqt_cli
from eqt_cli.engines.native import compiler
from eqt_cli.groups import group_named
from eqt_cli.vehicle.actuators.thrusters import Thrusters
from eqt_cli.vehicle.actuators.wheels import Wheels

CONFIG = {
    "group": "SO3",
    "inertia": [0.04, 0.04, 0.01],
    "gains": {"kp": 0.001, "kd": 0.01},
    "reference": {"kind": "torque", "torque": [0, 0, 0]},
    "controllers": ["lee2010"],
    "initial": {"pose": {"kind": "exp_normal", "std": 0.1}},
    "time": {"duration": 1},
    "ensemble": {"runs": 2},
}
MATRIX = [[1.0, -1.0, 0.5, 0.0], [0.0, 0.3, 1.0, -1.0], [0.2, 0.0, 0.4, 1.0]]


@pytest.mark.parametrize(
    ("section", "part"),
    [
        ({"kind": "wheels", "pyramid": 0.9, "limit": 0.02}, Wheels(pyramid=0.9, limit=0.02)),
        (
            {"kind": "thrusters", "matrix": MATRIX, "low": -0.02, "high": 0.03},
            Thrusters(matrix=MATRIX, low=-0.02, high=0.03),
        ),
    ],
)
def test_an_exported_allocation_is_that_of_the_actuator(tmp_path, section, part):
    """Within the bound of the header, for torques within and beyond the limits."""
    if compiler.missing():
        pytest.skip("no C compiler")
    eqt_cli.export({**CONFIG, "actuators": [section]}, tmp_path / "law")
    made, source = tmp_path / "law.so", tmp_path / "law" / "lee2010.c"
    flags = [*FLAGS, "-fPIC", "-shared", str(source), "-o", str(made)]
    subprocess.run([*compilers()[0], *flags], check=True)
    allocate = ctypes.CDLL(str(made)).lee2010_allocate
    header = (tmp_path / "law" / "lee2010.h").read_text(encoding="utf-8")
    bound = float(re.search(r"rounding moves them by at\s+most (\S+);", header).group(1))
    assert 1e-17 < bound < 1e-14
    G = group_named("SO3")
    part = part.of_run(G, None)
    for torque in 0.02 * np.random.default_rng(1).standard_normal((40, 3)):
        found = (ctypes.c_double * 4)()
        allocate((ctypes.c_double * 3)(*torque), found)
        x = np.zeros(part.states(G))
        expected = (part.thrust if section["kind"] == "thrusters" else part_torques(part))(
            G, torque, x
        )
        # Both sums round.
        assert np.abs(np.array(found) - expected).max() <= 2 * bound * np.abs(torque).max()


def part_torques(part):
    """The torques of wheels, called as the thrusts of thrusters."""
    return lambda G, torque, x: part.torques(torque, x)
