"""What a loop is to do: what counts, what is left free, what is claimed; against closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_experiment import configuration, study_of

from eqt_cli.components.laws import controllers
from eqt_cli.components.tasks import TRACK, Point, task_of
from eqt_cli.extend import Gains, Problems, group_named

EqT, Lee2010, Sliding = map(controllers.get, ("eqt", "lee2010", "sliding"))
SO3, SE3 = group_named("SO3"), group_named("SE3")
A, B = [0.0, 0.6, 0.8], [1.0, 0.0, 0.0]
POINT = Point("point", A, B)
AROUND = np.eye(3) - np.outer(A, A)  # no damping along the axis; its condition number is 1e16
REST, MOVING = SimpleNamespace(velocity=np.zeros(3)), SimpleNamespace(velocity=np.ones(3))


def gains(K_d):
    return Gains(0.1 * np.outer(A, A), K_d)


def test_a_task_without_options_is_its_name():
    assert task_of("track") == TRACK and task_of(POINT) is POINT
    assert TRACK.is_whole and TRACK.words(gains(AROUND)) == "" and TRACK.free(gains(AROUND)) == ()
    assert TRACK.axes(EqT()) == () and TRACK.barrier(EqT(), gains(AROUND), REST) == 0


def test_the_axis_stands_in_the_frames_of_the_gains():
    assert POINT.axes(Lee2010()) == (tuple(A), tuple(A))
    assert POINT.axes(EqT()) == (tuple(B), tuple(B))  # K and K_d in space
    along = Point("point", A, along="reference")
    assert along.axes(SimpleNamespace(weight="body", damping="spatial")) == (tuple(A), tuple(A))


def test_a_spin_that_nothing_damps_is_left():
    assert POINT.words(gains(np.eye(3))) == "the turn about the axis (0, 0.6, 0.8)"
    assert POINT.words(gains(AROUND)) == "the turn and the spin about the axis (0, 0.6, 0.8)"
    np.testing.assert_array_equal(POINT.free(gains(AROUND)), [A, A])


def test_the_least_energy_with_the_axis_opposite_is_claimed_for_its_l_alone():
    """Υ = k(1 − cos θ) is 2k there; a moving reference and a spin without damping take it away."""
    for law, K_d, reference, least in (
        (Lee2010(), np.eye(3), MOVING, 0.2),
        (EqT(), AROUND, REST, 0.2),
        (Lee2010(), AROUND, MOVING, 0.0),
        (Sliding(), np.eye(3), REST, 0.0),
    ):
        assert POINT.barrier(law, gains(K_d), reference) == pytest.approx(least, rel=1e-12)


def test_thresholds_are_of_what_counts():
    """A distance d = 2√2 sin(θ/2) is the angle θ of the axis; the rest of a pose does not count."""
    problems, angle = Problems(), 0.3
    distance = 2 * np.sqrt(2) * np.sin(angle / 2)
    parts = POINT.threshold(distance, SE3, problems)
    assert parts == {"rotation": pytest.approx(angle, rel=1e-12)}
    assert TRACK.threshold(distance, SE3, problems) == distance
    assert POINT.bound(parts, SE3) == pytest.approx(np.degrees(angle), rel=1e-12)
    both = {"rotation": angle, "translation": 0.2}
    assert TRACK.bound(both, SE3) == pytest.approx(np.hypot(distance, 0.2), rel=1e-12)
    assert TRACK.bound(0.05, SE3) == 0.05 and not problems
    POINT.threshold({"rotation": 4.0, "shape": 1.0}, SO3, problems)
    assert [problem.path for problem in problems] == ["rotation", "shape"]


@pytest.mark.needs("proofs")
def test_small_errors_across_the_axis_oscillate_with_k_over_j(tmp_path):
    """ω = √(k/J), ζ = k_d/(2√(kJ)) about x and y; the turn about z has no stiffness."""
    from eqt_cli.extensions.proofs.meaning import by_axis

    keys = {"task": "{kind: point, axis: [0, 0, 1], at: [0, 1, 0]}", "reference": None}
    keys |= {"inertia": "[0.05, 0.04, 0.03]", "gains": "{kp: 0.1, kd: 0.08}"}
    loops = study_of(tmp_path, configuration(**keys, controllers="[eqt, lee2010]")).base.loops
    for loop in loops.values():
        errors = by_axis(loop)[0]
        assert [*errors] == ["ωx", "ωy"]
        for J, found in zip((0.05, 0.04), errors.values(), strict=True):
            expected = np.sqrt(0.1 / J), 0.04 / np.sqrt(0.1 * J)
            np.testing.assert_allclose(found, expected, rtol=1e-12)
