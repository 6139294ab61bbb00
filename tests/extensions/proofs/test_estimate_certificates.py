"""Rows about a filter: NEES and innovations, of numbers that are drawn as they should be or not."""

from types import SimpleNamespace

import numpy as np
import pytest

from eqt_cli.extensions.proofs.certificates import Verdict
from eqt_cli.extensions.proofs.run_checks import Consistent, WhiteInnovations
from eqt_cli.runs.description import loop_in_words

RUNS, SAMPLES, FREEDOM, COUNT = 20, 11, 6, 60


def runs(**changed):
    """What a consistent filter says of itself, with some signals scaled or replaced."""
    random = np.random.default_rng(1)
    innovations = random.standard_normal((RUNS, COUNT))
    square = (innovations**2).mean(axis=1)
    correlation = (innovations[:, 1:] * innovations[:, :-1]).sum(axis=1) / (COUNT * square)
    signals = {
        "nees": random.chisquare(FREEDOM, (RUNS, 1)) + np.zeros(SAMPLES),  # one number a run
        "nees_dof": np.full((RUNS, SAMPLES), float(FREEDOM)),
        "innovations": np.full((RUNS, SAMPLES), float(COUNT)),
        "innovation_square": square[:, None] + np.zeros(SAMPLES),
        "innovation_correlation": correlation[:, None] + np.zeros(SAMPLES),
    }
    for name, change in changed.items():
        signals[name] = change(signals[name])
    return SimpleNamespace(estimate=signals, remark="", label="eqt")


def test_a_consistent_filter_holds_although_its_errors_last():
    for check in (Consistent(), WhiteInnovations()):
        assert check.applies(runs())
        assert check.check(runs()).verdict is Verdict.HOLDS


@pytest.mark.parametrize(
    ("check", "signal", "change", "words"),
    [
        (Consistent, "nees", lambda x: 2.5 * x, "NEES is 2.44 times its mean"),
        (Consistent, "nees", lambda x: 0.3 * x, "NEES is 0.292 times its mean"),
        (WhiteInnovations, "innovation_square", lambda x: 1.4 * x, "mean square 1.39 of 1200 "
         "innovations"),
        (WhiteInnovations, "innovation_correlation", lambda x: x + 0.2, "correlation 0.166"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_number(check, signal, change, words):
    row = check().check(runs(**{signal: change}))
    assert (row.verdict, row.remark) == (Verdict.FAILS, words)
    assert row.measured > row.bound


def test_without_trajectories_nothing_is_decided():
    for check in (Consistent(), WhiteInnovations()):
        row = check.check(SimpleNamespace(estimate={}, remark="", label="eqt"))
        assert (row.verdict, row.remark) == (Verdict.UNDECIDED, "no trajectories are kept")
        assert not check.applies(SimpleNamespace(estimate=None))


def test_the_signal_path_goes_through_the_filter():
    config = {
        "control": {"period": 0.1},
        "sensors": {"pose": [{"kind": "noise", "std": 1, "period": 1.0}], "velocity": []},
        "estimator": {"kind": "invariant"},
    }
    pose = "pose (noise every 1 s)"
    assert loop_in_words(config) == (
        f"reference → law → hold 0.1 s → plant → {pose} → estimate (invariant) → law",
        f"Loop: sampled every 0.1 s; measured {pose}; estimate: invariant.",
    )
    config["sensors"]["magnetometer"] = [{"kind": "noise", "std": 1}]  # which no filter reads
    assert loop_in_words(config)[0].endswith(
        f" → plant → {pose} → estimate (invariant), magnetometer (noise) → law"
    )
