"""Wheels along axes that each run draws."""

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.results.result import open_result

AXES = [
    [1, {"normal": [0, 0.05]}, {"normal": [0, 0.05]}],
    [{"normal": [0, 0.05]}, 1, 0],
    [0, {"uniform": [-0.1, 0.1]}, 1],
]
J = np.diag([2.0, 1.5, 1.2])


@pytest.mark.ci("runs of misaligned wheels")
@pytest.mark.parametrize("told", [False, True])
def test_the_momentum_of_body_and_wheels_stays(tmp_path, told):
    """R (J ω + A h) stays with the drawn axes A, and not with the nominal ones.

    The torque is A τ of the command τ, since the allocation knows the nominal axes, I.
    """
    wheels = {"kind": "wheels", "axes": AXES, "told": told}
    changes = {"inertia": [2, 1.5, 1.2], "controllers": ["gt"], "actuators": [wheels]}
    changes |= {"solver": {"rtol": 1e-12, "atol": 1e-14, "cross_check": 0}}
    api.run(mapping(**changes), out=tmp_path / "r")
    with open_result(tmp_path / "r") as result:
        for run in range(result.runs):
            A = np.array([[0.0 if isinstance(x, dict) else x for x in axis] for axis in AXES])
            for name in result.names:
                if name.startswith("drawn.actuators.0.axes"):
                    i, j = map(int, name.split(".")[-2:])
                    A[i, j] = result[name][run]
            A = A.T / np.linalg.norm(A, axis=1)
            R, V, h = (result[name][0, run] for name in ("pose", "velocity", "wheel_momentum"))
            of_drawn, of_nominal = (
                np.einsum("tij,tj->ti", R, V @ J + h @ B.T) for B in (A, np.eye(3))
            )
            np.testing.assert_allclose(of_drawn, of_drawn[:1].repeat(len(R), 0), rtol=0, atol=1e-10)
            assert np.abs(of_nominal - of_nominal[0]).max() > 1e-4
            command, torque = result["command"][0, run], result["torque"][0, run]
            expected = command if told else command @ A.T
            np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-13)
