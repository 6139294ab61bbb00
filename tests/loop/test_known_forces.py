"""What a loop takes from the torque of a law for the forces of the model, in closed form."""

import numpy as np
import pytest

import eqt_cli
from eqt_cli.loop.law_program import law_program

MASS, WEIGHT, LEVER = 2.0, 19.62, np.array([0.02, 0.0, -0.1])
BODY = {
    "group": "SE3",
    "inertia": [0.03, 0.03, 0.05, MASS, MASS, MASS],
    "gains": {"kp": [1, 1, 1, 2], "kd": [0.3, 0.3, 0.4, 4, 4, 4]},
    "reference": {"kind": "constant"},
    "controllers": ["gt", "eqt"],
    "initial": {"pose": "haar"},
    "time": {"duration": 1.0, "samples": 3},
    "solver": {"rtol": 1e-11},
}
HEAVY = {"kind": "restoring", "weight": WEIGHT}
UNEVEN = HEAVY | {"centre_of_mass": LEVER.tolist()}
FLOOD = {"kind": "drag", "linear": [0.0, 0.0, 0.0, 3.0, 3.0, 3.0], "current": [0.4, 0.0, 0.0]}
PUSH = {"kind": "constant", "force": [0.01, 0.02, 0.0, 1.0, -2.0, 3.0]}


def with_forces(*forces, **changes):
    return BODY | {"model": {"forces": [*forces]}} | changes


def test_the_known_weight_of_a_body_drops_out_of_its_motion():
    """At any state, also with a lever."""
    rates = []
    for changes in ({}, {"model": {"forces": [UNEVEN]}}):
        loop = eqt_cli.load_experiment(BODY | changes).base.loops["eqt"]
        Q = loop.group.exp(np.random.default_rng(0).standard_normal((9, 6)))
        V, still = np.random.default_rng(2).standard_normal((9, 6)), np.zeros((9, 6))
        rates.append(loop.vector_field(0.0, loop.initial_state(Q, V, Q, still)))
    np.testing.assert_allclose(*rates, atol=1e-12)


@pytest.mark.ci("runs laws twice")
@pytest.mark.parametrize(
    ("engine", "forces", "clock"),
    [
        ("solve_ivp", [HEAVY], {}),
        ("native", [HEAVY], {}),
        ("solve_ivp", [PUSH], {"control": {"period": 0.02}}),
    ],
)
def test_a_body_flies_as_without_forces_that_its_law_knows(tmp_path, engine, forces, clock):
    """The weight is counteracted at any attitude; what a clock holds, in the body."""
    moving = {"reference": {"kind": "constant", "velocity": [0.1, 0.2, -0.3, 0.5, 0, 0.2]}}
    shared = moving | clock | {"solver": {"engine": engine, "rtol": 1e-11}}
    heavy = eqt_cli.run(with_forces(*forces, **shared), tmp_path / "heavy")
    free = eqt_cli.run(BODY | shared, tmp_path / "free")
    for name in ("pose", "velocity"):
        np.testing.assert_allclose(heavy[name], free[name], atol=1e-8)  # of 4 rad/s


def at_rest(loop, position):
    """A state at rest, turned by 0.8 rad about x, and the attitude."""
    c, s = np.cos(0.8), np.sin(0.8)
    Q = np.eye(4)
    Q[:3, :3], Q[:3, 3] = [[1, 0, 0], [0, c, -s], [0, s, c]], position
    desired, still = Q.copy(), np.zeros((1, 6))
    desired[:3, 3] = 0.0
    state = loop.initial_state(Q[None], still, desired[None], still)
    return loop.tracking(0.0, state), Q[:3, :3]


def test_the_command_holds_weight_and_current_on_a_body_at_rest():
    """τ = −(r × Rᵀw, Rᵀ(w + D c)), with w = (0, 0, −W): the drag of the current on a still body."""
    loop = eqt_cli.load_experiment(with_forces(UNEVEN, FLOOD)).base.loops["gt"]
    s, R = at_rest(loop, [0, 0, 0])
    weight, current = R.T @ [0, 0, -WEIGHT], R.T @ [3.0 * 0.4, 0, 0]
    expected = [*-np.cross(LEVER, weight), *-(weight + current)]
    np.testing.assert_allclose((loop.command(s) - loop.law.torque(s))[0], expected, atol=1e-13)
    program = law_program(loop)  # as it is exported
    written = {entry.name for entry in program.numbers}
    assert {"known_forces_0_weight", "known_forces_1_linear"} <= written


def test_without_known_forces_a_body_sinks_by_weight_over_stiffness():
    left_out = {"kind": "gt", "known_forces": False}
    loop = eqt_cli.load_experiment(with_forces(HEAVY, controllers=[left_out])).base.loops["gt"]
    s, R = at_rest(loop, [0, 0, -WEIGHT / 2.0])  # k_x = 2 N/m
    np.testing.assert_allclose(loop.command(s)[0, 3:], R.T @ [0, 0, WEIGHT], atol=1e-13)


@pytest.mark.needs("designed_laws")
def test_laws_that_know_the_model_themselves_are_not_helped_twice():
    """LQR holds the weight once, and not at all where its entry says so."""
    entries = [{"kind": "lqr"}, {"kind": "lqr", "label": "blind", "known_forces": False}]
    resting = {"controllers": entries, "reference": {"kind": "constant"}}
    experiment = eqt_cli.load_experiment(with_forces(HEAVY, **resting))
    for label, held in (("lqr", WEIGHT), ("blind", 0.0)):
        loop = experiment.experiment(0).loops[label]
        still = np.zeros((1, 6))
        s = loop.tracking(0.0, loop.initial_state(np.eye(4)[None], still, np.eye(4)[None], still))
        np.testing.assert_allclose(loop.command(s)[0, 5], held, atol=1e-12)


def test_an_integral_is_told_of_limits_that_the_weight_takes_up():
    """1 m too low and 1 N from the limit, k_x = 2 N/m: the command is cut, and I_z stays."""
    law = {"kind": "goodarzi2013", "anti_windup": "clamp"}
    limit = {"kind": "limit", "limit": [9, 9, 9, 99, 99, WEIGHT + 1.0]}
    still = {"controllers": [law], "actuators": [limit], "reference": {"kind": "constant"}}
    weight = {"kind": "restoring", "weight": WEIGHT}
    for forces, stays in (([weight], True), ([], False)):
        loop = eqt_cli.load_experiment(with_forces(*forces, **still)).base.loops["goodarzi2013"]
        Q, at_rest_there = np.eye(4)[None].copy(), np.zeros((1, 6))
        Q[0, 2, 3] = -1.0
        state = loop.initial_state(Q, at_rest_there, np.eye(4)[None], at_rest_there)
        rate = loop.law.memory_rate(loop.tracking(0.0, state))["integral"][0]
        assert bool(rate[5] == 0.0) is stays


@pytest.mark.ci("runs two laws")
def test_comparisons_name_the_laws_that_leave_forces_out(tmp_path):
    laws = ["eqt", {"kind": "gt", "known_forces": False}]
    short = {"controllers": laws, "ensemble": {"runs": 2}, "time": {"duration": 0.1, "samples": 2}}
    flown = eqt_cli.run(with_forces(HEAVY, **short), tmp_path / "flown")
    said = eqt_cli.compare(flown).answer()
    assert "without the forces of `model` (`known_forces: false`): GT" in said


# The limits that a reference needs ----------------------------------------------------------------


def hexarotor(**limits):
    """Six rotors tilted by 25 deg about their arms; the thrusts are those of a pseudo-inverse."""
    rotors = []
    for k in range(6):
        angle, sign = np.pi / 3 * k, (-1.0) ** k
        tilt = np.array([np.sin(angle), -np.cos(angle)]) * np.sin(np.radians(25)) * sign
        at = [0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.0]
        along = [*tilt, np.cos(np.radians(25))]
        rotors.append({"at": at, "along": along, "turns": -0.02 * sign})
    path = {"kind": "path", "factors": [{"axis": "vx", "by": "0.625*sin(2*t)"}]}
    thrusters = {"kind": "thrusters", "thrusters": rotors, "low": 0.0} | limits
    weight = {"kind": "restoring", "weight": 9.81 * MASS}
    return with_forces(weight, actuators=[thrusters], reference=path, controllers=["gt"])


@pytest.mark.needs("thrusters")
@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"high": 9.0}, None),
        ({"high": 7.0}, "gives at most 7 N, but the reference alone needs 7.02"),
        ({"high": 9.0, "low": 0.3}, "gives at least 0.3 N, but the reference alone needs 0.19"),
    ],
)
def test_what_a_reference_needs_contains_the_weight(limits, said):
    """2.5 m/s² level takes 0.1927 to 7.0234 N, by a pseudo-inverse in a plain program."""
    from eqt_cli.config.remarks import limits_below_reference

    experiment = eqt_cli.load_experiment(hexarotor(**limits)).base
    remarks = [text for _, text in limits_below_reference(experiment)]
    assert len(remarks) == bool(said)
    assert all(said in text for text in remarks)


def test_an_idle_actuator_needs_nothing():
    """A limit of 0 N is no reason for a remark where the need is 0 but for rounding."""
    from eqt_cli.config.remarks import limits_below_reference

    idle = hexarotor(high=9.0) | {"model": None, "reference": {"kind": "constant"}}
    assert not list(limits_below_reference(eqt_cli.load_experiment(idle).base))
