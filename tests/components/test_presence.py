"""What acts for a stretch of time that runs draw: closed forms, both engines, what is refused."""

import numpy as np
import pytest
import yaml
from case_tables import refusal
from said import mentions

from eqt_cli.base.errors import ConfigError

MASS = 2.0
PUSH = {"kind": "constant", "force": [3.0, 0.0]}
DRAWN = {"since": {"uniform": [0.2, 0.6]}, "lasts": {"uniform": [0.005, 0.2]}}
FREE = {
    "group": "R2",
    "inertia": MASS,
    "gains": {"kp": 1e-14, "kd": 1e-14},
    "reference": {"kind": "constant"},
    "controllers": ["eqt"],
    "initial": {"pose": {"kind": "identity"}},
    "time": {"duration": 1.0, "samples": 11},
    "ensemble": {"runs": 4, "seed": 3},
}


@pytest.mark.parametrize(
    "engine", ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles"))]
)
@pytest.mark.parametrize(
    "control", [{}, pytest.param({"control": {"period": 0.02}}, marks=pytest.mark.ci("0.5 s"))]
)
def test_a_push_begins_and_ends_at_drawn_times(solved, engine, control):
    """p = F/m (⟨t − a⟩² − ⟨t − b⟩²)/2 to rounding, where a step that spans a jump misses 1e-6."""
    text = FREE | control | {"plant": {"forces": [PUSH | DRAWN]}}
    problem, solution = solved(yaml.safe_dump(text | {"solver": {"engine": engine}}))
    begin, end = (
        problem.varying[f"vehicle.forces[0].presence.{name}"] for name in ("since", "until")
    )
    assert np.ptp(begin) > 0.1
    assert np.ptp(end - begin) > 0.05
    ramps = [np.clip(problem.times - time, 0.0, None) ** 2 / 2 for time in (begin, end)]
    places = problem.loop.tracking(problem.times, solution.states).Q[..., 0, -1]
    np.testing.assert_allclose(places, 3.0 / MASS * (ramps[0] - ramps[1]), rtol=0, atol=1e-13)


def test_a_duration_is_drawn_again_until_it_is_greater_than_0(experiment_of):
    drawn = {"since": 0.5, "lasts": {"normal": [0.05, 0.5]}}
    random = np.random.default_rng(0)
    for force in (PUSH, {"kind": "gust", "std": 0.1, "time_constant": 1.0}):
        text = yaml.safe_dump(FREE | {"plant": {"forces": [force | drawn]}})
        loop = experiment_of(text).loops["eqt"]
        runs = [loop.vehicle.configured.of_run(loop.group, lambda _: random) for _ in range(20)]
        assert min(run.forces[0].presence.until for run in runs) > 0.5


@pytest.mark.parametrize(
    "force",
    [
        {"kind": "gust", "std": 0.1, "time_constant": 1.0},
        {"kind": "expression", "force": ["sin(t)", "t"]},
        {"kind": "drag", "linear": 0.5, "quadratic": 0.2},
    ],
    ids=lambda force: force["kind"],
)
def test_what_acts_between_two_times_is_the_same_force_there(experiment_of, force):
    """At numbers that all runs share, where steps end."""
    V, found = np.array([[0.3, -0.4]]), {}
    for times in ({}, {"since": 0.3, "until": 0.7}):
        text = yaml.safe_dump(FREE | {"plant": {"forces": [force | times]}})
        loop = experiment_of(text).loops["eqt"]
        part, Q = loop.vehicle.forces[0], loop.group.identity[None]
        at = [part.in_body(loop.group, t, Q, V) + 0.0 * V for t in (0.1, 0.5, 0.9)]
        found["since" in times] = np.concatenate(at)
        assert ({0.3, 0.7} <= {*loop.instants(1.0)}) == ("since" in times)
    np.testing.assert_array_equal(found[True], found[False] * [[0.0], [1.0], [0.0]])


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ({"since": -1}, "since: expected at least 0 s, got -1 s"),
        ({"until": 0}, "until: expected more than 0 s…got 0 s"),
        ({"since": 2, "until": 1}, "until: expected more than 2 s…got 1 s"),
        ({"since": {"uniform": [3, 1]}}, "since.uniform: expected the smaller number first…"),
        ({"since": "soon"}, "since: expected a number…'soon'…"),
        ({"since": [1, 3]}, "since: expected a number…got [1, 3]; write {uniform: [1, 3]}"),
        ({"at": 2}, "at: expected 'centre' or 'line', got 2; did you mean 'since'?"),
        ({"from": 2}, "from: unknown key; did you mean 'since'?"),
        ({"since": 1, "end": 2}, "end: unknown key; did you mean 'until'?"),
        ({"since": 1, "duration": 2}, "duration: unknown key; did you mean 'lasts'?"),
    ],
)
def test_times_that_are_none_are_refused(experiment_of, times, said):
    text = yaml.safe_dump(FREE | {"plant": {"forces": [PUSH | times]}})
    assert mentions(refusal(ConfigError, experiment_of, text), f"plant.forces[0].{said}")
