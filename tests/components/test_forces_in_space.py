"""Forces along the axes of space, at the origin of the body or along a line, in closed form."""

import numpy as np
import pytest
import yaml
from scipy.linalg import solve_continuous_lyapunov
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.config.remarks import remarks
from eqt_cli.extend import ConstantForce, Gust, group_named

TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
PLACE = np.array([2.0, -1.0, 0.5])
TORQUE, FORCE = np.array([0.3, 0.1, -0.2]), np.array([0.0, 0.5, 1.0])


def pose():
    Q = np.eye(4)
    Q[:3, :3], Q[:3, 3] = TURN, PLACE
    return Q


@pytest.mark.parametrize(
    ("at", "torque"), [("centre", TORQUE), ("line", TORQUE - np.cross(PLACE, FORCE))]
)
@pytest.mark.parametrize("more", [0, 2])
def test_a_force_in_space_turns_a_body_only_by_its_lever(at, torque, more):
    """Rᵀ(τ − p × f) and Rᵀf about the origin of the body; the lever is 0 at its centre."""
    G = group_named("SE3*R2" if more else "SE3")
    Q = G.identity.copy()
    Q[:4, :4] = pose()
    force = ConstantForce([*TORQUE, *FORCE, *[7.0] * more], frame="spatial", at=at)
    wrench = force.of_run(G, None).in_body(G, 0.0, Q[None], np.zeros((1, G.dimension)))[0]
    expected = [*TURN.T @ torque, *TURN.T @ FORCE, *[7.0] * more]
    np.testing.assert_allclose(wrench, expected, atol=1e-15)


def test_a_line_in_space_needs_a_frame_in_space():
    with pytest.raises(ValueError, match="add frame: spatial"):
        ConstantForce([1.0], at="line")


def test_a_gust_far_from_the_origin_turns_nothing():
    """The case of a quadrotor 2 m away, which such a gust had spun to 20,000 rad/s."""
    G, still = group_named("SE3"), np.zeros((1, 6))
    gusts = Gust([0, 0, 0, 1, 1, 1], 0.5, frame="spatial").of_run(G, np.random.default_rng(1))
    wrench = gusts.in_body(G, 0.3, pose()[None], still)[0]
    np.testing.assert_allclose(wrench[:3], 0, atol=1e-16)
    assert np.linalg.norm(wrench[3:]) > 0.1


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_a_body_that_turns_falls_in_a_parabola(engine, tmp_path):
    """p̈ = f/m in space, whatever the body does; its spin stays, as all moments are equal."""
    flown = eqt_cli.run(
        {
            "group": "SE3",
            "inertia": [0.2, 0.2, 0.2, 3.0, 3.0, 3.0],
            "gains": {"kp": 1.0, "kd": 1.0},
            "reference": {"kind": "constant", "pose": {"position": PLACE.tolist()}},
            "controllers": [
                {"kind": "family", "label": "weak", "gains": {"kp": 1e-12, "kd": 1e-12}}
            ],
            "plant": {
                "forces": [{"kind": "constant", "force": [0, 0, 0, *FORCE], "frame": "spatial"}]
            },
            "initial": {"velocity": {"kind": "fixed", "coordinates": [1, 2, -1, 0, 0, 0]}},
            "time": {"duration": 2.0, "samples": 5},
            "solver": {"engine": engine, "rtol": 1e-10},
        },
        tmp_path / "fall",
    )
    t, V = flown["time"], flown["velocity"][0, 0]
    p = flown["pose"][0, 0, :, :3, 3]
    expected = PLACE + FORCE / 3.0 * t[:, None] ** 2 / 2
    np.testing.assert_allclose(p, expected, atol=1e-8)
    np.testing.assert_allclose(V[:, :3], np.broadcast_to([1, 2, -1], (5, 3)), atol=1e-8)


def remarked(experiment_of, std, at):
    """Remarks on a gust along y, 2 m along x from the origin: its lever turns about z."""
    place = {"reference": {"kind": "constant", "pose": {"position": [2, 0, 0]}}}
    gust = {"kind": "gust", "std": [0, 0, 0, 0, std, 0], "time_constant": 0.4, "frame": "spatial"}
    config = {
        "group": "SE3",
        "inertia": [0.01, 0.02, 0.025, 1, 1, 1],
        "gains": {"kp": [0.1, 0.1, 0.1, 1.0], "kd": [0.06, 0.06, 0.06, 1, 1, 1]},
        "plant": {"forces": [gust | {"at": at}]},
        "controllers": ["lee2010"],
        "initial": {"pose": {"kind": "exp_normal", "std": 0.1}},
        "time": {"duration": 1.0, "samples": 11},
    }
    experiment = experiment_of(yaml.safe_dump(config | place))
    return [str(each) for each in remarks(experiment) if "lever" in str(each)]


def test_a_gust_along_a_line_is_remarked_where_its_lever_turns_the_body(experiment_of):
    """J z̈ + 0.06 ż + 0.2 z = 2f with f' = −f/0.4 + white noise, by Lyapunov's equation."""
    rates = np.array([[0, 1, 0], [-0.2 / 0.025, -0.06 / 0.025, 2 / 0.025], [0, 0, -1 / 0.4]])
    noise = np.diag([0.0, 0.0, -2 / 0.4])  # of f, whose deviation is 1 N
    angle = np.sqrt(solve_continuous_lyapunov(rates, noise)[0, 0])
    [words] = remarked(experiment_of, 0.1, "line")
    assert f"σ = 0.2 N m, at the gains of Lee 2010 by {0.1 * angle:.2g} rad" in words
    assert 0.1 * angle > 1 / 3 > 0.03 * angle
    assert remarked(experiment_of, 0.03, "line") == remarked(experiment_of, 9.0, "centre") == []
