"""How much of the runs the cross-check redoes: about a tenth of their work, told by counts."""

import re

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import load_experiment
from eqt_cli.engines import engine as walk
from eqt_cli.engines.engine import Problem
from eqt_cli.engines.native import Native
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.loop.closed_loop import OwnStarts
from eqt_cli.runs import batches as checking
from eqt_cli.runs.batches import (
    FREE_STEPS,
    MOST_PIECES,
    WORK_SHARE,
    _affordable,
    _Pieces,
    batches,
    independent,
)

STEPS = {label: np.full(200, 100.0) for label in ("eqt", "gt")}
"""As the paper's runs have them."""


def study(**solver):
    solver = {"engine": "native", **solver}
    return load_experiment(mapping(ensemble={"runs": 200}, time={"duration": 20}, solver=solver))


def test_a_check_may_cost_a_tenth_of_what_any_experiment_takes_to_begin():
    few = {label: np.full(2, 10.0) for label in STEPS}
    assert _affordable(study(), 1, few) == 1.0


def test_a_check_of_many_laws_is_of_less():
    part = _affordable(study(), 20, STEPS)
    assert 0 < part < 0.2
    assert _affordable(study(), 40, STEPS) == pytest.approx(part / 2)


def test_more_runs_pay_for_more_of_the_check():
    many = {label: np.full(100_000, 100.0) for label in STEPS}
    few, more = (_affordable(study(), 100, steps) for steps in (STEPS, many))
    work = 2 * 2 * 100_000 * 100  # each run is solved twice
    assert more / few == pytest.approx(WORK_SHARE * work / FREE_STEPS)


def test_control_instants_of_a_loop_are_paid_for():
    """15 evaluations each, where a step takes 28."""
    parts = [_affordable(study(), 20, STEPS, instants) for instants in (0, 280)]
    steps = max(float(each.max()) for each in STEPS.values())
    assert parts[0] / parts[1] == pytest.approx(1 + 280 * 15 / (28 * steps))


def test_a_check_that_is_asked_for_is_whole():
    assert _affordable(study(cross_check=5), 1000, STEPS) == 1.0


def test_runs_of_solve_ivp_are_checked_for_a_tenth_as_well():
    vectorised = {label: np.full(200, 2800.0) for label in STEPS}
    assert 0 < _affordable(study(engine="solve_ivp"), 10, vectorised) < 0.2


METHODS = {
    Native(rtol=1e-7): "LSODA",
    SolveIvp(rtol=1e-7): "LSODA",
    SolveIvp(rtol=1e-7, method="Radau"): "LSODA",
    SolveIvp(rtol=1e-7, method="LSODA"): "Radau",
    SolveIvp(rtol=1e-7, method="BDF"): "Radau",
}


@pytest.mark.parametrize("engine", METHODS, ids=lambda each: getattr(each, "method", each.name))
def test_the_check_is_of_another_kind_of_method_and_as_accurate(engine, found):
    """LSODA compares largest errors and Radau means, so one is given √B times the tolerance."""
    other = independent(engine)
    assert other.method == METHODS[engine]
    problem, exact = found
    if engine.name == "native" or engine.method == "LSODA":
        problem = Problem(problem.loop, problem.states, problem.times[:21])
        states = other.solve(problem).states
        assert 1e-12 < np.abs(states - exact[:, :21]).max() < 100 * engine.rtol


@pytest.fixture(scope="module")
def found():
    """Runs of a law with a reference that depends on time, and their states."""
    (batch,) = batches(study(), "eqt", np.arange(3))
    return batch.problem, SolveIvp(rtol=1e-10).solve(batch.problem).states


def test_pieces_cover_the_horizon_where_they_can_afford_it(found):
    problem, _ = found
    pieces = _Pieces.of(problem, SolveIvp(), 0.1)
    steps = len(problem.times) - 1
    assert len(pieces.starts) == 10
    ends = [start + pieces.length - 1 for start in pieces.starts]
    assert pieces.starts[0] == 0
    assert ends[-1] == steps
    assert all(later <= end for later, end in zip(pieces.starts[1:], ends[:-1], strict=True))


def test_pieces_of_a_long_horizon_are_spread_over_it(found):
    problem, _ = found
    pieces = _Pieces.of(problem, SolveIvp(), 0.02)
    assert len(pieces.starts) == MOST_PIECES
    assert pieces.length - 1 == int(0.02 * (len(problem.times) - 1))
    assert pieces.starts[-1] + pieces.length == len(problem.times)


def test_pieces_side_by_side_are_the_motion(found):
    problem, states = found
    pieces = _Pieces.of(problem, SolveIvp(), 0.1)
    part = pieces.problem(problem, states)
    assert isinstance(part.loop, OwnStarts)
    again = SolveIvp().solve(part).states
    # The tolerance, with what the trajectories amplify in a piece.
    assert pieces.differences(problem, states, again).max() < 1e-7


def test_a_piece_that_is_wrong_shows(found):
    problem, states = found
    pieces = _Pieces.of(problem, SolveIvp(), 0.1)
    again = SolveIvp().solve(pieces.problem(problem, states)).states
    wrong = states.copy()
    middle = pieces.starts[5] + 3
    wrong[1, middle, problem.loop.layout.slices["momentum"]] += 1e-3
    differences = pieces.differences(problem, wrong, again)
    assert differences[1] > 1e-4
    assert differences[[0, 2]].max() < 1e-7


def test_a_loop_that_changes_at_instants_is_checked_from_its_beginning():
    slew = {"kind": "slew", "to": {"rotvec": [1, 0, 0]}, "duration": 9}
    config = study().resolved | {"reference": slew}
    (batch,) = batches(load_experiment(config), "eqt", np.arange(3))
    assert len(batch.problem.spans) > 1
    assert _Pieces.of(batch.problem, SolveIvp(), 0.1).starts == (0,)


@pytest.mark.parametrize("period", [19.0, 20.0, 50.0])
def test_a_loop_that_holds_a_command_is_checked_from_its_beginning(period):
    """Also where it is held beyond the end, so that the field changes at no known instant."""
    config = study().resolved | {"control": {"period": period}}
    (batch,) = batches(load_experiment(config), "eqt", np.arange(3))
    pieces = _Pieces.of(batch.problem, SolveIvp(), 0.1)
    assert pieces.starts == (0,)
    states = SolveIvp(rtol=1e-9).solve(batch.problem).states
    again = SolveIvp(rtol=1e-9).solve(pieces.problem(batch.problem, states)).states
    assert pieces.differences(batch.problem, states, again).max() < 1e-7


def test_runs_that_an_engine_solves_one_by_one_are_checked_from_their_beginning(found):
    problem, _ = found
    pieces = _Pieces.of(problem, SolveIvp(method="Radau"), 0.1)
    assert pieces.starts == (0,)
    assert problem.times[pieces.length - 1] == pytest.approx(0.1 * problem.times[-1], rel=0.05)


def test_the_papers_runs_are_checked_over_the_whole_horizon(found):
    problem, _ = found
    laws = {label: np.full(200, 100.0) for label in "abcd"}
    part = _affordable(study(), 1, laws)
    pieces = _Pieces.of(Problem.joined([problem] * 4), SolveIvp(), part)
    assert len(pieces.starts) * (pieces.length - 1) >= len(problem.times) - 1


def test_a_reference_that_takes_one_time_only_is_checked_from_its_beginning(found, monkeypatch):
    problem, states = found
    pieces = _Pieces.of(problem, SolveIvp(), 0.1)
    assert pieces.can_share_evaluations(problem, states)
    torque = problem.loop.reference.driving_torque

    def of_one_time(self, *arguments):
        t = next(each for each in arguments if isinstance(each, float | np.ndarray))
        assert np.ndim(t) == 0
        return torque(*arguments)

    monkeypatch.setattr(type(problem.loop.reference), "driving_torque", of_one_time)
    assert not pieces.can_share_evaluations(problem, states)


@pytest.fixture(scope="module")
def solved():
    """An experiment and its states."""
    few = {"ensemble.runs": 3, "time.samples": 41, "controllers": ["eqt"]}
    loaded = load_experiment("configs/paper.yaml", few)
    [batch] = batches(loaded, "eqt", np.arange(3))
    return loaded, {"eqt": [batch.engine.solve(batch.problem).states]}


class Clock:
    """A clock that a look at it advances by 1 s."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        self.now += 1.0
        return self.now


@pytest.mark.parametrize(
    ("seconds", "outcome"),
    [
        (np.inf, r"cross-check: 3 runs per law by LSODA, largest difference \S+e-\d+ "),
        (600, r"3 runs per law by LSODA over the first \S+ s, ended by its limit of time, "),
        (3, r"cross-check: nothing to compare, since LSODA was ended by its limit of time$"),
    ],
)
def test_a_check_ends_in_time_and_says_what_it_compared(solved, monkeypatch, seconds, outcome):
    loaded, found = solved
    steps = {"eqt": [np.full(3, 100.0)]}
    monkeypatch.setattr(checking, "time", Clock())
    monkeypatch.setattr(walk, "REPORTED", 1e-4)
    check = checking.cross_check(loaded, found, steps, seconds)
    assert re.search(outcome, check.described)
    assert check.holds
