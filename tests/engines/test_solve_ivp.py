"""The solve_ivp engine: how accurate blocks are, and what becomes of runs that fail.

Errors are measured against the same engine at its smallest tolerance, at the sample points, where
the interpolation between steps adds to the error of the steps themselves. They are multiples of
rtol because the closed loop forgets errors about as fast as steps commit them: measured over all
blocks and tolerances of `test_error_is_a_few_rtol`, between 0.4 and 11 rtol.
"""

import re
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from small_experiment import mapping

import eqt_cli
from eqt_cli.components.laws import Controller, EqT, controllers
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.engines import solve_ivp
from eqt_cli.engines.engine import DIVERGED, Problem, Status
from eqt_cli.engines.solve_ivp import SMALLEST_RTOL, SolveIvp, _jacobian_options
from eqt_cli.extend import (
    ClosedLoop,
    ConstantReference,
    Force,
    Gains,
    Inertia,
    TorqueReference,
    group_named,
)
from eqt_cli.numbers.leaves import with_leaves

LONG = pytest.mark.ci("takes many steps, and each evaluates the law in Python")

IDEAL = Vehicle()
METHODS = ["DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA"]
INERTIA = np.array([[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]])


def paper_loop(controller, reference=None, vehicle=IDEAL):
    return ClosedLoop(
        group=group_named("SO3"),
        inertia=Inertia(INERTIA, np.linalg.inv(INERTIA)),
        gains=Gains(np.eye(3), 0.5 * np.eye(3)),
        reference=reference or TorqueReference(["cos(t)", "sin(t)", "cos(t)*sin(t)"]),
        controller=controller,
        vehicle=vehicle,
    )


def paper_problem(runs, duration, controller=None, samples=41, vehicle=IDEAL):
    loop = paper_loop(controller or EqT(), vehicle=vehicle)
    random = np.random.default_rng(7)
    Q = loop.group.exp(random.standard_normal((runs, 3)))
    states = loop.initial_state(Q, random.standard_normal((runs, 3)), np.eye(3), np.zeros(3))
    return Problem(loop, states, np.linspace(0.0, duration, samples))


def exact(problem):
    engine = SolveIvp(rtol=SMALLEST_RTOL, atol=1e-15, block=problem.runs)
    return engine.solve(problem).states


def errors(solution, reference):
    """The largest error of each run."""
    return np.abs(solution.states - reference).max(axis=(1, 2))


# Accuracy -----------------------------------------------------------------------------------------


@LONG
@pytest.mark.parametrize(("name", "rtol"), [("eqt", 1e-8), ("nog", 1e-5)])
def test_error_is_a_few_rtol(name, rtol):
    """One run per call, blocks that divide the runs or do not, and all runs in one block."""
    problem = paper_problem(runs=4, duration=5.0, controller=controllers.get(name)())
    reference = exact(problem)
    for block in (1, 3, 4):
        solution = SolveIvp(rtol=rtol, atol=rtol * 1e-3, block=block).solve(problem)
        assert not solution.status.any()
        assert errors(solution, reference).max() < 30 * rtol


def test_worst_run_of_a_block_is_no_worse_than_alone():
    """What the division of the tolerances by √block is for."""
    problem = paper_problem(runs=16, duration=1.0, samples=11)
    reference = exact(problem)
    alone, together = (
        errors(SolveIvp(rtol=1e-6, atol=1e-9, block=block).solve(problem), reference).max()
        for block in (1, 16)
    )
    assert together < alone


@pytest.mark.parametrize("block", [3, pytest.param(1, marks=LONG)])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_keeps_its_tolerance(method, block):
    problem = paper_problem(runs=3, duration=1.0, samples=11)
    solution = SolveIvp(method=method, rtol=1e-6, atol=1e-9, block=block).solve(problem)
    # Measured: between 0.02 rtol (LSODA) and 2.5 rtol (DOP853, whose steps are the longest).
    assert errors(solution, exact(problem)).max() < 10 * 1e-6


@pytest.mark.parametrize("method", ["Radau", "BDF", "LSODA"])
def test_implicit_methods_solve_blocks_of_stiff_runs(method):
    """Explicit methods take 15 000 evaluations and more at this damping; these take 300 to 650."""
    problem = paper_problem(runs=3, duration=1.0, samples=5)
    stiff = with_leaves(problem.loop, {"gains.K_d": 1e4 * np.eye(3)})
    problem = Problem(stiff, problem.states, problem.times)
    engine = SolveIvp(method=method, rtol=1e-4, atol=1e-7, block=3, max_steps=1000)
    solution = engine.solve(problem)
    assert not solution.status.any()
    assert len(set(solution.steps)) == 1  # of one block, and not of three runs redone


def test_initial_time_need_not_be_zero():
    whole = paper_problem(runs=2, duration=4.0, samples=41)
    engine = SolveIvp(rtol=1e-8, atol=1e-11, block=2)
    first = engine.solve(whole).states
    rest = Problem(whole.loop, first[:, 20], whole.times[20:])
    # Both halves within 30 rtol of the exact solution, as above.
    np.testing.assert_allclose(engine.solve(rest).states, first[:, 20:], rtol=0, atol=6e-7)


def test_a_sampled_law_has_acted_where_its_runs_begin():
    """So that the motion begins as that under the same law at all times."""
    rates = []
    for vehicle in (Vehicle(), Vehicle(control=Sampling(period=0.1))):
        loop, states = paper_problem(runs=3, duration=1.0, vehicle=vehicle).begun
        rates.append(loop.vector_field(0.0, states)[:, : loop.layout.slices["momentum"].stop])
    assert np.abs(rates[0]).max() > 0.1
    np.testing.assert_allclose(*rates, rtol=0, atol=1e-14)


def test_the_first_step_after_an_instant_follows_from_the_steps_before_it():
    """One step from each instant to the next: 12 evaluations, and two at its start.

    With SciPy's own guesses of the first steps there are 28.
    """
    sampled = Vehicle(control=Sampling(period=0.1))
    problem = paper_problem(runs=3, duration=2.0, samples=5, vehicle=sampled)
    solution = SolveIvp(rtol=1e-6, atol=1e-9).solve(problem)
    assert solution.steps[0] < 16 * len(problem.spans)
    assert errors(solution, exact(problem)).max() < 30 * 1e-6


def test_each_span_counts_its_own_evaluations():
    """Some 22 for each of three periods; 200 if those before counted again."""
    vehicle = Vehicle(control=Sampling(period=0.1))
    problem = paper_problem(runs=1, duration=0.3, samples=2, vehicle=vehicle)
    assert SolveIvp(rtol=1e-6, atol=1e-9).solve(problem).steps[0] < 100


# What a run's numbers depend on -------------------------------------------------------------------


@pytest.mark.parametrize("block", [pytest.param(1, marks=LONG), 3])
def test_runs_of_other_blocks_change_no_bit(block):
    problem = paper_problem(runs=8, duration=2.0)
    engine = SolveIvp(rtol=1e-6, atol=1e-9, block=block)
    whole = engine.solve(problem)
    for runs in (slice(0, 3), slice(3, 6), slice(6, 8), slice(3, 8)):
        part = engine.solve(problem.select(runs))
        assert (part.states == whole.states[runs]).all()
        assert (part.steps == whole.steps[runs]).all()


def test_tolerance_of_a_run_does_not_depend_on_how_full_its_block_is():
    """Both are divided by √block, here 2, also for a block of one run that is left over."""
    problem = paper_problem(runs=1, duration=2.0)
    left_over = SolveIvp(rtol=1e-6, atol=1e-9, block=4).solve(problem)
    alone = SolveIvp(rtol=1e-6 / 2, atol=1e-9 / 2, block=1).solve(problem)
    assert (left_over.states == alone.states).all()


@pytest.mark.parametrize("method", METHODS)
def test_only_explicit_methods_take_steps_for_their_stability(method):
    work = SolveIvp(method=method).work_for_stability(np.array([[-1000.0]]), 1.0).amount
    assert (work > 1000) == (method in ("DOP853", "RK45", "RK23"))
    assert work > 1000 or work == 0


@pytest.mark.parametrize(("method", "stages", "limit"), [("RK45", 6, 3.307), ("RK23", 3, 2.513)])
def test_steps_for_stability_count_an_evaluation_for_each_stage(method, stages, limit):
    """Limits on the real axis: Hairer and Wanner (1996), Section IV.2."""
    work = SolveIvp(method=method).work_for_stability(np.array([[-1000.0]]), 2.0).amount
    assert work == pytest.approx(stages * 2000 / limit, rel=0.02)


def test_implicit_methods_know_that_runs_are_independent():
    for method in METHODS:
        assert _jacobian_options(method, 1, 4) == {}
    assert _jacobian_options("RK45", 3, 4) == {}
    assert _jacobian_options("LSODA", 3, 4) == {"lband": 3, "uband": 3}
    for method in ("Radau", "BDF"):
        sparsity = _jacobian_options(method, 3, 4)["jac_sparsity"].toarray()
        np.testing.assert_array_equal(sparsity, np.kron(np.eye(3), np.ones((4, 4))))


class Broken(Controller):
    def torque(self, s):
        raise ZeroDivisionError


def test_a_rehearsal_raises_what_a_law_raises_and_bears_a_fast_motion():
    with pytest.raises(ZeroDivisionError):
        SolveIvp().rehearse(paper_problem(runs=2, duration=1.0, controller=Broken()))
    SolveIvp(max_steps=3).rehearse(paper_problem(runs=2, duration=1.0))


def test_tightened_tolerances():
    engine = SolveIvp(rtol=1e-6, atol=1e-9, method="RK45", block=7).tightened(0.01)
    assert (engine.rtol, engine.atol) == (pytest.approx(1e-8), pytest.approx(1e-11))
    assert (engine.method, engine.block) == ("RK45", 7)
    assert SolveIvp(rtol=1e-12).tightened(1e-3).rtol == SMALLEST_RTOL


# Runs that fail -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Faulty(Controller):
    """EqT, but for runs with a `fault` a torque that cannot be integrated."""

    fault: float = 0.0

    def torque(self, s):
        return np.where(self.fault > 0, self.bad_torque(s), EqT().torque(s))


class Escaping(Faulty):
    """d/dt ‖P‖² = 2‖P‖²(1 + ‖P‖²), infinite at t = ½ log(1 + 1/‖P(0)‖²)."""

    def bad_torque(self, s):
        return s.P * (1 + (s.P * s.P).sum(axis=-1, keepdims=True))


class NotANumberAtOnce(Faulty):
    def bad_torque(self, s):
        return np.full(s.P.shape, np.nan)


class NotANumberAfterTheStart(Faulty):
    def bad_torque(self, s):
        return np.full(s.P.shape, np.nan) if s.t > 0 else 0 * s.P


class NotANumberAfterOneSecond(Faulty):
    def bad_torque(self, s):
        return np.full(s.P.shape, np.nan) if s.t > 1 else 0 * s.P


class InfiniteAfterOneSecond(Faulty):
    def bad_torque(self, s):
        return np.full(s.P.shape, np.inf) if s.t > 1 else 0 * s.P


class Rattling(Faulty):
    """Takes many thousand steps a second, with every method."""

    def bad_torque(self, s):
        return 1e4 * np.sin(1e5 * s.t) + 0 * s.P


class NotANumberInTrialStepsThenEscaping(Escaping):
    """At t = ½ a fast decay to ½ sets in, on which long steps leave the domain and are refused."""

    def bad_torque(self, s):
        if s.t < 0.5:
            return 0 * s.P
        if s.t < 1:
            return np.where(np.abs(s.P) > 2, np.nan, 200 * (0.5 - s.P))
        return super().bad_torque(s)


FAULTS = {
    "escape": (Escaping, Status.SOLVER_FAILED),
    "nan_at_once": (NotANumberAtOnce, Status.NON_FINITE),
    "nan_after_the_start": (NotANumberAfterTheStart, Status.NON_FINITE),
    "nan_after_one_second": (NotANumberAfterOneSecond, Status.NON_FINITE),
    "rattling": (Rattling, Status.STEP_LIMIT),
}
SAMPLES = 21
DURATION = 2.0


def faulty_problem(controller, faults, momentum=1.0, vehicle=IDEAL):
    """Runs with the given faults; the others track a target at rest."""
    loop = paper_loop(controller(), ConstantReference(), vehicle)
    random = np.random.default_rng(7)
    runs = len(faults)
    Q = loop.group.exp(random.standard_normal((runs, 3)))
    P = random.standard_normal((runs, 3))
    P *= momentum / np.linalg.norm(P, axis=-1, keepdims=True)
    V = loop.inertia.velocity(P)
    states = loop.initial_state(Q, V, np.eye(3), np.zeros(3))
    varying = {"controller.fault": np.array(faults, dtype=float)[:, None]}
    return Problem(loop, states, np.linspace(0.0, DURATION, SAMPLES), varying)


def engine_for(controller, method="DOP853", block=3, max_steps=None):
    # A healthy run takes up to 500 evaluations. SciPy takes thousands to give up at a failure.
    limit = max_steps or (1000 if controller is Rattling else 6000)
    return SolveIvp(method=method, rtol=1e-6, atol=1e-9, block=block, max_steps=limit)


def solve_one(controller, momentum=1.0, vehicle=IDEAL, **options):
    """The states, status and message of a single faulty run."""
    problem = faulty_problem(controller, [1], momentum, vehicle)
    solution = engine_for(controller, block=1, **options).solve(problem)
    return solution.states[0], Status(solution.status[0]), solution.messages[0]


def creeps(fault, method):
    """Near the end of the solution these creep until they give up, or until the step limit."""
    return fault == "escape" and method in ("Radau", "LSODA")


@pytest.mark.parametrize(
    ("fault", "method"),
    [
        ("nan_after_one_second", "LSODA"),
        ("nan_at_once", "RK45"),
        pytest.param("rattling", "DOP853", marks=LONG),
        pytest.param("nan_after_one_second", "Radau", marks=LONG),
        pytest.param("escape", "DOP853", marks=LONG),
    ],
)
def test_failing_run_gets_a_status_and_harms_no_other(fault, method):
    """Four runs, the second of which fails; the first three are one block of three.

    A block that fails is redone run by run, and each run is then, bit for bit, what it is when it
    is solved alone by an engine with the same options.
    """
    controller, status = FAULTS[fault]
    problem = faulty_problem(controller, [0, 1, 0, 0])
    engine = engine_for(controller, method, max_steps=1500 if creeps(fault, method) else None)
    solution = engine.solve(problem)
    assert solution.status[1] in possible(fault, method, status)
    assert solution.messages[1]
    assert solution.status[[0, 2, 3]].tolist() == [Status.OK] * 3
    assert [solution.messages[run] for run in (0, 2, 3)] == [""] * 3
    for run in (0, 1, 2, 3):
        alone = engine.solve(problem.select(slice(run, run + 1)))
        assert np.array_equal(solution.states[run], alone.states[0], equal_nan=True)
        assert solution.steps[run] == alone.steps[0]
        assert solution.messages[run] == alone.messages[0]


def possible(fault, method, status):
    return (status, Status.STEP_LIMIT) if creeps(fault, method) else (status,)


def place_and_reason(message):
    """The time and the text of "t = … s: …"."""
    match = re.fullmatch(r"t = (\S+) s: (.+)", message)
    return float(match.group(1)), match.group(2)


def assert_known_up_to_the_failure(states, times, message):
    """Samples are complete before the failing step, and NaN throughout after the failure."""
    at, _ = place_and_reason(message)
    # A step of these methods and tolerances is shorter than half a second.
    assert np.isfinite(states[times < at - 0.5]).all()
    assert np.isnan(states[times > at]).all()


FAST = {"nan_after_the_start": "LSODA", "rattling": "BDF"}
"""The other faults have a fast test of their message, which looks at their samples, too."""
OWN_STEPS = ("DOP853", "Radau", "BDF", "LSODA")
"""The other explicit methods take their steps by the code of the first."""


@pytest.mark.parametrize(
    ("fault", "method"),
    [
        pytest.param(
            fault, method, marks=[LONG] * (fault != "nan_at_once" and FAST.get(fault) != method)
        )
        for fault in FAULTS
        for method in METHODS
        if method in OWN_STEPS or fault == "nan_at_once" or FAST.get(fault) == method
    ],
)
def test_failing_run_keeps_its_samples_up_to_the_failure(fault, method):
    """And has the status of its fault, with every way to take steps."""
    limit = 1500 if creeps(fault, method) else None
    states, status, message = solve_one(FAULTS[fault][0], method=method, max_steps=limit)
    assert status in possible(fault, method, FAULTS[fault][1])
    assert_known_up_to_the_failure(states, np.linspace(0.0, DURATION, SAMPLES), message)
    assert fault != "nan_at_once" or message == "t = 0 s: the vector field is not finite"


@pytest.mark.parametrize("method", METHODS)
def test_run_at_the_step_limit_keeps_its_samples(method):
    problem = paper_problem(runs=1, duration=4.0)
    engine = SolveIvp(method=method, rtol=1e-4, atol=1e-7, block=1, max_steps=100)
    solution = engine.solve(problem)
    assert (solution.status[0], solution.steps[0]) == (Status.STEP_LIMIT, 100)
    assert_known_up_to_the_failure(solution.states[0], problem.times, solution.messages[0])
    _, reason = place_and_reason(solution.messages[0])
    assert reason == "step limit: 100 evaluations (solver.max_steps)"


class InfiniteFromOneSecondOn(Force):
    def acting(self, G, t, Q, V):
        return np.where(t < 1.0, 0.0, np.inf) * V

    def instants(self, G, until):
        return np.array([1.0])


@pytest.mark.parametrize("method", METHODS)
def test_message_of_a_vector_field_that_is_not_finite_after_an_instant(method):
    problem = paper_problem(
        runs=1, duration=2.0, vehicle=Vehicle(forces=(InfiniteFromOneSecondOn(),))
    )
    solution = SolveIvp(method=method, rtol=1e-4, atol=1e-7).solve(problem)
    assert list(solution.status) == [Status.NON_FINITE]
    assert solution.messages == ["t = 1 s: the vector field is not finite"]


@pytest.mark.parametrize("method", METHODS)
def test_message_of_a_sampled_torque_that_is_not_finite(method):
    sampled = Vehicle(control=Sampling(period=0.05))
    _, status, message = solve_one(NotANumberAfterOneSecond, vehicle=sampled, method=method)
    assert status is Status.NON_FINITE
    assert message == "t = 1.05 s: the command is not finite"


@pytest.mark.parametrize(
    ("method", "controller"),
    [
        pytest.param("DOP853", NotANumberAfterOneSecond, marks=LONG),
        ("RK45", InfiniteAfterOneSecond),
        pytest.param("RK23", NotANumberAfterOneSecond, marks=LONG),
        pytest.param("Radau", NotANumberAfterOneSecond, marks=LONG),
        pytest.param("BDF", InfiniteAfterOneSecond, marks=LONG),
        ("LSODA", NotANumberAfterOneSecond),
    ],
)
def test_a_vector_field_that_is_no_longer_finite(method, controller):
    """Multistep and implicit methods notice it in the step that crosses t = 1."""
    states, status, message = solve_one(controller, method=method)
    assert status is Status.NON_FINITE
    at, reason = place_and_reason(message)
    assert reason == "the state or its derivative is no longer finite"
    if method in ("DOP853", "RK45", "RK23"):
        assert at == 1
        assert np.isfinite(states[:10]).all()  # t = 0 … 0.9
    assert 1 <= at < 1.5
    assert_known_up_to_the_failure(states, np.linspace(0.0, DURATION, SAMPLES), message)


@pytest.mark.parametrize(
    "method", ["RK45", pytest.param("DOP853", marks=LONG), pytest.param("RK23", marks=LONG)]
)
def test_refused_trial_steps_are_no_failure(method):
    """What fails is the escape, long after the last trial step that was not finite."""
    states, status, message = solve_one(NotANumberInTrialStepsThenEscaping, method=method)
    assert status is Status.SOLVER_FAILED
    assert_known_up_to_the_failure(states, np.linspace(0.0, DURATION, SAMPLES), message)
    at, reason = place_and_reason(message)
    assert reason == "Required step size is less than spacing between numbers"
    # From P = (½, ½, ½) at t = 1, within some hundred rtol.
    assert at == pytest.approx(1 + np.log(1 + 1 / 0.75) / 2, abs=1e-4)


# Progress -----------------------------------------------------------------------------------------


def test_progress_is_reported_along_the_way():
    reports = []
    SolveIvp(block=10).solve(paper_problem(runs=10, duration=5.0), progress=reports.append)
    assert max(reports) < 2  # no report of more than a fifth
    assert len(reports) <= 51  # one for every 2 % and the last


# Options ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rtol", "got"), [(1e-14, "1e-14"), (1.0, "1")], ids=["too_small", "too_large"]
)
def test_message_of_a_tolerance_that_scipy_cannot_use(rtol, got, noted):
    message = f"expected a number from 2.22e-14 (SciPy's smallest) to 1, got {got}"
    assert noted(SolveIvp(rtol=rtol)) == [("rtol", message)]
    assert noted(SolveIvp(rtol=SMALLEST_RTOL)) == []


@pytest.mark.ci("20 s of steps that get ever shorter")
@pytest.mark.filterwarnings("ignore:.*unstable wherever the reference is held")
def test_a_sampled_loop_that_diverges_ends(tmp_path):
    """Each period multiplies the velocity by 1 − kd·period/J = −4; one run begins at rest."""
    (tmp_path / "starts.csv").write_text("qx,qy,qz,qw,wx,wy,wz\n0,0,0,1,0.1,0,0\n0,0,0,1,0,0,0\n")
    found = eqt_cli.run(
        mapping(
            name="diverging",
            inertia=1.0,
            gains={"kp": 1e-6, "kd": 5.0},
            reference={"kind": "constant"},
            controllers=["eqt"],
            control={"period": 1.0},
            initial={"file": str(tmp_path / "starts.csv")},
            ensemble={"runs": 2},
            time={"duration": 20.0, "samples": 21},
            solver={"rtol": 1e-6, "engine": "solve_ivp", "cross_check": 0, "error_estimate": False},
        ),
        tmp_path / "r",
    )
    stored = eqt_cli.open_result(found).to_xarray()
    assert stored.status.values.tolist() == [[Status.DIVERGED, Status.BY_ROUNDING]]
    first = np.flatnonzero(np.abs(stored.velocity.values[0, 0, :, 0]) > np.pi)[0]
    assert stored.message_text[stored.message].values[0, 0] == f"t = {first} s: {DIVERGED[1]}"
    assert np.isfinite(stored.velocity.values[0, 0]).all(axis=1).tolist() == [
        k <= first for k in range(21)
    ]
    assert stored.steps.values[0, 0] < 50_000  # of 1,000,000


@pytest.mark.ci("stores results of whole runs")
@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
@pytest.mark.parametrize(("spin", "ends"), [(0.0, 0.32), (10.0, None)])
def test_a_body_that_turns_half_a_turn_in_a_period_ends_its_run(tmp_path, engine, spin, ends):
    """A torque of 100 N m turns it with 100 t rad/s, by π in 0.1 s from t = 0.314 s.

    It fails at the first sample behind that; not if the speed is less than ten times the first.
    """
    found = eqt_cli.run(
        mapping(
            name="spun",
            inertia=1.0,
            gains={"kp": 1e-6, "kd": 1e-6},
            reference={"kind": "constant"},
            controllers=["eqt"],
            control={"period": 0.1},
            plant={"forces": [{"kind": "constant", "force": [0, 0, 100.0]}]},
            initial={"velocity": {"kind": "fixed", "coordinates": [0, 0, spin]}},
            ensemble={"runs": 1},
            time={"duration": 0.8, "samples": 41},
            solver={"rtol": 1e-6, "engine": engine, "cross_check": 0, "error_estimate": False},
        ),
        tmp_path / "r",
    )
    stored = eqt_cli.open_result(found).to_xarray()
    message = "" if ends is None else f"t = {ends} s: {DIVERGED[1]}"
    assert stored.message_text[stored.message].values.tolist() == [[message]]


@pytest.mark.filterwarnings("ignore:.*unstable wherever the reference is held")
@pytest.mark.parametrize(("kp", "turns"), [(3.7e4, "integrated"), (3.8e4, "diverged")])
def test_a_command_that_turns_a_body_ten_thousand_times_ends_its_run(tmp_path, kp, turns):
    """About one axis, the torque is 2 kp sin(1), and after a period V = 2 kp sin(1) rad/s."""
    found = eqt_cli.run(
        mapping(
            name="ahead",
            inertia=1.0,
            gains={"kp": kp, "kd": 1.0},
            reference={"kind": "constant"},
            controllers=["eqt"],
            control={"period": 1.0},
            initial={"pose": {"kind": "angle", "angle": 1.0, "axis": [0, 0, 1]}},
            ensemble={"runs": 1},
            time={"duration": 2.0, "samples": 3},
            solver={"rtol": 1e-6, "engine": "solve_ivp", "cross_check": 0, "max_steps": 100},
        ),
        tmp_path / "r",
    )
    stored = eqt_cli.open_result(found).to_xarray()
    [[status]] = stored.status.values
    assert status == (Status.DIVERGED if turns == "diverged" else Status.STEP_LIMIT)


# x ------------------------------------------------------------------------------------------------


RTOL = 1e-9

solve = partial(
    solve_ivp.solve, events=lambda t, y: 1.0, first_step=None, rtol=RTOL, atol=1e-3 * RTOL
)


def test_samples_within_and_at_the_ends_of_steps():
    times = np.linspace(0.5, 20.0, 778)
    exact = np.array([np.sin(times), np.cos(times)])
    found = solve(lambda t, y: np.array([y[1], -y[0]]), (0.5, 20.0), exact[:, 0], t_eval=times)
    # The error of the phase grows by at most about rtol in each of some thirty steps.
    np.testing.assert_allclose(found.y, exact, rtol=0, atol=30 * RTOL)
    ends = solve(lambda t, y: np.array([y[1], -y[0]]), (0.5, 20.0), exact[:, 0], t_eval=None)
    np.testing.assert_array_equal(ends.y, found.y[:, [0, -1]])


def test_steps_follow_the_relative_error_at_any_scale():
    times = np.linspace(0.0, 5.0, 26)
    start = np.array([1.0, 0.5])

    def solved(scale: float) -> np.ndarray:
        return solve(
            lambda t, y: np.array([y[1], -y[0]]),
            (0.0, 5.0),
            scale * start,
            t_eval=times,
            atol=scale * 1e-12,
        ).y

    # A power of two scales every product exactly.
    np.testing.assert_array_equal(solved(1024.0), 1024.0 * solved(1.0))


def test_a_solution_without_end_needs_ever_smaller_steps():
    with np.errstate(all="ignore"):
        found = solve(lambda t, y: y * y, (0.0, 2.0), np.ones(1), t_eval=None)
    assert (found.status, found.message) == (-1, "the step size is too small")
