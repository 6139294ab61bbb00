"""The quality of an estimate, from errors and covariances that are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from eqt_cli.extend import group_named
from eqt_cli.loop import signals


def given(group, **states):
    """What the functions read of a tracking state."""
    G = group_named(group)
    own = {f"estimator_{name}": np.asarray(values, float) for name, values in states.items()}
    return SimpleNamespace(G=G, P=np.zeros(G.dimension), vehicle=own)


def upper(matrix):
    return matrix[np.triu_indices(len(matrix))]


def random_covariance(known=()):
    """Of six coordinates, of which some are known for sure."""
    A = np.random.default_rng(3).standard_normal((6, 6))
    A[list(known)] = 0.0
    return 0.1 * A @ A.T


@pytest.mark.parametrize("known", [(), (4, 5), (0,), (0, 3, 5)])
def test_an_error_is_normalised_by_the_covariance_of_what_is_not_known(known):
    covariance = random_covariance(known)
    error = np.array([0.3, -0.2, 0.5, 0.1, -0.4, 0.2])
    s = given("SE2", covariance=upper(covariance), error=error)
    kept = [k for k in range(6) if k not in known]
    expected = error[kept] @ np.linalg.inv(covariance[np.ix_(kept, kept)]) @ error[kept]
    square, freedom = signals.consistency(s)
    assert (square, freedom) == (pytest.approx(expected, rel=1e-9), len(kept))
    assert signals.deviations(s) == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-12)


@pytest.mark.parametrize(
    ("sums", "expected"),
    [
        ([0.0, 0.0, 0.0], (0.0, np.nan, np.nan)),
        ([1.0, 0.4, 0.0], (1.0, 0.4, 0.0)),
        ([8.0, 0.4, -0.3], (8.0, 0.05, -0.75)),
        ([5.0, 0.0, 0.0], (5.0, 0.0, np.nan)),
    ],
)
def test_innovations_have_a_mean_as_soon_as_there_is_one(sums, expected):
    found = signals.of_innovations(given("SE2", innovations=sums))
    assert found == pytest.approx(expected, rel=1e-12, nan_ok=True)


def test_norms_of_an_error_by_parts():
    error = np.array([0.3, 2.0, -1.0, 0.6, 3.0, -4.0])
    s = given("SE2", error=error)
    rotation, translation = s.G.parts
    assert signals.of_pose(s).tolist() == error[:3].tolist()
    assert signals.of_bias(s).tolist() == error[3:].tolist()
    bias, pose = (signals.FORMULAS[name] for name in ("bias_error", "estimate_error"))
    b, difference = signals.of_bias(s), signals.estimate_error(SimpleNamespace(s=s))
    assert bias.value(b) == pytest.approx(np.sqrt(0.6**2 + 25))
    assert bias.value(b, rotation) == pytest.approx(0.6)
    assert bias.value(b, translation) == pytest.approx(5.0)
    # ‖I − R‖ is 2√2 sin(θ/2), and the translation of exp is a chord of the length 2 sin(θ/2)/θ.
    turn, chord = np.sqrt(8) * np.sin(0.15), np.sqrt(5) * 2 * np.sin(0.15) / 0.3
    assert pose.value(difference, rotation) == pytest.approx(turn)
    assert pose.value(difference, translation) == pytest.approx(chord)
    assert pose.value(difference) == pytest.approx(np.hypot(turn, chord))
