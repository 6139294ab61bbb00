"""Metrics of a user's own: their values, where they appear, and what is wrong with them."""

from contextlib import ExitStack

import numpy as np
import pytest
from said import error_of
from small_experiment import mapping

import eqt_cli
from eqt_cli.base.errors import EqtWarning
from eqt_cli.cli.result_tables import print_outcome
from eqt_cli.results.result import open_result
from eqt_cli.results.summary import own_metrics

HEAD = """\
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import EqT, Metric, dot, less, norm, where


@dataclass(frozen=True)
class Adaptive(EqT):
    name: ClassVar[str] = "adaptive"

    def memory(self, G):
        return {"estimate": 2, "budget": 1}

    def initial_memory(self, s):
        return {"estimate": s.P[..., :2] * 0.0 + 3.0, "budget": s.P[..., :1] * 0.0 + 1.0}

    def memory_rate(self, s):
        return {"estimate": -s.memory["estimate"], "budget": s.memory["budget"]}
"""

METRIC = '''

@dataclass(frozen=True)
class {kind}(Metric):
    """{words}."""

    name: ClassVar[str] = "{name}"
    signals: ClassVar[tuple[str, ...]] = {signals}
    units: ClassVar[str] = "{units}"
    better: ClassVar[str] = "{better}"

    def of(self, over, {arguments}):
        return {formula}
'''


def metric(name, formula, *signals, units="1", better="lower", words="a number"):
    """The text of a metric, whose signals are called a, b, … in its formula."""
    arguments, kind = ", ".join("abc"[: len(signals)]), name.title().replace("_", "")
    return METRIC.format(**locals())


EVERY = HEAD + "".join(
    (
        metric("peak_of_torque", "over.largest(norm(a))", "torque", units="{}"),
        metric("by_hand", "np.abs(a).reshape(len(a), -1).sum(axis=-1)", "torque", better="higher"),
        metric("estimate_area", "over.integral(dot(a, a))", "estimate", units="({})^2 s"),
        metric("final_budget", "over.final(a)", "budget", better="higher"),
        metric("above", "over.mean(where(less(0.0, a), 1.0, 0.0))", "budget"),
        metric("two", "over.largest(a * b)", "pose_error", "torque_norm", units="{} N m"),
    )
)


@pytest.fixture
def read():
    with ExitStack() as opened:
        yield lambda result: opened.enter_context(open_result(result))


@pytest.fixture
def result_of(tmp_path):
    def made(text=EVERY, **changes):
        changes = {"controllers": ["adaptive", "gt"]} | changes
        (tmp_path / "mine.py").write_text(text)
        data = mapping(plugins=[str(tmp_path / "mine.py")], **changes)
        return eqt_cli.run(data, tmp_path / f"out{len(list(tmp_path.iterdir()))}")

    return made


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_values_are_those_of_the_stored_signals(result_of, read, engine):
    result = read(result_of(solver={"engine": engine, "rtol": 1e-9, "cross_check": 0}))
    torque, times = result.read("torque"), np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(
        result.metric("peak_of_torque"), np.linalg.norm(torque, axis=-1).max(axis=-1), rtol=1e-14
    )
    np.testing.assert_allclose(
        result.metric("by_hand"), np.abs(torque).sum(axis=(-1, -2)), rtol=1e-14
    )
    # The estimate is 3 exp(−t) in two entries, and the budget exp(t).
    area = np.trapezoid(2 * 9 * np.exp(-2 * times), times)
    np.testing.assert_allclose(result.metric("estimate_area", 0), [area] * 3, rtol=1e-8)
    np.testing.assert_allclose(result.metric("final_budget", 0), [np.e] * 3, rtol=1e-8)
    for name in ("estimate_area", "above"):  # GT has neither number
        assert np.isnan(result.metric(name, 1)).all()
    assert (result.metric("above", 0) == 1).all()
    both = result.read("pose_error") * result.read("torque_norm")
    np.testing.assert_allclose(result.metric("two"), both.max(axis=-1), rtol=1e-14)


def test_a_reader_without_the_plugin_knows_unit_words_and_direction(
    result_of, read, forget_plugins
):
    result = result_of(controllers=["adaptive", "gt"], ensemble={"runs": 20, "seed": 1})
    forget_plugins()
    found = read(result)
    assert found.units("peak_of_torque") == "N m"
    quantity = found.quantity("by_hand")
    assert (quantity.better, quantity.long_name, quantity.plain) == (
        "higher",
        "a number",
        "by hand",
    )
    for pair in eqt_cli.compare(result).pairs:
        if pair.measured.quantity.is_own and np.isfinite(pair.first_better):
            one, other = (
                found.metric(pair.measured.quantity.name, found.labels.index(label))
                for label in (pair.first, pair.second)
            )
            better = one > other if pair.measured.quantity.better == "higher" else one < other
            tied = np.isclose(one, other, rtol=1e-9)  # such as a peak at the common start
            assert pair.first_better == (np.where(tied, 0.5, better)).mean()
    assert "peak_of_torque" in eqt_cli.open_result(result).metrics().columns


def test_the_summary_shows_it_first(result_of, read, capsys):
    result = result_of(HEAD + metric("shown_first", "over.final(a)", "pose_error"))
    print_outcome(read(result))
    assert capsys.readouterr().out.splitlines()[0].split()[2:4] == ["shown", "first"]


def test_parts_with_units_of_their_own_have_numbers_of_their_own(result_of, read):
    text = HEAD + metric(
        "torque_span", "over.largest(a) - over.smallest(a)", "torque_norm", units="{}"
    )
    result = result_of(
        text, group="SE3", inertia=[1, 2, 3, 4, 4, 4], reference={"torque": [0, 0, 1, 0, 0, 0]}
    )
    for part, axes, unit in (("rotation", slice(0, 3), "N m"), ("translation", slice(3, 6), "N")):
        norms = np.linalg.norm(result.read("torque")[..., axes], axis=-1)
        span = norms.max(axis=-1) - norms.min(axis=-1)
        np.testing.assert_allclose(result.metric(f"torque_span_{part}"), span, rtol=1e-12)
        assert result.units(f"torque_span_{part}") == unit


def test_listed_metrics_replace_those_of_the_plugins(result_of, read):
    assert own_metrics(read(result_of(metrics=[]))) == []
    assert own_metrics(read(result_of(metrics=["two"]))) == ["two"]


TUNE = {"over": {"gains.kp": [1, 4]}, "budget": 8, "samples": 1}


WORST = {"over": {"gains.kp": [1, 2]}, "budget": 1, "population": 5, "seeds": 1}
WORST |= {"objective": "late"}


SEEN = {"over": {"gains.kp": [1, 2]}, "budget": 5, "samples": 1}


@pytest.mark.needs("search")
def test_a_search_of_a_law_without_the_signal_leaves_the_metric_out(result_of, tmp_path):
    result_of(EVERY + metric("eff", "over.final(a)", "budget"))  # `effort` is no part of it
    data = mapping(controllers=["adaptive", "gt"], plugins=[str(tmp_path / "mine.py")])
    search = SEEN | {"objective": "effort", "confirm": {"runs": 5}}
    tuned = eqt_cli.tune(data | {"tune": search}, tmp_path / "t")
    assert len(tuned.to_dataframe()) == 2
    said = error_of(eqt_cli.tune, data | {"tune": search | {"objective": "final_budget"}})
    assert said.endswith(
        "final_budget reads budget, which the law 'gt' has not; leave this law out"
    )


LATE = HEAD + metric(
    "late", "np.where(a[:, 0] > 1.5, np.nan, a[:, 0] / 3)", "pose_error", units="s"
)


@pytest.mark.needs("search")
@pytest.mark.parametrize("censored", [False, True])
def test_a_run_without_a_value_is_never_better_than_the_worst(result_of, tmp_path, censored):
    text = (
        LATE.replace(
            'better: ClassVar[str] = "lower"',
            'better: ClassVar[str] = "lower"\n    censored: ClassVar[bool] = True',
        )
        if censored
        else LATE
    )
    result_of(text)
    data = mapping(controllers=["eqt"], plugins=[str(tmp_path / "mine.py")])
    data |= {"ensemble": {"runs": 8, "seed": 1}, "worst": WORST}
    if censored:
        worst = eqt_cli.worst(data, tmp_path / "w")
        assert worst.to_dataframe()["late"].tolist() == [
            1.0
        ]  # the horizon; others have at most 0.5
        return
    assert "late is NaN in " in error_of(eqt_cli.worst, data, tmp_path / "w")


@pytest.mark.needs("sweeps")
def test_a_metric_without_direction_is_shown_of_a_sweep(result_of, capsys, read):
    text = HEAD + metric("odd", "over.final(a)", "pose_error", better="neither")
    result = result_of(text, sweep=[{"grid": {"gains.kp": [1, 2]}}])
    print_outcome(read(result))
    assert "Points won by mean" in capsys.readouterr().out


@pytest.mark.needs("search")
@pytest.mark.parametrize("name", ["by_hand", "peak_of_torque"])
def test_a_search_makes_it_better(result_of, read, tmp_path, name):
    tune = TUNE | {"objective": name, "confirm": {"runs": 20}}
    text = HEAD + metric("peak_of_torque", "over.largest(norm(a))", "torque")
    text += metric(
        "by_hand", "np.abs(a).reshape(len(a), -1).sum(axis=-1)", "torque", better="higher"
    )
    (tmp_path / "mine.py").write_text(text)
    data = mapping(gains={"kp": 2.5, "kd": 0.5}, controllers=["eqt"], tune=tune)
    eqt_cli.tune(data | {"plugins": [str(tmp_path / "mine.py")]}, tmp_path / "tuned")
    found = read(tmp_path / "tuned")
    tuned, start = found.means(name)
    assert tuned > start if name == "by_hand" else tuned < start


AT_START = "metric odd is wrong at the start of run 0: mine.py:32: of returns "
WRONG = {
    "shape": (
        metric("odd", "a", "pose_error"),
        f"metrics[0]: {AT_START}an array of shape (3, 11) for 3 runs; expected (3,)",
    ),
    "mixed": (
        metric("odd", "over.largest(a - a.mean(axis=0))", "pose_error"),
        f"metrics[0]: {AT_START}numbers of a run that depend on other runs",
    ),
    "another run": (
        metric("odd", "over.largest(a - a[1])", "pose_error"),
        f"metrics[0]: {AT_START}numbers of a run that depend on other runs",
    ),
    "fails": (
        metric("odd", "over.middle(a)", "pose_error"),
        "metrics[0]: metric odd fails at the start of run 0: AttributeError: 'SampledRuns' "
        "object has no attribute 'middle' at mine.py:33: return over.middle(a)",
    ),
    "fails in a run": (
        metric("odd", "a[:, 1 // int(a[0, 3] != a[0, 4])]", "pose_error").replace("!=", "=="),
        "metric 'odd' fails on the samples of runs: ZeroDivisionError: integer division or modulo "
        "by zero at mine.py:33: return a[:, 1 // int(a[0, 3] == a[0, 4])]",
    ),
    "name": (
        metric("effort", "over.final(a)", "pose_error"),
        "metric 'effort': results have a number of this name; rename yours",
    ),
    "name of a dataset": (
        metric("quaternion", "over.final(a)", "pose_error"),
        "metric 'quaternion': results have a number of this name; rename yours",
    ),
    "word": (
        metric("odd", "over.final(a)", "pose_error").replace('"odd"', '"an odd one"'),
        "metrics[0]: metric 'an odd one': expected a name of letters, digits and _",
    ),
    "better": (
        metric("odd", "over.final(a)", "pose_error", better="smaller"),
        "metrics[0]: metric odd: better: expected lower, higher, neither, got 'smaller'",
    ),
    "both": (
        metric("odd", "over.final(a)", "torque_norm"),
        "metrics[0]: metric odd reads 'torque_norm', a signal and a number of a law; rename this",
    ),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_with_it_is_said(result_of, kind):
    text, said = WRONG[kind]
    head = HEAD.replace('"budget"', '"torque_norm"') if kind == "both" else HEAD
    assert error_of(result_of, head + text).endswith(said)


def test_a_metric_without_its_signals_is_left_out_with_a_remark(result_of, read):
    text = HEAD + metric("odd", "over.final(a)", "pose_eror")
    with pytest.warns(
        EqtWarning, match="pose_eror', but no loop has it; did you mean 'pose_error'"
    ):
        result = result_of(text)
    assert own_metrics(read(result)) == []
    said = error_of(result_of, text, metrics=["odd"])
    assert said.endswith("reads 'pose_eror', but no loop has it; did you mean 'pose_error'?")


def test_a_wrong_entry_of_metrics_is_said_at_its_place(result_of):
    assert "metrics[1]" in error_of(result_of, metrics=["two", {"kind": "two", "limit": 3}])
    assert "unknown metric 'three'" in error_of(result_of, metrics=["three"])


def test_a_metric_is_listed_once(result_of):
    said = error_of(result_of, metrics=["two", "two"])
    assert said.endswith("metrics: two is listed twice; a result has one number of a name")
