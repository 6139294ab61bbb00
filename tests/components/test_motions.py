"""References as motions: each kind against its own definition, on every group, by both engines."""

from functools import reduce

import numpy as np
import pytest
from case_tables import in_ci, refusal
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from small_loops import closed_loop, expressions

from eqt_cli.base.errors import InputError, Problems
from eqt_cli.components import motions
from eqt_cli.components.inertia import FactoredInertia, PrescribedInertia
from eqt_cli.components.motions import spline
from eqt_cli.components.references import (
    ConstantReference,
    PathFactor,
    PathReference,
    RatesReference,
    Reference,
    SlewReference,
    TorqueReference,
)
from eqt_cli.components.waypoints import Waypoint, WaypointsReference
from eqt_cli.engines.engine import Problem, engines
from eqt_cli.extend import frobenius, group_named, norm

GROUPS = ("SO3", "SE3", "SE23", "SE2", "SE3*SO2")
KINDS = ("path", "slew", "waypoints", "rates")
TIMES = np.linspace(0.0, 6.0, 61)
KNOTS = np.array([0.0, 1.0, 1.5, 3.0, 3.2, 5.0, 6.0])
DEFINITION = 1e-8
RTOL = 1e-9
# Two thirds of a digit to spare over what the trajectories of these loops amplify.
ON_REFERENCE = 100 * RTOL
BY = ("0.3*sin(t)", "0.05*t**2 - 0.1", "smoothstep(t, 1, 3)")


@pytest.fixture(params=GROUPS)
def G(request):
    return group_named(request.param)


# What is compiled knows no group.
on_engines = pytest.mark.parametrize(
    ("G", "engine"),
    [
        ("SO3", "native"),
        ("SE3*SO2", "solve_ivp"),
        *(in_ci("a product has their parts", name, "solve_ivp") for name in GROUPS[:-1]),
    ],
    indirect=["G"],
)


def axes(G):
    return np.random.default_rng(3).standard_normal((3, G.dimension))


def poses(G, step=0.5):
    random, found = np.random.default_rng(4), [G.identity]
    for _ in KNOTS[1:]:
        found.append(found[-1] @ G.exp(step * random.standard_normal(G.dimension)))
    return np.array(found)


def reference(kind, G):
    if kind == "path":
        factors = [PathFactor(list(axis), by) for axis, by in zip(axes(G), BY, strict=True)]
        found = PathReference(factors, pose=poses(G)[1].tolist())
    elif kind == "slew":
        ends = {"from_": poses(G)[1].tolist(), "to": poses(G)[3].tolist()}
        found = SlewReference(**ends, start=1.0, duration=3.0)
    elif kind == "waypoints":
        points = zip(KNOTS, poses(G), strict=True)
        found = WaypointsReference([Waypoint(float(t), Q.tolist()) for t, Q in points])
    else:
        found = RatesReference([f"0.3*cos({k + 1}*t)" for k in range(G.dimension)])
    problems = Problems()
    found.check(G, problems)
    assert not list(problems)
    return found


def on_reference(loop, engine, times=TIMES):
    """The states of a run that starts on its reference."""
    G = loop.group
    Qd, Vd = loop.reference.initial(G, G.identity, np.zeros(G.dimension))
    problem = Problem(loop, loop.initial_state(Qd, Vd, Qd, Vd)[None], times)
    solution = engines.get(engine)(rtol=RTOL).solve(problem)
    assert solution.messages == [""]
    return loop.tracking(times, solution.states)


# Against the definitions --------------------------------------------------------------------------


def test_path_is_the_product_of_its_exponentials(G):
    t = np.random.default_rng(0).uniform(0.0, 6.0, 20)
    s = np.clip((t - 1) / 2, 0, 1)
    amounts = (0.3 * np.sin(t), 0.05 * t**2 - 0.1, s * s * (3 - 2 * s))
    expected = poses(G)[1]
    for axis, a in zip(axes(G), amounts, strict=True):
        expected = expected @ expm(a[:, None, None] * G.hat(axis))
    found, _, _ = reference("path", G).motion(G, t)
    np.testing.assert_allclose(found, expected, rtol=0, atol=DEFINITION)


def test_slew_is_the_geodesic_and_rests_at_both_ends(G):
    slew, (start, end) = reference("slew", G), poses(G)[[1, 3]]
    Q, V, V_dot = slew.motion(G, np.array([0.0, 0.5, 1.0, 4.0, 5.0]))
    np.testing.assert_allclose(Q, [start] * 3 + [end] * 2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(V, 0, atol=1e-12)
    np.testing.assert_allclose(V_dot, 0, atol=1e-12)
    turn = G.log(np.linalg.inv(start) @ end)
    middle, _, _ = slew.motion(G, 2.5)
    np.testing.assert_allclose(middle, start @ expm(G.hat(turn / 2)), rtol=0, atol=DEFINITION)


def test_waypoints_are_met(G):
    Q, _, _ = reference("waypoints", G).motion(G, KNOTS)
    np.testing.assert_allclose(Q, poses(G), rtol=0, atol=DEFINITION)


def test_waypoints_are_met_without_a_jump_of_the_acceleration(G):
    spline = reference("waypoints", G)
    # Nearer than that, the piece that begins is taken on either side. What changes meanwhile is
    # 2e-9 s of the next derivative, up to five times as large: 1e-8.
    left, right = (spline.motion(G, KNOTS[1:-1] + side) for side in (-1e-9, 1e-9))
    for before, after in zip(left, right, strict=True):
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-7 * np.abs(after).max())


def test_waypoints_end_without_acceleration(G):
    _, _, V_dot = reference("waypoints", G).motion(G, KNOTS[[0, -1]])
    np.testing.assert_allclose(V_dot, 0, atol=DEFINITION)


def test_waypoints_begin_and_end_with_their_first_and_last():
    G = group_named("SO3")
    assert reference("waypoints", G).ends(G) == (KNOTS[0], KNOTS[-1])


def test_a_spline_is_found_in_either_direction_and_size():
    """The steps of Newton's method are small against the velocities, whatever their sign."""
    G, times = group_named("R3"), np.array([0.0, 1.0, 2.5, 4.0])
    along = np.array([[1.0, 2.0, 3.0], [2.0, 3.0, 5.0], [3.5, 7.0, 8.0], [6.0, 9.0, 9.5]])
    there, back, tiny = (spline(G, times, G.exp(size * along)) for size in (1, -1, 1e-20))
    assert back.numbers == pytest.approx(-there.numbers, abs=1e-12)
    assert tiny.numbers == pytest.approx(1e-20 * there.numbers, rel=1e-9, abs=1e-40)


def test_in_a_vector_space_one_iteration_finds_the_spline(monkeypatch):
    """And a second or a third sees that nothing changes any more but for rounding."""
    monkeypatch.setattr(motions, "MAX_ITERATIONS", 3)
    G, times = group_named("R1"), np.array([0.0, 1.0, 2.0, 4.0])
    pieces = spline(G, times, G.exp(np.array([[0.0], [1.0], [4.0], [2.0]])))
    assert len(pieces.starts) == 3


def jumps(G, times, pieces):
    """The largest jump of pose, velocity and acceleration where pieces meet, and these."""
    inner = times[1:-1]
    before, after = (
        pieces.piece(*pieces.at(inner + side)).motion_within(G, inner) for side in (-1e-6, 1e-6)
    )
    found = [np.abs(one - other).max() for one, other in zip(before, after, strict=True)]
    return np.array(found), np.array([np.abs(part).max() for part in after])


@pytest.mark.parametrize(
    ("any_turns", "bound"),
    [
        (False, 1e-12),
        (True, 1e-8),  # poses so far apart that rounding ends Newton's method early
    ],
)
def test_a_spline_is_found_up_to_rounding(any_turns, bound):
    G, times = group_named("SO3"), np.arange(8.0)
    random = np.random.default_rng(0)
    if any_turns:
        poses = G.exp(random.uniform(-3.1, 3.1, (8, 3)))
    else:
        steps = G.exp(random.standard_normal((8, 3)))
        poses = np.array([reduce(np.matmul, steps[: k + 1]) for k in range(8)])
    pieces = spline(G, times, poses)
    found, sizes = jumps(G, times, pieces)
    assert (found < bound * sizes).all()
    Q, _, _ = pieces.motion(G, times)
    np.testing.assert_allclose(Q, poses, rtol=0, atol=1e-12)


def test_poses_that_no_smooth_motion_is_found_through():
    G, random = group_named("SO3"), np.random.default_rng(0)
    times = np.cumsum(np.random.default_rng(0).uniform(0.01, 3, 6))
    poses = G.exp(random.uniform(-3.1, 3.1, (6, 3)))
    assert refusal(InputError, spline, G, times, poses) == (
        "no smooth motion was found through these poses; give more where they turn"
    )


def test_waypoints_in_a_vector_space_are_the_natural_cubic_spline():
    G = group_named("R3")
    t = np.linspace(0.0, 6.0, 50)
    expected = CubicSpline(KNOTS, G.log(poses(G)), bc_type="natural")
    Q, V, V_dot = reference("waypoints", G).motion(G, t)
    for found, order in ((G.log(Q), 0), (V, 1), (V_dot, 2)):
        np.testing.assert_allclose(found, expected(t, order), rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", KINDS[:3])
def test_velocity_and_acceleration_are_derivatives(G, kind):
    motion, h = reference(kind, G).motion, 1e-3
    t = np.random.default_rng(0).uniform(0.01, 5.99, 60)
    instants = [*KNOTS, 4.0]
    t = t[(np.abs(t[:, None] - instants) > 2 * h).all(axis=1)]
    Q, V, V_dot = motion(G, t)
    at = {k: motion(G, t + k * h) for k in (-2, -1, 1, 2)}

    def rate(part):
        outer, inner = at[2][part] - at[-2][part], at[1][part] - at[-1][part]
        return (8 * inner - outer) / (12 * h)

    # Five points: h⁴|f⁽⁵⁾|/30, the pieces of a spline being polynomials of large coefficients.
    scale = np.abs(V_dot).max() + 1
    np.testing.assert_allclose(G.vee(np.linalg.inv(Q) @ rate(0)), V, rtol=0, atol=1e-8 * scale)
    np.testing.assert_allclose(rate(1), V_dot, rtol=0, atol=1e-7 * scale)


def after_rates(G, t, steps):
    """By the exponential midpoint rule, whose error is even in h: without h², h⁴ is left."""
    h = t / steps
    middles = (np.arange(steps) + 0.5)[:, None] * h
    V = 0.3 * np.cos(np.arange(1, G.dimension + 1) * middles)
    return reduce(np.matmul, expm(h * G.hat(V)))


@on_engines
def test_rates_are_integrated(G, engine):
    times = TIMES[:11]
    s = on_reference(closed_loop(G, reference=reference("rates", G)), engine, times)
    coarse, fine = (after_rates(G, TIMES[1], steps) for steps in (20, 40))
    np.testing.assert_allclose(s.Qd[0, 1], (4 * fine - coarse) / 3, rtol=0, atol=DEFINITION)
    expected = 0.3 * np.cos(np.arange(1, G.dimension + 1) * times[:, None])
    np.testing.assert_allclose(s.Vd[0], expected, rtol=0, atol=1e-12)


def test_a_span_that_begins_a_rounding_early_takes_the_piece_that_begins(G):
    """Engines take a knot for the sample time that it is but for rounding: 0.3 for 3 · 0.1."""
    found = reference("waypoints", G)
    for knot in KNOTS[1:-1]:
        assert found.held(G, np.nextafter(knot, 0)).since == knot
        assert found.held(G, knot - 1e-6).since < knot


@pytest.mark.parametrize("start", [-1e6, 1e6])
def test_so_it_does_far_from_0(start):
    """Where the rounding of a time is 1e-10 s."""
    G, times = group_named("R1"), start + np.array([0.0, 1.0, 2.0])
    pieces = spline(G, times, G.exp(np.array([[0.0], [1.0], [4.0]])))
    since, _ = pieces.at(np.array([np.nextafter(times[1], -np.inf), times[1] - 1e-4]))
    assert since.tolist() == times[[1, 0]].tolist()


# In the loop --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "engine"), [*((kind, "solve_ivp") for kind in KINDS), ("waypoints", "native")]
)
def test_a_run_that_starts_on_its_reference_stays_there(kind, engine):
    G = group_named("SO3" if engine == "native" else "SE23")  # what is compiled knows no group
    s = on_reference(closed_loop(G, reference=reference(kind, G)), engine, TIMES[:33])
    assert frobenius(s.Q - s.Qd).max() < ON_REFERENCE
    assert norm(s.V_tilde).max() < ON_REFERENCE


def test_so_it_does_with_an_inertia_that_varies():
    G = group_named("SO3")
    rows = [["1 + 0.2*sin(t)", "0", "0"], ["0.1*sin(t)", "1", "0"], ["0", "0", "exp(-0.1*t)"]]
    factor = expressions(rows)
    inertia = FactoredInertia(np.diag([1.0, 2.0, 3.0]), factor)
    s = on_reference(closed_loop(G, reference=reference("path", G), inertia=inertia), "solve_ivp")
    assert norm(s.V_tilde).max() < ON_REFERENCE


def test_velocities_that_a_reference_knows_are_its_own():
    """And not those of the momentum that an inertia makes of them, which are rounded twice."""
    G = group_named("SE3")
    found = reference("path", G)
    loop = closed_loop(G, reference=found)
    state = loop.initial_state(*[G.identity, np.zeros(G.dimension)] * 2)
    s = loop.tracking(2.2, state[None])
    _, V, V_dot = found.motion(G, 2.2)
    np.testing.assert_array_equal(s.Vd, V[None])
    np.testing.assert_array_equal(s.Vd_dot, V_dot[None])


@pytest.mark.parametrize(
    ("kind", "stretches"),
    [("path", []), ("slew", []), ("waypoints", []), ("rates", ["desired_pose"])],
)
def test_state_holds_no_more_of_the_reference_than_is_integrated(G, kind, stretches):
    lengths = closed_loop(G, reference=reference(kind, G)).layout.lengths
    assert [name for name in lengths if name.startswith("desired")] == stretches


# A reference that a torque drives ---------------------------------------------------------------


class Spin(Reference):
    """Turns about the first axis at a rate that grows."""

    name = "spin"

    def driving_torque(self, G, inertia, t, Pd):
        return inertia.momentum(np.eye(G.dimension)[0]) * 0.5 - G.ad_star(inertia.velocity(Pd), Pd)


@on_engines
def test_a_reference_that_a_torque_drives_is_integrated(G, engine):
    s = on_reference(closed_loop(G, reference=Spin()), engine)
    expected = 0.5 * TIMES[:, None] * np.eye(G.dimension)[0]
    np.testing.assert_allclose(s.Vd[0], expected, rtol=0, atol=ON_REFERENCE)


# Known instants -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "engine"),
    [
        ("step(t, 1.25)", "native"),
        ("where(t <= 1.25, 0, 1)", "solve_ivp"),
        ("where(4*t > 5, 1, 0)", "solve_ivp"),
    ],
)
def test_a_torque_that_steps_is_integrated_exactly(engine, text):
    """A momentum under a constant torque from t = 1.25 s on, in a vector space.

    A side changes 1e-12 behind its instant, relative to what is compared.
    """
    G = group_named("R1")
    s = on_reference(closed_loop(G, reference=TorqueReference([text])), engine)
    np.testing.assert_allclose(s.Pd[0, :, 0], np.maximum(TIMES - 1.25, 0), rtol=0, atol=1e-11)


def test_spans_hold_every_sample_once():
    G = group_named("SO3")
    loop = closed_loop(G, reference=reference("waypoints", G))
    state = loop.initial_state(G.identity, np.zeros(3), G.identity, np.zeros(3))
    for times in (TIMES, np.array([0.0, 6.0]), np.array([0.3, 1.0, 1.2, 5.5])):
        spans = Problem(loop, state[None], times).spans
        held = [span.grid[1 - span.sampled_start : 1 + span.later] for span in spans]
        np.testing.assert_array_equal(np.concatenate(held), times)
        firsts = [times[span.first : span.first + span.later] for span in spans]
        later = [span.grid[1 : 1 + span.later] for span in spans]
        np.testing.assert_array_equal(np.concatenate(firsts), np.concatenate(later))
        assert [span.start for span in spans][1:] == [span.stop for span in spans][:-1]
        # What is constant within a span is asked for inside of it, but at the ends of the horizon.
        inside = [(span.start < span.within[0], span.within[1] < span.stop) for span in spans]
        assert inside == [(span is not spans[0], span is not spans[-1]) for span in spans]


def test_a_horizon_without_instants_is_one_span():
    G = group_named("SO3")
    loop = closed_loop(G, reference=TorqueReference(["cos(t)", "sin(t)", 0.0]))
    state = loop.initial_state(G.identity, np.zeros(3), G.identity, np.zeros(3))
    [span] = Problem(loop, state[None], TIMES).spans
    np.testing.assert_array_equal(span.grid, TIMES)
    assert (span.first, span.later, span.sampled_start) == (1, len(TIMES) - 1, True)


def test_step_limit_counts_the_steps_of_all_spans():
    G = group_named("SO3")
    loop = closed_loop(G, reference=reference("waypoints", G))
    Qd, Vd = loop.reference.initial(G, G.identity, np.zeros(3))
    problem = Problem(loop, loop.initial_state(Qd, Vd, Qd, Vd)[None], TIMES)
    solution = engines.get("native")(max_steps=12).solve(problem)
    assert solution.status[0] == 3
    assert solution.steps[0] == 12
    assert np.isfinite(solution.states[0, 0]).all()
    assert np.isnan(solution.states[0, -1]).all()


# Degrees ------------------------------------------------------------------------------------------


def test_a_factor_in_degrees_is_that_in_radians():
    G, t = group_named("SO3"), np.linspace(0, 3, 7)
    one, other = (
        PathReference([PathFactor("wz", by)]) for by in ("30*t + 5 deg", "(30*t + 5)*pi/180")
    )
    for left, right in zip(one.motion(G, t), other.motion(G, t), strict=True):
        np.testing.assert_array_equal(left, right)


def test_degrees_are_none_along_an_axis_that_moves(noted):
    path, said = PathReference([PathFactor("vx", "2 deg")]), "expected a length in m, cm, mm or km"
    assert noted(path, group_named("SE3")) == [("factors[0].by", f"{said}, got '2 deg'")]


# A reference that keeps its velocity --------------------------------------------------------------


def test_a_constant_reference_takes_the_change_of_a_varying_inertia_as_well():
    """τ_d = 𝕀̇ω + ω × 𝕀ω at constant ω."""
    w, t = np.array([0.3, 0.2, -0.1]), 0.7
    rows = [["2 + t**2", "0", "0"], ["0", "3", "t"], ["0", "t", "5"]]
    law, reference = PrescribedInertia(expressions(rows)), ConstantReference(velocity=w.tolist())
    matrix = np.array([[2 + t**2, 0, 0], [0, 3, t], [0, t, 5]])
    change = np.array([[2 * t, 0, 0], [0, 0, 1], [0, 1, 0]])
    found = reference.desired(group_named("SO3"), law.at(t), t, None, None).tau
    assert found == pytest.approx(change @ w + np.cross(w, matrix @ w), rel=1e-12)
