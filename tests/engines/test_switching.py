"""Laws with kinks and jumps in the compiled engine: every switch is found, and none is invented.

Kinks make solve_ivp refuse steps until they are short, and its errors there are far above rtol; so
the exact solutions, where there are any, are the judges, and otherwise solve_ivp on an interval
cut so fine that every step is far shorter than what happens between two kinks.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.engines.library import with_comparison_sides
from eqt_cli.engines.native import STEP_SHARE, Native
from eqt_cli.extend import (
    ClosedLoop,
    ConstantReference,
    Controller,
    Gains,
    Inertia,
    Problem,
    SolveIvp,
    Status,
    absolute,
    clip,
    cos,
    group_named,
    less,
    maximum,
    minimum,
    norm,
    parse,
    sin,
    smooth_less,
    where,
)
from eqt_cli.numbers.program import traced

TOL = 1e-10


@dataclass(frozen=True)
class Law(Controller):
    """A law that is given as a function."""

    name: ClassVar[str] = "own"

    law: object = None
    limit: float = 0.5

    def torque(self, s):
        return self.law(s, self)


def problem_of(law, group="SO2", velocities=(1.0,), duration=3.0, samples=31, limit=0.5):
    """Runs from the identity with given velocities, unit inertia, and a target at rest."""
    G = group_named(group)
    m, d = G.dimension, G.size
    eye = np.eye(m)
    loop = ClosedLoop(
        G, Inertia(eye, eye), Gains(np.eye(d), eye), ConstantReference(), Law(law, limit)
    )
    V = np.atleast_2d(np.array(velocities, dtype=float)).reshape(-1, m)
    states = loop.initial_state(np.eye(d), V, np.eye(d), np.zeros(m))
    return Problem(loop, states, np.linspace(0.0, duration, samples))


def velocity(problem, solution):
    """V of every run at the sample times."""
    return problem.loop.tracking(problem.times, solution.states).V


def engine_of(tol=TOL):
    """The compiled engine with this tolerance of a step."""
    return Native(rtol=tol / STEP_SHARE, atol=tol / STEP_SHARE, max_steps=2000)


@pytest.fixture
def solved():
    """Solve a problem of which no run may fail."""

    def solved(problem, tol=TOL):
        solution = engine_of(tol).solve(problem)
        assert solution.messages == [""] * problem.runs
        return solution

    return solved


@pytest.fixture
def assert_velocity(solved):
    """V of one run is what it must be, up to the tolerance; `exact` takes the sample times."""

    def assert_velocity(law, exact, **given):
        problem = problem_of(law, **given)
        V = velocity(problem, solved(problem))[0, :, 0]
        np.testing.assert_allclose(V, exact(problem.times), rtol=0, atol=10 * TOL)

    return assert_velocity


# Against exact solutions --------------------------------------------------------------------------


def test_saturation(assert_velocity):
    """V̇ = clip(−V, ±½): straight down to V = ½, exponential from there."""
    assert_velocity(
        lambda s, own: clip(-s.V, -own.limit, own.limit),
        lambda t: np.where(t < 3, 2 - t / 2, np.exp(3 - t) / 2),
        velocities=[2.0],
        duration=6.0,
    )


@pytest.mark.parametrize(
    "size", [absolute, lambda V: norm(V)[..., None]], ids=["absolute", "norm of one component"]
)
def test_absolute_value(assert_velocity, size):
    """V̇ = −|V| − 1 through V = 0, at t = log 2 from V = 1."""
    exact = lambda t: np.where(t < np.log(2), 2 * np.exp(-t) - 1, 1 - np.exp(t) / 2)  # noqa: E731
    assert_velocity(lambda s, law: -size(s.V) - 1, exact, duration=1.5)


def test_jump_in_time(assert_velocity):
    """V̇ = 1 until t = 1.3, 3 from then on."""
    assert_velocity(
        lambda s, law: where(less(s.t, 1.3), 1.0, 3.0) + 0 * s.V,
        lambda t: 1 + t + 2 * np.maximum(t - 1.3, 0),
    )


def test_an_angle_that_wraps(assert_velocity):
    """V̇ = atan2(sin t, cos t): t until π, and t − 2π from there."""
    angle = parse("atan2(sin(t), cos(t))")
    assert_velocity(
        lambda s, law: angle.evaluate({"t": s.t}) + 0 * s.V,
        lambda t: 1 + t**2 / 2 - 2 * np.pi * np.maximum(t - np.pi, 0),
        duration=5.0,
    )


@pytest.mark.parametrize(("compare", "shortened"), [(less, True), (smooth_less, False)])
def test_no_step_ends_where_only_the_form_of_a_function_changes(compare, shortened, solved):
    """V̇ = sin² t in two forms that change places at every zero of sin 9t."""

    def law(s, own):
        return where(compare(sin(9 * s.t), 0.0), sin(s.t) ** 2, 1 - cos(s.t) ** 2) + 0 * s.V

    problem = problem_of(law)
    solution = solved(problem)
    t, V = problem.times, velocity(problem, solution)[0, :, 0]
    np.testing.assert_allclose(V, 1 + t / 2 - np.sin(2 * t) / 4, rtol=0, atol=10 * TOL)
    plain = solved(problem_of(lambda s, own: sin(s.t) ** 2 + 0 * s.V))
    assert (solution.steps > plain.steps).all() == shortened


def test_no_step_ends_where_nothing_follows_from_a_comparison(solved):
    """V̇ = sin² t, whatever the sign of sin 9t is."""

    def law(s, own):
        turned = sin(9 * s.t)
        where(less(turned, 0.0), s.V, turned)
        return sin(s.t) ** 2 + where(less(turned, 0.0), 0 * s.V, 0 * turned)

    plain = solved(problem_of(lambda s, own: sin(s.t) ** 2 + 0 * s.V))
    assert (solved(problem_of(law)).steps == plain.steps).all()


def test_side_that_changes_with_the_form_of_a_function_is_right_on_each(assert_velocity):
    """V̇ jumps from 2 to −2 at t = 2; what is compared changes its sign at t = 1 without a jump."""

    def law(s, own):
        turned = where(smooth_less(s.t, 1.0), 1.0, -1.0)
        wanted = where(less(turned * (2.0 - s.t), 0.0), -1.0, 1.0)
        return 2 * turned * wanted + 0 * s.V

    assert_velocity(law, lambda t: 1 + 2 * np.minimum(t, 2) - 2 * np.maximum(t - 2, 0))


def test_jump_that_sets_off_another(assert_velocity):
    """At t = 1 one comparison jumps from 1 to −1, so that another changes without a crossing."""

    def law(s, own):
        sign = where(less(s.t, 1.0), 1.0, -1.0)
        return where(less(0.0, sign), 0.0, 2.0) + 0 * s.V

    assert_velocity(law, lambda t: 1 + 2 * np.maximum(t - 1, 0))


def test_start_on_a_kink(assert_velocity):
    """V̇ = ±1 with the sign of t − V … which both sides leave at once."""
    law = lambda s, own: where(less(s.V, 0.0), -1.0, 1.0)  # noqa: E731 shorter than a function
    assert_velocity(law, lambda t: t, velocities=[0.0])


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_scale_of_the_compared_quantities_does_not_matter(factor, solved):
    """Neither to where the switch is found nor to the accuracy of the states."""

    def law(s, own):
        return minimum(factor * s.V, factor * (0.5 + sin(3 * s.t))) / factor

    plain = problem_of(lambda s, own: minimum(s.V, 0.5 + sin(3 * s.t)))
    scaled = problem_of(law)
    np.testing.assert_allclose(
        solved(scaled).states, solved(plain, tol=1e-13).states, rtol=0, atol=100 * TOL
    )


def test_comparison_with_something_infinite(solved):
    """‖u‖ = 0 at the start, where the limit ½/‖u‖ is infinite."""

    def law(s, own):
        u = 3 * (sin(s.t) - s.V)
        return u * minimum(1.0, own.limit / norm(u))[..., None]

    def literal(s, own):  # the same without a norm: one component
        return clip(3 * (sin(s.t) - s.V), -own.limit, own.limit)

    ours, theirs = (problem_of(each, velocities=[0.0]) for each in (law, literal))
    np.testing.assert_allclose(solved(ours).states, solved(theirs).states, rtol=0, atol=100 * TOL)


def test_equal_quantities_do_not_switch(solved):
    """On the reference every error is 0, at all times."""
    problem = problem_of(
        lambda s, law: -absolute(s.V_tilde) - clip(s.V_tilde, 0.0, 1.0), velocities=[0.0]
    )
    assert solved(problem).steps[0] < 10


# Against solve_ivp --------------------------------------------------------------------------------


def saturated_vector(s, own):
    u = -3 * s.V - s.gradient
    return u * minimum(1.0, own.limit / norm(u))[..., None]


LAWS = {
    "components": lambda s, own: clip(-3 * s.V - s.gradient, -own.limit, own.limit),
    "vector": saturated_vector,
    "dead_zone": lambda s, own: -s.V + maximum(minimum(s.V, own.limit), -own.limit) - s.gradient,
    "both_ways": lambda s, own: minimum(s.V, 0.2) + 2 * maximum(0.2, s.V) - 3 * s.V - s.gradient,
    "pulses": lambda s, own: absolute(sin(5 * s.t)) * s.V * 0.1 - s.gradient - s.V,
    "relay": lambda s, own: where(less(cos(4 * s.t), 0.3), 1.0, -1.0) - s.V - s.gradient,
}


AGAIN = pytest.mark.ci("its kinks and jumps have fast tests against exact solutions")


@pytest.fixture(
    scope="module",
    params=[
        name if name in ("vector", "dead_zone") else pytest.param(name, marks=AGAIN)
        for name in LAWS
    ],
)
def by_short_steps(request):
    """A problem and its solution by solve_ivp, which starts anew every 20 ms."""
    velocities = np.random.default_rng(3).standard_normal((1, 3))
    problem = problem_of(LAWS[request.param], "SE2", velocities, duration=0.7, samples=141)
    theirs = SolveIvp(rtol=1e-10, atol=1e-13, block=1)
    states = problem.states[:, None]
    for start in range(0, 140, 4):
        part = Problem(problem.loop, states[:, -1], problem.times[start : start + 5])
        states = np.concatenate([states, theirs.solve(part).states[:, 1:]], axis=1)
    return problem, states


def test_engines_agree(by_short_steps, solved):
    problem, states = by_short_steps
    # Measured up to 3e-8 where a jump lies inside one of those steps.
    np.testing.assert_allclose(solved(problem).states, states, rtol=0, atol=1e-6)


# What a run's numbers depend on -------------------------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_runs_are_bit_identical_in_any_company(name, solved):
    velocities = np.random.default_rng(5).standard_normal((19, 3))
    problem = problem_of(LAWS[name], "SE2", velocities, samples=7)
    whole = solved(problem)
    order = np.random.default_rng(6).permutation(problem.runs)
    for runs, workers in ((order, 1), (np.arange(19), 2), (np.arange(19), 3), (np.array([11]), 1)):
        part = engine_of().solve(problem.select(runs), workers)
        assert np.array_equal(part.states, whole.states[runs])
        assert np.array_equal(part.steps, whole.steps[runs])


def test_tolerance_is_kept_and_a_tenth_of_it_estimates_the_error(solved):
    velocities = np.random.default_rng(7).standard_normal((12, 3))
    problem = problem_of(LAWS["vector"], "SE2", velocities, duration=6.0)
    exact = solved(problem, tol=1e-14).states
    loose, tight = (solved(problem, tol=tol).states for tol in (1e-7, 1e-8))
    errors = np.abs(loose - exact).max(axis=(1, 2))
    assert errors.max() < 100 * 1e-7
    estimates = np.abs(loose - tight).max(axis=(1, 2))
    assert np.mean((estimates > errors / 2) & (estimates < 2 * errors)) > 0.8


# Laws that cannot be followed ---------------------------------------------------------------------


def test_sliding_mode_is_a_failure_and_harms_no_other():
    """V̇ = −sign V: nothing goes on from V = 0, which the second run reaches at t = 1."""
    problem = problem_of(
        lambda s, law: -where(less(s.V, 0.0), -1.0, 1.0), velocities=[9.0, 1.0, -9.0], samples=7
    )
    solution = engine_of().solve(problem)
    assert solution.status.tolist() == [Status.OK, Status.SOLVER_FAILED, Status.OK]
    assert solution.messages[1] == (
        "t = 1 s: the law switches back and forth without end; smooth it, as with tanh"
    )
    np.testing.assert_allclose(velocity(problem, solution)[1, :3, 0], [1.0, 0.5, 0.0], atol=1e-8)
    assert np.isnan(solution.states[1, 3:]).all()
    alone = engine_of().solve(problem.select([0, 2]))
    assert np.array_equal(alone.states, solution.states[[0, 2]])


@pytest.mark.needs("export")
def test_the_sides_of_comparisons_are_inputs_and_outputs():
    """Each a < b is replaced by the sign of its side; a and b are given back in the same order."""
    from eqt_cli.extensions.export.program_error import bounded

    def function(given):
        a, b, c = given["x"]
        first = where(less(a, b), 10.0, 20.0)[()]
        return {"y": np.array([first + where(less(c, a), 1.0, 2.0)[()]], dtype=object)}

    program, count = with_comparison_sides(traced(function, {"x": 3}))
    assert count == 2
    for sides in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
        inputs = {"x": np.array([2.0, 3.0, 5.0]), "sides": np.array(sides)}
        left, right, [[y]] = (bounded(program, inputs)[n].values for n in ("left", "right", "y"))
        side = dict(zip(zip(*left, *right, strict=True), sides, strict=True))
        assert y == (10 if side[2.0, 3.0] < 0 else 20) + (1 if side[5.0, 2.0] < 0 else 2)
