"""Settling by a threshold for each part of the group, which no choice of the origin changes."""

import numpy as np
import pytest

from eqt_cli.base.errors import ConfigError
from eqt_cli.components.tasks import TRACK
from eqt_cli.extend import SampledRuns, group_named
from eqt_cli.results.metrics import ESTIMATE_SETTLING, QUANTITIES, SETTLING
from eqt_cli.results.result import open_result
from eqt_cli.results.summary import headlines
from eqt_cli.runs.folder import by_thresholds_of_parts

THRESHOLDS = {"rotation": np.radians(30), "translation": 0.4}
FAR = 20.0


def test_the_largest_error_of_a_part_counts_in_units_of_its_threshold():
    """By 30° and 0.3 m away, from thresholds of 60° and 0.2 m, and of 10° and 3 m."""
    G = group_named("SE3")
    Qd = G.exp(np.array([0.3, 0.2, -0.5, 4.0, 5.0, 6.0]))
    Q = Qd.copy()
    Q[:3, :3] = Qd[:3, :3] @ G.exp(np.array([0, 0, np.radians(30), 0, 0, 0]))[:3, :3]
    Q[:3, 3] += [0.0, 0.3, 0.0]
    wide = {"rotation": np.radians(60), "translation": 0.2}
    narrow = {"rotation": np.radians(10), "translation": 3.0}
    assert TRACK.settling_error(G, Q, Qd, wide) == pytest.approx(0.3 / 0.2, rel=1e-12)
    # 2√2 sin(θ/2) of both angles.
    expected = np.sin(np.radians(15)) / np.sin(np.radians(5))
    assert TRACK.settling_error(G, Q, Qd, narrow) == pytest.approx(expected, rel=1e-12)
    assert TRACK.settling_error(G, Q, Qd, {"translation": 0.3}) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "signal", "words"),
    [
        ("settling_time", SETTLING, "last time the largest error of a part leaves"),
        (
            "estimate_settling_time",
            ESTIMATE_SETTLING,
            "last time the largest error of a part of the estimate leaves",
        ),
    ],
)
def test_a_run_has_settled_where_no_part_is_above_its_threshold(name, signal, words):
    row = by_thresholds_of_parts(QUANTITIES[name], THRESHOLDS)
    assert (row.signals, row.settings) == ((signal,), {})
    assert row.long_name == f"{words} its settling threshold"
    assert row.attributes["threshold_translation"] == 0.4
    error = np.array([[2.0, 0.5, 1.0, 0.9], [2.0, 0.5, 1.0, 1.1]])
    found = row.measure(SampledRuns(np.arange(4.0)), {signal: error}, row.window)
    assert found == pytest.approx([2 / 3, np.nan], nan_ok=True)


@pytest.fixture
def result(invoke, folder):
    """A law that does not see the origin, about two of them, by both kinds of thresholds."""
    (folder / "c.yaml").write_text(
        "group: SE3\ninertia: [2, 1, 3, 4, 4, 4]\ngains: {kp: 2, kd: 1.5}\n"
        "controllers: [bullo_murray]\nreference: {kind: constant, pose: {position: [0, 0, 0]}}\n"
        "initial: {pose: {kind: angle, angle: [5 deg, 170 deg], position: {std: 1}}}\n"
        "ensemble: {runs: 12, seed: 1}\ntime: {duration: 2, samples: 21}\n"
        "solver: {rtol: 1.0e-6, cross_check: 0, error_estimate: false}\n"
        "sweep:\n"
        f'- grid: {{"reference.pose.position[0]": [0, {FAR}]}}\n'
        "- grid: {settling_threshold: [0.6, {rotation: 30 deg, translation: 0.4}]}\n"
    )
    invoke("sweep", "c.yaml", "--out", "out")
    with open_result(folder / "out") as opened:
        yield opened


def test_the_share_settled_by_parts_knows_no_origin(result):
    near, near_by_parts, far, far_by_parts = result.metric("settling_time")[:, 0]
    settled = np.isfinite(near_by_parts)
    assert 0 < settled.sum() < 12
    # The same motion, to the solver's tolerance; an origin 20 m away takes a digit.
    np.testing.assert_allclose(far_by_parts, near_by_parts, rtol=0, atol=1e-4)
    # One threshold of ‖I − Q_E‖_F, where a rotation has the lever arm of the origin.
    assert np.isfinite(near).sum() > np.isfinite(far).sum()
    # Counted directly, from what is stored.
    Q, Qd = result["pose"][1, 0, :, -1], result["desired_pose"][1, -1]
    turn = group_named("SE3").log(np.linalg.inv(Qd) @ Q)[:, :3]
    away = np.linalg.norm((Q - Qd)[:, :3, 3], axis=1)
    near_both = (np.linalg.norm(turn, axis=1) <= THRESHOLDS["rotation"]) & (
        away <= THRESHOLDS["translation"]
    )
    np.testing.assert_array_equal(settled, near_both)
    # And as it was: ‖I − Q_E‖_F at the end against one number.
    final = result.metric("final_pose_error")[0, 0]
    np.testing.assert_array_equal(np.isfinite(near), final <= 0.6)


def test_a_distance_is_not_in_degrees(experiment):
    with pytest.raises(ConfigError) as raised:
        experiment(
            group="SE3",
            inertia="1",
            reference="{kind: constant}",
            settling_threshold="{rotation: 1 deg, translation: 5 deg}",
        )
    [problem] = raised.value.problems
    assert str(problem) == (
        "c.yaml:10:39: settling_threshold.translation: expected a number or a length in m, cm, mm "
        "or km, got '5 deg', which is 0.0872665 rad"
    )


def test_an_angular_velocity_counts_in_units_of_its_threshold():
    """‖(0.3, 0.4, 0)‖ over 0.1 beside 0.3 m over 0.2 m; no velocity of the translation counts."""
    G, V = group_named("SE3"), np.array([0.3, 0.4, 0.0, 5.0, 6.0, 7.0])
    Q = G.exp(np.array([0, 0, 0, 0, 0.3, 0]))
    found = TRACK.settling_error(G, Q, G.identity, {"rate": 0.1, "translation": 0.2}, V=V)
    assert found == pytest.approx(5.0, rel=1e-12)
    assert TRACK.settling_error(G, Q, G.identity, {"rate": 0.6}, V=V) == pytest.approx(
        5 / 6, rel=1e-12
    )


def test_a_summary_begins_with_the_time_of_a_rate(invoke, folder):
    """A spin about z that K_d ω damps alone: ω₀ exp(−t k_d/J) is at 0.1 after 2 ln 10 s."""
    (folder / "c.yaml").write_text(
        "task: stabilise\ngroup: SO3\ninertia: [2, 2, 2]\ngains: {kp: 1.0e-9, kd: 1}\n"
        "controllers: [stabilising]\ninitial: {velocity: {kind: fixed, coordinates: [0, 0, 1]}}\n"
        "settling_threshold: {rate: 0.1}\ntime: {duration: 10, samples: 2001}\n"
    )
    invoke("run", "c.yaml", "--out", "out")
    with open_result(folder / "out") as opened:
        assert headlines(opened)[0] == "settling_time"
        assert opened["settling_time"][0, 0] == pytest.approx(2 * np.log(10), rel=1e-5)
