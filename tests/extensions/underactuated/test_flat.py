"""Feasible motions of bodies that are pushed along one axis."""

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from said import mentions
from scipy.interpolate import PPoly

from eqt_cli.components.motions import PlantModel
from eqt_cli.extend import Drag, EqtError, Inertia, Problems, Restoring, group_named
from eqt_cli.extensions.underactuated.flat import FlatReference, Knot, _smallest

MASS, WEIGHT = 2.0, 19.62
GROUPS = {name: group_named(name) for name in ("SE2", "SE3")}
KNOTS = [(0.0, [0, 0, 0]), (1.0, [1, 0, 1]), (2.5, [1, 1, 0.5]), (4.0, [0, 0, 1])]
POINTS = [(0, [0, 0, 0]), (1, [0.3, 0.2, 0.1]), (2.2, [0.1, 0.2, 0.3])]
ALONG = {"SE2": [0.0, 1.0], "SE3": [0.0, 0.0, 1.0]}


def options(way, n):
    """Options of a reference, and of its heading in space."""
    found = {
        "helix": {"position": ["0.4*t", "0.4*sin(pi*t)", "0.6*cos(pi*t)"][-n:]},
        "ahead": {"position": ["2*sin(t)", "-cos(t)", "0.3*t"][:n]},
        "minimum snap": {"minimum_snap": [Knot(t, p[:n]) for t, p in KNOTS]},
        "waypoints": {
            "of": {
                "kind": "waypoints",
                "points": [{"t": t, "pose": {"position": p[:n]}} for t, p in POINTS],
            }
        },
        "path": {
            "of": {
                "kind": "path",
                "factors": [
                    {"axis": "vx", "by": "sin(t)"},
                    {"axis": "w" if n == 2 else "wz", "by": "0.7*t"},
                    {"axis": "vy", "by": "t**3/10"},
                ],
            }
        },
    }[way]
    heading = {"helix": "pi*t", "ahead": "velocity", "path": "free"}.get(way)
    return found | ({"heading": heading} if n == 3 else {})


def known(name, horizon=2.1, along=None, forces=(), **given):
    G = GROUPS[name]
    inertia = np.diag([*np.linspace(1.0, 1.5, G.rotations), *[MASS] * G.space])
    weight = Restoring(WEIGHT).of_run(G, None)
    reference, problems = FlatReference(**given).with_files({}), Problems()
    reference.check(G, problems)
    problems.raise_if_any()
    law = Inertia(inertia, np.linalg.inv(inertia))
    plant = PlantModel(law, (weight, *forces), None, True, horizon, along=along or ALONG[name])
    found = reference.for_plant(G, plant, problems)
    problems.raise_if_any()
    return found, law, weight


@pytest.mark.parametrize("way", ["helix", "ahead", "minimum snap", "waypoints", "path"])
@pytest.mark.parametrize("name", GROUPS)
def test_rates_are_those_of_the_pose_and_the_force_is_along_the_axis(name, way, derivative):
    reference, law, weight = known(name, **options(way, GROUPS[name].space))
    G, t = GROUPS[name], np.array([0.3, 0.77, 1.9])
    Q, V, V_dot = reference.motion(G, t)
    turned = G.inverse(Q) @ derivative(lambda h: reference.motion(G, t + h)[0])
    np.testing.assert_allclose(G.hat(V), turned, rtol=0, atol=1e-6)
    slope = derivative(lambda h: reference.motion(G, t + h)[1])
    np.testing.assert_allclose(V_dot, slope, rtol=0, atol=1e-6)
    force = law.momentum(V_dot) - G.ad_star(V, law.momentum(V)) - weight.in_body(G, t, Q, V)
    np.testing.assert_allclose(force[:, G.rotations : -1], 0.0, atol=1e-12)
    position, heading = reference.flat_output(G, t)
    for k in range(4):
        slope = derivative(lambda h, k=k: reference.flat_output(G, t + h).position[..., k, :])
        np.testing.assert_allclose(position[..., k + 1, :], slope, rtol=0, atol=1e-6)
    if heading is not None:
        ahead = np.stack([np.cos(heading[..., 0]), np.sin(heading[..., 0])], axis=-1)
        np.testing.assert_allclose((Q[:, :2, 1] * ahead).sum(axis=-1), 0.0, atol=1e-14)
    one, held = reference.motion(G, 0.77), reference.held(G, 0.77)
    for k, part in enumerate(one):
        np.testing.assert_allclose(part, (Q, V, V_dot)[k][1], rtol=0, atol=1e-14)
        if held is not None:
            np.testing.assert_array_equal(held.motion(G, 0.77)[k], part)


@pytest.mark.parametrize("name", GROUPS)
def test_a_push_along_the_axis_does_what_drag_of_the_own_axes_leaves(name, derivative):
    G, t = GROUPS[name], np.array([0.3, 0.77, 1.9])
    options = {"linear": [0.0] * G.rotations + [0.9, 0.2, 0.5][-G.space :]}
    drag = Drag(**options, current=[1.0, -0.4, 0.2][: G.space]).of_run(G, None)
    given = {"position": ["2*sin(t)", "-cos(t)", "0.3*t"][: G.space]}
    given |= {"heading": "0.3*t"} if G.space == 3 else {}
    reference, law, weight = known(name, forces=(drag,), **given)
    Q, V, V_dot = reference.motion(G, t)
    turned = G.inverse(Q) @ derivative(lambda h: reference.motion(G, t + h)[0])
    np.testing.assert_allclose(G.hat(V), turned, rtol=0, atol=1e-6)
    slope = derivative(lambda h: reference.motion(G, t + h)[1])
    np.testing.assert_allclose(V_dot, slope, rtol=0, atol=1e-6)
    force = law.momentum(V_dot) - G.ad_star(V, law.momentum(V))
    force = force - weight.in_body(G, t, Q, V) - drag.in_body(G, t, Q, V)
    np.testing.assert_allclose(force[:, G.rotations : -1], 0.0, atol=1e-12)
    if G.space == 3:
        ahead = np.stack([np.cos(0.3 * t), np.sin(0.3 * t)], axis=-1)
        np.testing.assert_allclose((Q[:, :2, 1] * ahead).sum(axis=-1), 0.0, atol=1e-14)
    known_there = sum(each.in_body(G, t, Q, V) for each in (*reference.free, *reference.across))
    expected = weight.in_body(G, t, Q, V) + drag.in_body(G, t, Q, V)
    np.testing.assert_allclose(known_there, expected, rtol=1e-12, atol=1e-12)


def test_minimum_snap_has_no_jump_of_six_derivatives_and_the_least_snap():
    G, h = GROUPS["SE3"], 1e-9
    reference, *_ = known("SE3", minimum_snap=[Knot(t, p) for t, p in KNOTS])
    for t, point in KNOTS:
        both = [reference.flat_output(G, t + side * h).position for side in (-1, 1)]
        np.testing.assert_allclose(both[1][0], point, atol=1e-8)
        inner = slice(None) if 0 < t < 4 else slice(4)  # the snap begins and ends with a jump
        np.testing.assert_allclose(both[0][inner], both[1][inner], rtol=0, atol=1e-5)
    starts, c = reference.prepared(G, reference._pieces)
    found = PPoly(c[1:-1, ::-1, 0].T, starts[1:]).derivative(4)
    bump = PPoly.from_bernstein_basis(_bump()).derivative(4)
    grid = np.linspace(0, 4, 20001)
    cost = [np.trapezoid((found(grid) + s * bump(grid)) ** 2, grid) for s in (-0.01, 0, 0.01)]
    assert cost[1] < min(cost[0], cost[2])


def _bump():
    """A motion that is 0 with three derivatives at both ends, and at the knots in between."""
    from scipy.interpolate import BPoly

    zero = np.zeros(4)
    values = [
        np.array([0.0, v, 0.0, 0.0]) * (0 < i < 3) + zero for i, v in enumerate([0, 1, -1, 0])
    ]
    return BPoly.from_derivatives([t for t, _ in KNOTS], values)


BODY = {
    "group": "SE3",
    "inertia": "[1, 1, 2, 2, 2, 2]",
    "controllers": "[eqt]",
    "initial": "{pose: haar, velocity: normal}",
    "model": "{forces: [{kind: restoring, weight: 19.62}]}",
    "time": "{duration: 2, samples: 5}",
}
HOVER = "position: [0, 0, 1]"


@from_yaml
def test_what_no_motion_follows_from_is_said_before_a_run(experiment, options, said):
    reference = "{kind: flat, " + options[1:]
    assert mentions(refusal(EqtError, experiment, **BODY, reference=reference), said)


@pytest.mark.parametrize(("at", "shown"), [(1.3, 1.3), (0.4, 0.4), (-0.3, 0.0), (3.3, 3.0)])
def test_the_smallest_force_is_found_between_samples(at, shown):
    """Of a line with the distance 0.2 from the origin."""
    times = np.arange(4.0)
    line = np.stack([2 * (times - at), 0.2 + 0 * times], axis=1)
    smallest, largest, t = _smallest(times, line, np.array([[2.0, 0.0]] * 4))
    assert (smallest, t) == (pytest.approx(0.2), pytest.approx(shown, abs=1e-12))
    assert largest == pytest.approx(np.hypot(2 * max(at, 3 - at), 0.2))


def test_a_rate_reaches_half_a_step():
    values, rates = np.array([[4.0, 3.0]] * 3), np.array([[-4.0, 0.0]] * 3)
    assert _smallest(np.arange(3.0), values, rates)[0] == pytest.approx(np.hypot(2, 3))


@from_yaml
def test_known_forces_turn_with_the_body_as_drag_of_its_own_axes_only(
    experiment, force, heading, is_flat
):
    reference = f"{{kind: flat, {HOVER}, along: [0, 0, 1], heading: {heading}}}"
    model = f"{{forces: [{{kind: {force}}}, {{kind: restoring, weight: 19.62}}]}}"
    sections = BODY | {"model": model, "reference": reference}
    if is_flat:
        assert experiment(**sections).desired.pose[2, 3] == 1
        return
    name = force.partition(",")[0]
    assert (
        f"needs known forces that do not depend on the attitude, and {name} does; only drag may, "
        "if linear along the body's axes in a constant wind; move it from model.forces to "
        "plant.forces"
    ) in refusal(EqtError, experiment, **sections)


def test_the_file_of_the_path_is_a_file_of_the_reference():
    path = {"kind": "waypoints", "file": "plan.csv"}
    assert FlatReference(of=path).files == {"of": "plan.csv"}
    assert FlatReference(position=[0, 0, 0]).files == {}


def flat_through(rows, **options):
    """The motion of minimum snap through positions at times, as a recording has them."""
    text = "t,x,y,z,qw,qx,qy,qz\n" + "".join(f"{t},{x},0,0,1,0,0,0\n" for t, x in rows)
    made = FlatReference(of={"kind": "waypoints", "file": "plan.csv", **options}, heading=0.0)
    return made.with_files({"plan.csv": text})


def test_a_recording_at_constant_speed_is_flown_at_constant_speed():
    """At 2 m/s from 1 m: no acceleration, also at its ends, where it does not rest."""
    G, made = GROUPS["SE3"], flat_through([(0.1 * k, 1 + 0.2 * k) for k in range(11)])
    for t in (-0.5, 0.0, 0.03, 0.5, 1.0, 1.2):
        position = made.flat_output(G, t).position
        np.testing.assert_allclose(position[0], [1 + 2 * t, 0, 0], atol=1e-12)
        np.testing.assert_allclose(position[1], [2, 0, 0], atol=1e-9)
        np.testing.assert_allclose(position[2:], 0, atol=1e-6)  # fourth differences of decimals
    assert list(made.remarks(G)) == []


@pytest.mark.needs("logs")
def test_a_noisy_recording_says_what_smoothing_it_needs():
    """Noise of 1 cm at 10 Hz; the residual in x is its standard deviation but for the fit."""
    rng, times = np.random.default_rng(3), 0.1 * np.arange(60)
    rows = list(zip(times, np.sin(times) + 0.01 * rng.standard_normal(60), strict=True))
    [said] = flat_through(rows).remarks(GROUPS["SE3"])
    size = float(said.partition("translation: ")[2].partition("}")[0])
    assert "smoothing: {rotation: " in said
    assert 0.007 < size < 0.012
    smooth = {"rotation": 0.01, "translation": 0.01}
    assert list(flat_through(rows, smoothing=smooth).remarks(GROUPS["SE3"]))[1:] == [
        "smoothed: the root mean square residual of translation is 0.01 m"
    ]
