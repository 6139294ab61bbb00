"""Errors of position, attitude and heading, by both engines."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eqt_cli.components.matrix_groups import heading_of
from eqt_cli.extend import group_named
from eqt_cli.results.result import open_result

RUN = (
    "inertia: 2\ngains: {kp: 2, kd: 1.5}\ncontrollers: [eqt]\n"
    "initial: {pose: haar, velocity: normal}\nensemble: {runs: 2, seed: 1}\n"
    "time: {duration: 1, samples: 11}\n"
)


def opened(invoke, folder, *options, **keys):
    (folder / "c.yaml").write_text(RUN + "".join(f"{k}: {v}\n" for k, v in keys.items()))
    invoke("run", folder / "c.yaml", *options, "--out", folder / "out")
    return open_result(folder / "out")


@pytest.mark.parametrize(
    "engine", ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles a law"))]
)
def test_distance_of_positions_and_turn_about_the_vertical(invoke, tmp_path, engine):
    reference = '{torque: ["cos(t)", "0", "0", "0", "sin(t)", "0"]}'
    with opened(
        invoke, tmp_path, "--set", f"solver.engine={engine}", group="SE3", reference=reference
    ) as result:
        p, p_d = result["pose"][..., :3, 3], result["desired_pose"][..., :3, 3]
        R, R_d = result["pose"][..., :3, :3], result["desired_pose"][..., :3, :3]
        distance = np.linalg.norm(p - p_d, axis=-1)
        # 1e-7: the reference of a run and desired_pose are two solves, at rtol 1e-9.
        assert np.allclose(result["position_error"], distance, rtol=0, atol=1e-7)
        of = Rotation.from_matrix((R @ R_d.swapaxes(-1, -2)).reshape(-1, 3, 3))
        quaternion = np.abs(of.as_quat().reshape(*R.shape[:-2], 4))
        turn = np.degrees(2 * np.arctan2(quaternion[..., 2], quaternion[..., 3]))
        assert np.allclose(result["heading_error"], turn, rtol=0, atol=1e-5)
        angle = np.degrees(of.magnitude()).reshape(R.shape[:-2])
        assert np.allclose(result["attitude_angle"], angle, rtol=0, atol=1e-5)
        mean = np.trapezoid(result["attitude_angle"], result.times)
        assert np.allclose(result["mean_attitude_error"], mean, rtol=1e-12)
        squares = np.trapezoid(distance**2, result.times)
        assert np.allclose(result["position_rms"], np.sqrt(squares), rtol=0, atol=1e-7)
        assert result.units("position_rms") == "m" and result.units("heading_rms") == "deg"


def test_a_heading_is_kept_under_a_tilt_and_0_upside_down():
    G = group_named("SO3")
    turned = G.exp(np.array([0.0, 0.0, -2.5])) @ G.exp(np.array([1.2, -0.9, 0.0]))
    assert heading_of(G, turned) == pytest.approx(-2.5, abs=1e-14)
    assert heading_of(G, np.diag([1.0, -1.0, -1.0])) == 0.0


@pytest.mark.parametrize(
    ("group", "found"),
    [
        pytest.param("SO3", 0, marks=pytest.mark.ci("as SE23, which has positions")),
        ("SE23", 0),
        pytest.param("SE2", 5, marks=pytest.mark.ci("has them, as SE3")),
    ],
)
def test_groups_with_other_parts_have_no_such_error(invoke, tmp_path, group, found):
    with opened(
        invoke, tmp_path, "--set", "time.duration=0.1", group=group, reference="{kind: constant}"
    ) as result:
        names = [name for name in result.names if "position_" in name or "heading" in name]
        assert len(names) == found
        assert "attitude_angle" in result.names
