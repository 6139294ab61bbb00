"""Wheels along axes that each run draws."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.components.vehicle_parts import Normal
from eqt_cli.extend import group_named
from eqt_cli.extensions.spacecraft.gyros import Gyros
from eqt_cli.results.result import open_result

AXES = [
    [1, {"normal": [0, 0.05]}, {"normal": [0, 0.05]}],
    [{"normal": [0, 0.05]}, 1, 0],
    [0, {"uniform": [-0.1, 0.1]}, 1],
]
J = np.diag([2.0, 1.5, 1.2])
SO3 = group_named("SO3")


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


@pytest.mark.parametrize("told", [False, True])
def test_gyros_are_steered_for_the_mean_pyramid(told):
    """The torque is −(A δ̇ + g k (δ̇_c − δ̇)) of the drawn axes, δ̇_c by A of the nominal ones."""
    h, inertia, k, tilt = 2.0, 0.1, 0.7, 0.95
    part = Gyros(h, inertia, k, [Normal([tilt, 0.05])] * 3 + [tilt], told=told)
    assert part.varies
    G, draws, random = SO3, np.random.default_rng(3), np.random.default_rng(4)
    tilts = [*(draws.normal(tilt, 0.05) for _ in range(3)), tilt]
    angle, p, command = random.normal(size=(3, 4))  # of body and gimbals

    def by_hand(tilts):
        """Columns g and h t(δ) of each gyro."""
        g, A = np.zeros((2, 3, 4))
        for i, b in enumerate(tilts):
            at = np.pi / 4 + i * np.pi / 2
            g[:, i] = np.sin(b) * np.cos(at), np.sin(b) * np.sin(at), np.cos(b)
            s = np.array([-np.sin(at), np.cos(at), 0])
            spin = Rotation.from_rotvec(angle[i] * g[:, i]).apply(s)
            A[:, i] = h * np.cross(g[:, i], spin)
        return g, A

    (g, A), (_, nominal) = by_hand(tilts), by_hand(tilts if told else [tilt] * 4)
    gram = nominal @ nominal.T + 0.01 * h**2 * np.eye(3)
    asked = -nominal.T @ np.linalg.solve(gram, command[:3])
    expected = -(A @ (p / inertia) + g @ (k * (asked - p / inertia)))
    run = part.of_run(G, np.random.default_rng(3))
    found = run.output(G, command[:3], np.concatenate([angle, p]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.ci("runs until they rest")
def test_a_turned_star_tracker_leaves_its_own_angle(tmp_path):
    """Q_m = Q exp(n) with the drawn n comes to Q_d, and so Q to Q_d exp(−n)."""
    value = [{"normal": [0, 0.02]}, {"normal": [0, 0.01]}, {"uniform": [-0.03, 0.03]}]
    changes = {"inertia": [2, 1.5, 1.2], "controllers": ["gt"], "gains": {"kp": 2, "kd": 4}}
    changes |= {"reference": {"kind": "constant"}, "control": {"period": 0.05}}
    changes |= {"sensors": {"pose": [{"kind": "bias", "value": value}]}}
    changes |= {"time": {"duration": 60, "samples": 3}, "ensemble": {"runs": 5}}
    changes |= {"initial": {"pose": {"kind": "exp_normal", "std": 0.3}}}
    api.run(mapping(**changes), out=tmp_path / "r")
    with open_result(tmp_path / "r") as result:
        keys = [f"drawn.sensors.pose.0.value.{k}" for k in range(3)]
        n = np.column_stack([result[key] for key in keys])
        expected = Rotation.from_rotvec(-n).as_matrix()
        assert np.abs(n).max() > 0.01
        np.testing.assert_allclose(result["pose"][0, :, -1], expected, rtol=0, atol=1e-9)
