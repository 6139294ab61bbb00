"""Poles, stiffness and damping of laws at the poses where they fly, against closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

import eqt_cli
from eqt_cli.config.remarks import gains_flown
from eqt_cli.extend import Lee2010, stack
from eqt_cli.loop.small_errors import SAME, at_rest

W, J = 0.1, np.array([6.0, 7.03, 3.0])
"""Of the case of a satellite: both poles of each axis at −W, where Q_d = I."""

SATELLITE = {
    "group": "SO3",
    "inertia": J.tolist(),
    "gains": {"kp": [W**2 * (J.sum() / 2 - j) for j in J], "kd": [2 * W * j for j in J]},
    "reference": {"kind": "slew", "to": {"rotvec": ["60 deg", 0, 0]}, "start": 5, "duration": 50},
    "controllers": ["eqt", "gt", "lee2010", "quaternion"],
    "time": {"duration": 60.0, "samples": 61},
}


def turned_about_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def of_body(stiffness, damping):
    """The poles of Jε̈ + Dε̇ + Hε = 0, as eigenvalues of the pencil of second order."""
    states = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [-np.diag(1 / J) @ stiffness, -np.diag(1 / J) @ damping]]
    )
    return np.linalg.eigvals(states)


@pytest.mark.parametrize("degrees", [0, 60, 90])
@pytest.mark.parametrize("law", SATELLITE["controllers"])
def test_gains_in_space_meet_turned_axes(law, degrees):
    """H = Rᵀ J ω² R for K in space, and D likewise for K_d; the body has its own gains."""
    loop = eqt_cli.load_experiment(SATELLITE).base.loops[law]
    R = turned_about_x(np.radians(degrees))
    H, D = W**2 * np.diag(J), 2 * W * np.diag(J)
    if law in ("eqt", "gt"):
        H = R.T @ H @ R
    if law == "eqt":
        D = R.T @ D @ R
    small = at_rest(loop, np.zeros(1), R[None])
    np.testing.assert_allclose(J[:, None] * small.stiffness[0], H, atol=1e-9)
    np.testing.assert_allclose(J[:, None] * small.damping[0], D, atol=1e-9)
    slowest = max(of_body(H, D).real)
    # A double pole moves by the root of a rounding.
    assert small.poles[0, 0].real == pytest.approx(slowest, abs=1e-5)
    given = {("eqt", 60): -0.0476, ("gt", 60): -0.0276, ("eqt", 90): -0.0427, ("gt", 90): -0.0243}
    assert small.poles[0, 0].real == pytest.approx(given.get((law, degrees), -W), abs=5e-5)


SPRING = np.array([0.4, 0.3, 0.2])


class Spring(Lee2010):
    """Lee's law with stiffnesses of its own, N m/rad."""

    def torque(self, s):
        R = s.relative.Q
        e = 0.5 * stack([R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))])
        return super().torque(s) + s.relative.gradient - SPRING * e


@pytest.mark.needs("proofs")
def test_bandwidths_are_those_of_the_torque_and_not_of_gains_that_a_law_does_not_read():
    """ω² = k/J and 2ζω = d/J."""
    from eqt_cli.extensions.proofs.meaning import by_axis

    loop = eqt_cli.load_experiment(SATELLITE).base.loops["lee2010"]
    assert by_axis(loop)[1] == ["K", "K_d"]
    own, acting = by_axis(replace(loop, controller=Spring()))
    w = np.sqrt(SPRING / J)
    np.testing.assert_allclose([*own.values()], np.transpose([w, W / w]), rtol=1e-9)
    assert acting == ["K_d"]


def test_what_is_said_of_poles_on_the_way():
    small = gains_flown(eqt_cli.load_experiment(SATELLITE).base)
    assert small["lee2010"].poles == small["quaternion"].poles == "−0.1 rad/s at all times"
    assert small["eqt"].poles == (
        "−0.1 rad/s at the start, −0.0476 ± 0.0499i at the end, −0.0476 ± 0.0499i at worst (57 s)"
    )
    assert small["gt"].departs == (
        "slowest pole −0.0276 rad/s at 57 s, −0.1 at Q_d = I: K in space, not in the body"
    )
    assert (small["eqt"].in_space, small["gt"].in_space) == (["K", "K_d"], ["K"])
    assert small["gt"].differs_from(small["lee2010"]) == "not the stiffness"
    assert small["eqt"].differs_from(small["gt"]) == "not the damping"
    assert small["lee2010"].differs_from(small["quaternion"]) == ""


def test_equal_gains_about_all_axes_keep_their_poles():
    same = {**SATELLITE, "gains": {"kp": 0.02, "kd": 1.0}}
    small = gains_flown(eqt_cli.load_experiment(same).base)
    assert all(not each.departs and "at all times" in each.poles for each in small.values())
    assert not any(one.differs_from(two) for one, two in pairwise(small.values()))


def test_forces_in_space_turn_a_body_that_is_far_from_the_origin():
    """On SE(2) at (5, 0): Ad has the lever 5, so a spring k in y adds 25 k to the turn."""
    config = {
        "group": "SE2",
        "inertia": [2.0, 3.0, 3.0],
        "gains": {"kp": 0.7, "kd": 0.4},
        "reference": {"kind": "constant", "pose": {"position": [5, 0]}},
        "controllers": ["eqt", "lee2010"],
        "time": {"duration": 1.0},
    }
    experiment = eqt_cli.load_experiment(config).base
    small = {
        k: at_rest(x, np.zeros(1), experiment.desired.pose[None])
        for k, x in experiment.loops.items()
    }
    M = np.array([2.0, 3.0, 3.0])[:, None]
    one, two = (M * small[law].damping[0] for law in ("lee2010", "eqt"))
    lever = np.array([[1.0, 0, 0], [0, 1, 0], [-5, 0, 1]])  # v at the origin of space: v + ω × (−p)
    np.testing.assert_allclose(one, 0.4 * np.eye(3), atol=1e-9)
    np.testing.assert_allclose(two, 0.4 * lever.T @ lever, atol=SAME)
    assert "K and K_d in space" in gains_flown(experiment)["eqt"].departs


@pytest.mark.parametrize("damage", [{"stiffness": [[[1.0, 2.0], [3.0]]]}, {"damping": []}])
def test_what_a_result_says_of_poles_is_checked(damage):
    """It comes from a file: its words are printed, and its matrices are compared."""
    said = gains_flown(eqt_cli.load_experiment(SATELLITE).base)["eqt"]
    again = type(said)(**said.model_dump())
    assert again == said
    hostile = type(said)(**{**said.model_dump(), "departs": "a\x1b[2J"})
    assert "\x1b" not in hostile.departs
    with pytest.raises(ValidationError):
        type(said)(**{**said.model_dump(), **damage})
