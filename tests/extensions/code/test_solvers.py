"""Laws as solvers are: an object for each run, state that nobody named, and calls that fail."""

import json
import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.extensions.code import guests
from eqt_cli.results.result import open_result
from eqt_cli.results.timing import timing, timing_lines
from eqt_cli.runs.preflight import rehearse
from eqt_cli.runs.run_study import Shard

COUNTING = """
class Counting:
    def __init__(self):
        self.calls = 0

    def compute(self, t, velocity):
        self.calls += 1
        return -velocity - 1e-3 * self.calls
"""
FAILING = """
def compute(t, velocity):
    if 0.095 < t < 0.145:
        raise RuntimeError("infeasible")
    return -velocity if t < 0.195 else None
"""
INT = """
typedef double real;
typedef struct { real gain; } law_numbers;
typedef struct { real unused; } law_memory;
typedef struct {
    real t, pose[9], velocity[3], desired_pose[9], desired_velocity[3], desired_acceleration[3];
} law_input;
int law_torque(const law_numbers *n, law_memory *m, const law_input *in, real *torque)
{
    int k;
    (void)n, (void)m;
    for (k = 0; k < 3; k++) torque[k] = -in->velocity[k];
    return (in->t > 0.095 && in->t < 0.145) || in->t > 0.195;
}
"""


COMPILES = pytest.mark.ci("another case is fast")


@pytest.fixture
def law(config):
    def make(text, over=(), file="law.py", **options):
        Path(file).write_text(text, encoding="utf-8")
        named = {"function": "compute"} if file == "law.py" else {}
        return config(over=over, **{"file": file, "as": None, "numbers": None, **named, **options})

    return make


def test_a_state_that_is_not_named_is_told(law, told):
    """Random states are called forward and back: the last call is 23 before or after another."""
    said = told(law(COUNTING, function="Counting().compute"))
    assert said == (
        "controllers[0]: "
        "Counting().compute in law.py: it keeps something from call to call that `memory` does not "
        "name (difference 0.02); name it, or write `object: per run`"
    )


def test_one_of_a_run_passes_the_check_of_a_study(law):
    """Which asks for the rates of runs alone and together, from the start."""
    experiment = law(COUNTING, function="Counting().compute", object="per run")
    assert rehearse(eqt_cli.load_experiment(experiment), solves=True) == []


@pytest.mark.ci("the search for what is not named is fast")
def test_one_that_is_named_or_of_a_run_flies(law):
    """Both are the same: the object of a run counts its own calls from 0."""
    over = {"solver": {"engine": "native"}}
    named = law(COUNTING, over, function="Counting().compute", memory=["calls"])
    of_run = law(COUNTING, over, function="Counting().compute", object="per run")
    torques = [eqt_cli.run(x, f"r{k}")["torque"] for k, x in enumerate((named, of_run))]
    np.testing.assert_allclose(*torques, atol=1e-13)  # steps depend on the number of states
    assert np.ptp(torques[0]) > 0


@pytest.mark.parametrize("engine", [pytest.param("native", marks=COMPILES), "solve_ivp"])
@pytest.mark.parametrize("text", [FAILING, pytest.param(INT, marks=COMPILES)], ids=["Python", "C"])
@pytest.mark.parametrize("what", ["hold", pytest.param("zero", marks=COMPILES)])
def test_calls_that_fail_are_counted(text, what, engine, law):
    """Of ticks of 0.02 s it fails at 0.1, 0.12 and 0.14 s, and at the 10 from 0.2 s on."""
    file = "law.py" if text == FAILING else "law.c"
    over = {
        "solver": {"engine": engine, "cross_check": 1},
        "time": {"duration": 0.4, "samples": 21},
    }
    said = r"compute in law\.py failed at an instant: line 4: RuntimeError: infeasible"
    remark = pytest.warns(EqtWarning, match=said) if file == "law.py" else nullcontext()
    with remark:
        result = eqt_cli.run(law(text, over, file, on_failure=what))
    assert (result["law_failures"] == 13).all()
    command, velocity = result["command"][0, 0], result["velocity"][0, 0]
    times = np.round(result["time"], 9)
    for k in range(20):
        t, last = times[k], (4 if times[k] < 0.145 else 9)
        fails = 0.095 < t < 0.145 or t > 0.195
        expected = -velocity[last] if what == "hold" else 0 * velocity[0]
        np.testing.assert_allclose(command[k], expected if fails else -velocity[k], atol=1e-13)


@pytest.mark.ci("one whose command is held is fast")
def test_one_that_stops_ends_its_runs(law):
    result = eqt_cli.run(law(FAILING, on_failure="stop"))
    assert list(result["message"][0]) == ["t = 0.1 s: the command is not finite"] * 2


SLOW = """
import time

def compute(t, velocity):
    ends = time.thread_time() + 0.004
    while time.thread_time() < ends:
        pass
    return -velocity
"""


@pytest.mark.ci("a damaged file is fast")
def test_times_of_calls_stand_beside_the_result(law):
    """A call burns 4 ms of 20; the digest knows nothing of them, and threads change no bits."""
    over = {
        "solver": {"engine": "native", "cross_check": 0},
        "time": {"duration": 0.1, "samples": 3},
    }
    data = law(SLOW, over)
    results = [eqt_cli.run(data, f"r{n}", workers=n) for n in (1, 2)]
    for result in results:
        row = json.loads((result.path / "timing.json").read_text())["laws"]["ours"]
        assert 0.004 < row["median"] <= row["99 %"] <= row["largest"]
        # Two runs, solved twice for the estimate of their errors, at 5 instants.
        assert row["calls"] == 20
    np.testing.assert_array_equal(*(result["torque"] for result in results))
    assert len({result.attributes["digest"] for result in results}) == 1
    with open_result(results[0].file) as opened:
        first, late = timing_lines(opened)
    assert re.fullmatch(
        r"CPU, ms \(this machine\), median, 99 % and largest of a call: ours .*", first
    )
    assert late == "ours flew as if it took none; `control: {delay: 1}` gives it a period"


def test_a_damaged_file_of_times_is_no_harm(law, tmp_path):
    for text in ("", "{", '{"laws": {"ours": 3}}', '{"laws": {"ours": {"median": "x"}}}'):
        (tmp_path / "timing.json").write_text(text)
        assert timing(tmp_path) == {}


def test_what_excludes_each_other(law, told):
    for options, said in (
        ({"object": "per run", "memory": ["calls"]}, "memory: the object of a run keeps all"),
        ({"on_failure": "hold", "as": "lee2010"}, "on_failure: a law in `as` never fails"),
        ({"object": "per run", "over": {"control": None}}, "object: applies at control instants"),
    ):
        assert said in told(law(COUNTING, **{"function": "Counting().compute", **options}))
    void = INT.replace("int law_torque", "void law_torque").partition("    return")[0] + "}"
    options = {"function": None, "file": "law.c", "on_failure": "zero"}
    assert "law_torque is void and cannot say that it failed" in told(law(void, **options))


@pytest.mark.ci("what it is called with is fast")
def test_margins_and_random_states_are_refused(law):
    data = law(COUNTING, {"reference": {"kind": "constant"}}, function="Counting().compute")
    data["controllers"][0]["object"] = "per run"
    with pytest.raises(EqtError, match="'ours' answers in the order of time of a run only"):
        eqt_cli.margins(data)
    rows = [row for row in eqt_cli.verify(data).rows if row.kind == "code"]
    assert [row.remark for row in rows] == [
        "undecided: `object: per run` cannot be called at random states"
    ]


def test_a_static_variable_is_told_too(law, told):
    """At the four states at t = 0, of which one is the first and the eighth call; others fail."""
    counting = INT.replace("int k;", "int k; static int calls;").replace("(void)n", "(void)calls++")
    text = counting.replace("-in->velocity[k]", "1e-3 * calls")
    assert told(law(text, file="law.c")) == (
        "controllers[0]: law_torque in law.c: it keeps something from call to call that `memory` "
        "does not name (difference 0.007); name it"
    )


@pytest.mark.ci("waits for its objects")
def test_objects_that_take_long_are_made_one_by_one(law, monkeypatch):
    """Ten of half a second, of which more than seven exceed the limit of a request."""
    monkeypatch.setattr(guests, "SECONDS", 4.0)
    text = COUNTING.replace("self.calls = 0", "self.calls = 0; time.sleep(0.5)")
    text = f"import os, time\nos.environ['OWN'] = '1'\n{text}"  # which a law may, for itself
    over = {
        "ensemble": {"runs": 10},
        "time": {"duration": 0.02, "samples": 2},
        "solver": {"engine": "native", "error_estimate": False, "cross_check": 0},
    }
    data = law(text, over, function="Counting().compute", object="per run")
    assert (eqt_cli.run(data)["status"] == 0).all()


@pytest.mark.ci("a run of one session is fast")
def test_what_is_continued_has_the_same_bits(law):
    """The first session computes one law of two, as if it was killed then."""
    data = law(COUNTING, function="Counting().compute", object="per run")
    [entry] = data["controllers"]
    data["controllers"] = [entry, {**entry, "label": "again"}]
    whole = eqt_cli.run(data, "whole")
    eqt_cli.run(data, "continued", shard=Shard(1, 2))
    continued = eqt_cli.run(data, "continued")
    assert continued.outcome.resumed == 2
    np.testing.assert_array_equal(continued["torque"], whole["torque"])
    np.testing.assert_array_equal(whole["torque"][0], whole["torque"][1])
