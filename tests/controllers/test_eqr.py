"""EqR against its definition: errors are logarithms of matrices by SciPy, and their derivatives.

An element X of a symmetry is a matrix here, and the tangent map at the reference is a difference.
"""

import numpy as np
import pytest
from scipy.linalg import logm

import eqt_cli
from eqt_cli.controllers.eqr import Eqr
from eqt_cli.core.errors import ConfigError
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.tracking import Gains, Tracking

BODY = {
    "group": "SE3",
    "inertia": [1.0, 2.0, 3.0, 4.0, 4.0, 4.0],
    "reference": {"kind": "constant", "velocity": [0.3, -0.2, 0.5, 1.0, 0.4, -0.7]},
    "controllers": ["lqr", {"kind": "eqr", "symmetry": "direct_product"}],
    "initial": {"pose": {"kind": "angle", "angle": 0.1}},
    "time": {"duration": 2.0},
}
LARGE = np.array([1.2, -0.8, 1.5, 2.0, -3.0, 1.0, 0.4, 1.0, -0.6, 2.0, -1.0, 0.5])


def shift(x):
    """A vector under addition, as a matrix."""
    return np.block([[np.eye(3), x[:, None]], [0, 0, 0, 1]])


def log(X):
    """The logarithm of a matrix; that of a shift is exact, since (X − I)² = 0."""
    N = X - np.eye(len(X))
    return (logm(X).real if (N @ N).any() else N).ravel()


def element(symmetry, Q, V):
    """The factors of X, with v in space and w in the body."""
    R, x, w = Q[:3, :3], Q[:3, 3], V[3:]
    if symmetry == "direct_product":
        return [R, shift(x), shift(R @ w)]
    if symmetry == "pose_velocity":
        return [Q, shift(w)]
    extended = np.eye(5)
    extended[:3] = np.column_stack([R, x, R @ w])
    return [extended]


@pytest.mark.parametrize(
    ("symmetry", "frame"),
    [
        ("direct_product", "body"),
        ("pose_velocity", "body"),
        ("extended_pose", "body"),
        ("extended_pose", "space"),
    ],
)
def test_errors_are_the_logarithm_in_the_coordinates_of_lqr_to_first_order(symmetry, frame):
    G, Vd = group_named("SE3"), np.array(BODY["reference"]["velocity"])
    Qd = G.exp(np.array([0.5, 1.0, -0.7, 3.0, -1.0, 2.0]))

    def at(x):
        """A motion whose errors in the coordinates of lqr are x."""
        Q_L = G.exp(x[:6])
        return Qd @ Q_L, x[6:] + G.Ad(G.inverse(Q_L), Vd)

    def error(x):
        """The logarithm, and e_Ω, which belongs to no symmetry."""
        pairs = zip(element(symmetry, *at(x)), element(symmetry, Qd, Vd), strict=True)
        inverse = np.linalg.inv
        found = [X @ inverse(X_d) if frame == "space" else inverse(X_d) @ X for X, X_d in pairs]
        return np.concatenate([*map(log, found), x[6:9]])

    h = 1e-4  # whose square, 1e-8, is what differences leave of errors of 1
    tangent = np.array([error(h * e) - error(-h * e) for e in np.eye(12)]) / (2 * h)
    expected = np.linalg.lstsq(tangent.T, error(LARGE), rcond=None)[0]
    Q, V = at(LARGE)
    one = Inertia(np.eye(6), np.eye(6))
    s = Tracking(G, one, Gains(np.eye(4), np.eye(6)), 0.0, Q, V, Qd, Vd, np.zeros(6))
    found = np.concatenate(Eqr(symmetry=symmetry).errors(s))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert np.abs(found - LARGE).max() > 0.1


def test_along_a_constant_velocity_the_gains_are_constant_and_those_of_lqr():
    loops = eqt_cli.load_experiment(BODY).experiment(0).loops
    np.testing.assert_array_equal(*(each.controller.regulator.gain for each in loops.values()))


def test_a_group_without_a_position_is_refused():
    body = {**BODY, "group": "SO3", "inertia": 1.0, "reference": {"kind": "constant"}}
    with pytest.raises(ConfigError) as caught:
        eqt_cli.load_experiment({**body, "controllers": ["eqr"]})
    assert str(caught.value) == (
        "config:5:15: controllers[0]: eqr needs a group of one rotation and one translation, "
        "SE2 or SE3, got SO3"
    )
