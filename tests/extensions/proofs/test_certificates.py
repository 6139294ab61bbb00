"""What certificates say: of runs and settings made up for it, one reason for each verdict."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import pytest
from said import says
from small_loops import any_matrix, closed_loop, constant, expressions

from eqt_cli.components.inertia import FactoredInertia, PrescribedInertia
from eqt_cli.components.laws import Controller, EqT, Family, controllers
from eqt_cli.extend import (
    ConstantReference,
    Gains,
    Goodarzi2013,
    TorqueReference,
    dot,
    group_named,
    tanh,
)
from eqt_cli.extensions.proofs.certificates import (
    STATES_PER_RTOL,
    Runs,
    Setting,
    Verdict,
    certificates,
    hypothesis_rows,
    identity_rows,
    trajectory_rows,
)
from eqt_cli.extensions.proofs.exact import value_of
from eqt_cli.extensions.proofs.sample import sampled
from eqt_cli.loop.closed_loop import ClosedLoop, StateLayout

LAWS = [kind.name for kind in controllers.all() if kind.tasks]
"""Formulas; code of a user's own is none."""

WEIGHTS = "weights (g, c, n, q) of the law"
SMALL = "stiffness and damping of small errors"
TIMES = np.linspace(0.0, 10.0, 101)
RTOL = 1e-9
DECAYING = np.array([2.0, 3.0])[:, None] * np.exp(-0.5 * TIMES)


def identities(loop, seed=0):
    random = np.random.default_rng(seed)
    common = sampled("", dataclasses.replace(loop, controller=EqT()), 5.0, random)
    return identity_rows(common, [sampled("law", loop, 5.0, random)])


def runs(**changes):
    given = [changes.get(name) for name in ("pose_error", "velocity_error")]
    counts = [len(errors) for errors in given if errors is not None]
    shown = DECAYING[: min(counts, default=2), : len(changes.get("times", TIMES))]
    known = {
        "label": "eqt",
        "claims_decrease": True,
        "rtol": RTOL,
        "threshold": 0.05,
        "times": TIMES,
        "lyapunov": shown,
        "energy_residual": np.array([1e-10, 2e-10]),
        "group_drift": np.array([1e-10, 2e-10]),
        "final_pose_error": np.array([0.01, 0.02]),
        "final_velocity_error": np.array([0.03, 0.01]),
        "pose_error": shown,
        "velocity_error": shown,
        "desired_speed": 1.0,
    }
    return Runs(**known | changes)


def trajectory(name, **changes):
    return {row.name: row for row in trajectory_rows([runs(**changes)])}[name]


def hypothesis(name, loop, **changes):
    known = {
        "loops": {"eqt": loop},
        "times": TIMES,
        "desired_pose": np.broadcast_to(loop.group.identity, (101, *loop.group.identity.shape)),
        "desired_velocity": np.zeros((101, loop.group.dimension)),
    }
    rows = hypothesis_rows(Setting(**known | changes))
    return {row.name: row for row in rows}[name]


# Identities ---------------------------------------------------------------------------------------


def test_identities_hold_on_every_group(G):
    rows = identities(closed_loop(G))
    assert len(rows) >= 12
    assert {row.verdict for row in rows} == {Verdict.HOLDS}, rows
    # The bounds are a few thousand roundings: a formula that is wrong by a millionth is seen.
    assert all(row.measured <= row.bound < 1e-8 for row in rows)


@pytest.mark.parametrize(("name", "way"), [(name, k % 3) for k, name in enumerate(LAWS)])
def test_identities_of_laws_hold(name, way):
    """Laws take turns: constant inertia, and varying ones with two choices of S."""
    G, law = group_named("SO3"), controllers.get(name)()
    at_rest = "track" not in law.tasks
    inertia = [{}, *({"inertia": each} for each in varying_inertias(G))][way]
    parts = {"reference": ConstantReference()} if at_rest else {}
    rows = identities(closed_loop(G, law, **inertia, **parts))
    unmatched = [row.name for row in rows if row.verdict is Verdict.UNCLAIMED]
    assert unmatched == [SMALL] * (not law.matched)
    assert {row.verdict for row in rows} - {Verdict.UNCLAIMED} == {Verdict.HOLDS}, rows


def varying_inertias(G):
    rows = [["0"] * 3 for _ in range(3)]
    for k in range(3):
        rows[k][k] = f"{k + 1} + t/{k + 2}"
    law = expressions(rows)
    factor = [["1 + t/8", "t/20", "0"], ["0", "1", "0"], ["0", "0", "exp(t/10)"]]
    S = expressions(factor)
    return PrescribedInertia(law), FactoredInertia(any_matrix(3, 1), S)


@pytest.mark.parametrize(
    "G",
    [
        pytest.param(group_named(name), marks=[pytest.mark.ci("on all groups")] * (k > 1))
        for k, name in enumerate(["SO3", "SE2", "SO2", "R1", "SE3", "SE23", "SE3*SO2"])
    ],
    ids=lambda group: group.name,
)
def test_identities_hold_for_a_varying_inertia(G):
    rows = [["0"] * G.dimension for _ in range(G.dimension)]
    for k in range(G.dimension):
        rows[k][k] = f"{k + 1} + t/{k + 2}"
    law = PrescribedInertia(expressions(rows))
    found = identities(closed_loop(G, inertia=law))
    assert "feedforward of a varying inertia" in {row.name for row in found}
    assert {row.verdict for row in found} == {Verdict.HOLDS}


@pytest.mark.parametrize("law", [EqT(), Family(0.5, 0.5, 0.5, "body")])
def test_rows_of_a_law_of_the_family(law):
    found = identities(closed_loop(group_named("SO3"), law))
    about_laws = {row.name for row in found if row.controller == "law"}
    assert about_laws == {WEIGHTS, "power of the feedforward", "rate of L", SMALL}


@dataclass(frozen=True)
class SaidToBeMatched(Goodarzi2013):
    """The law as it is; its integral of e is an angle, and adds k_I to the stiffness."""

    name: ClassVar[str] = "goodarzi2013"
    matched: ClassVar[bool | None] = True


@dataclass(frozen=True)
class SofterByItsIntegral(SaidToBeMatched):
    """Less stiff by as much as the integral of e adds; with c₂ = 0 it is a matched law."""

    name: ClassVar[str] = "softer"
    matched: ClassVar[bool | None] = True

    def torque(self, s):
        return super().torque(s) + self.ki * self._e_R(s.relative)


@pytest.mark.parametrize(
    ("law", "verdict"),
    [
        (Goodarzi2013(), Verdict.UNCLAIMED),
        (SaidToBeMatched(ki=0.2, c2=0.0), Verdict.FAILS),
        (SaidToBeMatched(ki=0.2, c2=0.0, bound=0.5), Verdict.FAILS),
        (SofterByItsIntegral(ki=0.2, c2=0.0), Verdict.HOLDS),
        (SofterByItsIntegral(ki=0.2, c2=0.5), Verdict.FAILS),
    ],
    ids=lambda value: f"{type(value).__name__} {getattr(value, 'c2', '')}",
)
def test_a_memory_counts_as_stiffness(law, verdict):
    """With c₂ it takes up more while the body stays away, so that no stiffness is that of Υ."""
    rows = {row.name: row for row in identities(closed_loop(group_named("SO3"), law))}
    assert rows[SMALL].verdict is verdict


def test_what_the_integral_adds_to_the_stiffness_is_its_gain():
    """2.2 instead of 2.0 N m/rad with K = I, the gains of the paper's experiment."""
    G = group_named("SO3")
    loop = closed_loop(G, SaidToBeMatched(ki=0.2, c2=0.0), gains=Gains(np.eye(3), np.eye(3)))
    sample = sampled("law", loop, 5.0, np.random.default_rng(0))
    (torque, stiffness), *_ = certificates.get(SMALL)().sides(sample)
    np.testing.assert_allclose(value_of(torque / stiffness)[0], 1.1, rtol=1e-12)


@dataclass(frozen=True)
class Limited(EqT):
    name: ClassVar[str] = "limited"

    def torque(self, s):
        return 2 * tanh(super().torque(s) / 2)


def test_a_subclass_with_a_torque_of_its_own_claims_nothing():
    loop = closed_loop(group_named("SO3"), Limited())
    assert not [row for row in identities(loop) if row.controller]
    assert hypothesis("theorem for the law", loop).verdict == "unknown"


@dataclass(frozen=True)
class Weaker(EqT):
    name: ClassVar[str] = "weaker"

    def torque(self, s):
        return super().torque(s) + s.body_damping / 2

    def dissipation(self, s):
        return super().dissipation(s)


def test_a_subclass_that_says_what_it_dissipates_is_asked_for_it():
    [row] = [
        row
        for row in identities(closed_loop(group_named("SO3"), Weaker()))
        if row.controller == "law"
    ]
    assert (row.name, row.verdict) == ("rate of L", "FAILS")


@dataclass(frozen=True)
class Untraceable(Controller):
    name: ClassVar[str] = "untraceable"

    def torque(self, s):
        return -np.linalg.solve(np.eye(3), s.V_tilde[..., None])[..., 0]

    def dissipation(self, s):
        return (s.V_tilde**2).sum(axis=-1)


@dataclass(frozen=True)
class Filtering(EqT):
    """EqT with a decaying memory z, ż = −z, whose energy ½|z|² is in L."""

    name: ClassVar[str] = "filtering"
    sign: float = 1.0

    def memory(self, G):
        return {"z": G.dimension}

    def memory_rate(self, s):
        return {"z": -s.memory["z"]}

    def lyapunov(self, s):
        return s.lyapunov + dot(s.memory["z"], s.memory["z"]) / 2

    def dissipation(self, s):
        return super().dissipation(s) + self.sign * dot(s.memory["z"], s.memory["z"])


@pytest.mark.parametrize(("sign", "verdict"), [(1.0, Verdict.HOLDS), (-1.0, Verdict.FAILS)])
def test_the_rate_of_L_sees_what_a_law_remembers(sign, verdict):
    rows = identities(closed_loop(group_named("SO3"), Filtering(sign=sign)))
    assert [row.verdict for row in rows if row.name == "rate of L"] == [verdict]


class WithActuator(ClosedLoop):
    """A closed loop with a stage that has states of its own."""

    @cached_property
    def layout(self):
        return StateLayout({**super().layout.lengths, "actuator": self.group.dimension})


def test_every_state_behind_the_work_is_drawn_with_its_rounding():
    loop = closed_loop(group_named("SO3"), Filtering())
    loop = WithActuator(**{name: getattr(loop, name) for name in ClosedLoop.__dataclass_fields__})
    sample = sampled("", loop, 5.0, np.random.default_rng(0))
    for name in ("controller.z", "actuator"):
        where = loop.layout.slices[name]
        values, errors = value_of(sample.flat[:, where])
        assert values.all()
        assert (errors > 0).all()


def test_a_law_that_takes_floats_only_is_undecided_and_says_why():
    [row] = [
        row
        for row in identities(closed_loop(group_named("SO3"), Untraceable()))
        if row.controller == "law"
    ]
    assert (row.name, row.verdict) == ("rate of L", "undecided")
    assert row.remark.startswith("cannot be evaluated on symbols: ")


def test_identities_hold_for_expressions_without_time():
    G = group_named("SO3")
    rows = expressions([["2", "0", "0"], ["0", "2", "0"], ["0", "0", "2"]])
    loop = closed_loop(G, inertia=PrescribedInertia(rows), reference=TorqueReference([1, 0, 0]))
    assert {row.verdict for row in identities(loop)} == {Verdict.HOLDS}


# Trajectories -------------------------------------------------------------------------------------


def test_good_runs_hold():
    assert {row.verdict for row in trajectory_rows([runs()])} == {Verdict.HOLDS}


@pytest.mark.parametrize("bad", [1e-3, np.nan])
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("energy balance", lambda bad: {"energy_residual": np.array([bad, 1e-12])}),
        ("poses stay in the group", lambda bad: {"group_drift": np.array([bad, 1e-12])}),
        (
            "decrease of L",
            lambda bad: {"lyapunov": np.array([[2.0, 1.0, 1 + 2 * bad]]), "times": np.arange(3.0)},
        ),
    ],
)
def test_a_trajectory_row_fails_beyond_its_bound_and_on_what_is_no_number(name, changes, bad):
    row = trajectory(name, **changes(bad))
    assert row.verdict == "FAILS"
    assert np.isnan(bad) or row.measured == pytest.approx(bad)


def test_small_rises_of_L_are_measured_against_a_joule():
    rising = {"lyapunov": np.array([[1e-9, 1.5e-9]]), "times": np.arange(2.0)}
    assert trajectory("decrease of L", **rising).verdict == "holds"


def ending(*levels, stays=()):
    """Errors over time that decay to these parts of 2, or stay there from a third of the time."""
    rate = -np.log(np.array(levels)) / TIMES[-1]
    errors = 2 * np.exp(-rate[:, None] * TIMES)
    for run in stays:
        errors[run] = np.maximum(2 * np.exp(-3 * rate[run] * TIMES), 2 * levels[run])
    return errors


def pose_errors(*levels, stays=()):
    errors = ending(*levels, stays=stays)
    return {"pose_error": errors, "final_pose_error": errors[:, -1]} | energy(errors, stays)


def energy(errors, stays):
    """L of runs that stay, which is quadratic in what stays."""
    return {"lyapunov": errors**2 / 2} if len(stays) else {}


def velocity_errors(*levels, stays=(), scale=1.0):
    errors = scale * ending(*levels, stays=stays)
    return {"velocity_error": errors, "final_velocity_error": errors[:, -1]} | energy(errors, stays)


def test_runs_under_way_are_counted_and_their_decay_is_measured():
    row = trajectory("Q → Q_d", **pose_errors(0.005, 0.15))
    assert (row.verdict, row.measured, row.bound) == ("undecided", pytest.approx(0.3), 0.05)
    assert row.remark == "1 of 2 runs not converged at 10 s; L decays at 0.5 1/s (median)"


def test_a_pose_error_that_stays_below_the_threshold_is_an_offset():
    row = trajectory("Q → Q_d", **pose_errors(0.001, 0.01, stays=[1]))
    assert row.verdict == "undecided"
    assert row.remark.startswith(
        "1 of 2 runs not converged at 10 s; an error of 0.02 stays in 1 of 2 runs"
    )


def test_runs_that_settle_part_by_part_have_no_bound_of_the_pose_error():
    """An origin far away makes ‖I − Q_E‖_F large of poses that are near."""
    known = {**pose_errors(0.001, 0.01), "threshold": 1e-4}
    far = trajectory("Q → Q_d", **known)
    there = trajectory("Q → Q_d", **known, settled=np.array([True, True]))
    late = trajectory("Q → Q_d", **known, settled=np.array([True, False]))
    assert [far.verdict, there.verdict, late.verdict] == ["undecided", "holds", "undecided"]
    assert there.bound is None
    assert late.remark.startswith("1 of 2 runs not converged at 10 s;")


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_velocities_are_judged_by_their_own_size(scale):
    """A satellite's rates are below 0.05 at all times, and an unstable loop's may be large."""
    there = trajectory("P → P_d", **velocity_errors(0.001, 0.002, scale=scale))
    late = trajectory("P → P_d", **velocity_errors(0.001, 0.2, scale=scale))
    assert (there.verdict, late.verdict) == ("holds", "undecided")
    assert (late.measured, late.bound) == (pytest.approx(0.2), 0.05)


def test_noise_does_not_hide_an_offset():
    noise = np.random.default_rng(1).uniform(-1e-3, 1e-3, (1, 101))
    errors = np.maximum(2 * np.exp(-2 * TIMES), 0.02) + noise
    row = trajectory("Q → Q_d", pose_error=errors, lyapunov=errors**2 / 2)
    assert "an error of 0.02 stays" in row.remark


PAUSED = np.maximum(2 * np.exp(-3 * TIMES), 0.2)


@pytest.mark.parametrize(
    ("errors", "L", "stays"),
    [
        (0.04 * np.exp(-0.1 * TIMES), None, False),  # below the threshold, and under way
        # Its mean over a quarter of the horizon does not fall for a while.
        (2 * np.exp(-0.02 * TIMES) * (1.1 + np.cos(0.9 * TIMES)), None, False),
        # As a slow sliding mode on SE(3), and `nog` there, whose errors decay later.
        (PAUSED, 5 * np.exp(-0.2 * TIMES), False),
        (PAUSED, PAUSED**2, True),
    ],
    ids=["small", "oscillating", "pausing", "still"],
)
def test_an_error_stays_only_if_neither_it_nor_L_falls(errors, L, stays):
    changes = {} if L is None else {"lyapunov": L[None]}
    row = trajectory(
        "Q → Q_d", pose_error=errors[None], final_pose_error=errors[None, -1], **changes
    )
    assert row.verdict == "undecided"
    assert (
        ("stays" in row.remark) == ("an error of 0.2 stays in 1 of 1 runs" in row.remark) == stays
    )


def test_a_velocity_error_that_stays_is_an_offset():
    row = trajectory("P → P_d", **velocity_errors(0.001, 0.01, stays=[1], scale=0.1))
    assert (row.verdict, row.measured) == ("undecided", pytest.approx(0.01))
    assert "an error of 0.002 stays in 1 of 2 runs" in row.remark


def test_what_stays_at_the_error_of_the_solver_is_there():
    still = np.full((1, 101), 0.5 * STATES_PER_RTOL * RTOL)
    assert trajectory("Q → Q_d", pose_error=still, final_pose_error=still[:, -1]).verdict == "holds"
    moving = {"velocity_error": 40 * still, "final_velocity_error": 40 * still[:, -1]}
    assert trajectory("P → P_d", **moving, desired_speed=100.0).verdict == "holds"
    assert trajectory("P → P_d", **moving, desired_speed=1.0).verdict == "undecided"


def test_a_run_that_never_leaves_its_reference_is_there():
    still = np.zeros((1, 101))
    changes = {"velocity_error": still, "final_velocity_error": still[:, -1]}
    assert trajectory("P → P_d", **changes, desired_speed=0.0).verdict == "holds"


def test_the_offset_of_a_loop_that_no_theorem_covers_is_named():
    row = trajectory(
        "Q → Q_d", **pose_errors(0.01, 0.01, stays=[0, 1]), departures="a constant force"
    )
    assert row.verdict == "not covered"
    assert "a constant force; 2 of 2 runs not converged" in row.remark
    assert "an error of 0.02 stays in 2 of 2 runs" in row.remark


def test_an_offset_is_seen_with_two_samples_only():
    errors = np.array([[0.02, 0.02]])
    row = trajectory(
        "Q → Q_d",
        times=np.array([0.0, 10.0]),
        lyapunov=errors,
        pose_error=errors,
        final_pose_error=errors[:, -1],
    )
    assert (row.verdict, "stays" in row.remark) == ("undecided", True)


def test_a_run_that_is_not_there_and_whose_error_grows_speaks_against_convergence():
    growing = np.exp(0.1 * TIMES)[None]
    row = trajectory("P → P_d", **velocity_errors(0.3), lyapunov=growing)
    assert row.verdict == "FAILS"


@pytest.mark.parametrize(
    ("final", "counted"), [(0.3, "1 of 1 runs not converged at 10 s; "), (0.01, "")]
)
def test_convergence_without_trajectories_is_undecided(final, counted):
    none = {"lyapunov": None, "pose_error": None}
    row = trajectory("Q → Q_d", final_pose_error=np.array([final]), **none)
    assert (row.verdict, row.remark) == ("undecided", f"{counted}the result holds no trajectories")


def test_velocities_without_trajectories_have_no_bound():
    row = trajectory("P → P_d", lyapunov=None, velocity_error=None)
    assert (row.verdict, row.measured, row.bound) == ("undecided", 0.03, None)


def test_an_end_that_is_not_a_number_is_not_there():
    assert trajectory("Q → Q_d", final_pose_error=np.array([np.nan, 0.0])).verdict == "undecided"


@pytest.mark.parametrize("claims", [False, None])
def test_nothing_is_held_against_a_law_that_claims_nothing(claims):
    rising = np.array([[1.0, 2.0, 3.0]])
    changes = {"claims_decrease": claims, "lyapunov": rising, "times": np.arange(3.0)}
    assert trajectory("decrease of L", **changes).verdict == "unclaimed"
    late = {"final_pose_error": np.array([1.0]), "pose_error": rising}
    assert trajectory("Q → Q_d", **changes, **late).verdict == "unclaimed"


def test_a_law_without_dissipation_has_no_balance():
    row = trajectory("energy balance", energy_residual=np.array([np.nan, np.nan]))
    assert row.verdict == "unclaimed"


def test_without_trajectories_a_decrease_is_undecided():
    row = trajectory("decrease of L", lyapunov=None)
    assert (row.verdict, row.remark) == ("undecided", "the result holds no trajectories")


def test_without_a_good_run_nothing_is_decided():
    over_time = "lyapunov", "pose_error", "velocity_error"
    once = "energy_residual", "group_drift", "final_pose_error", "final_velocity_error"
    none = dict.fromkeys(over_time, np.zeros((0, 101))) | dict.fromkeys(once, np.zeros(0))
    rows = trajectory_rows([runs(**none, failed=3)])
    assert {row.verdict for row in rows} == {Verdict.UNDECIDED}
    assert "3 runs failed" in {row.remark for row in rows}


# Hypotheses ---------------------------------------------------------------------------------------


def test_a_body_that_cannot_be_rigid_is_a_hypothesis_violated():
    loop = closed_loop(group_named("SO3"), inertia=constant(np.diag([1.0, 1.0, 3.0])))
    row = hypothesis("𝕀 is a rigid body's", loop)
    assert (row.verdict, row.remark[-21:]) == ("violated", "inequality: 1 + 1 < 3")


def test_what_is_not_said_to_be_rigid_has_no_such_row():
    loop = closed_loop(group_named("SO3"), inertia=constant(np.diag([1.0, 1.0, 3.0])))
    with pytest.raises(KeyError):
        hypothesis("𝕀 is a rigid body's", loop, rigid=False)
    with pytest.raises(KeyError):
        hypothesis("𝕀 is a rigid body's", closed_loop(group_named("SE2")))


def weighted(K, name="SO3"):
    G = group_named(name)
    return closed_loop(G, gains=Gains(np.diag(K), np.eye(G.dimension)))


@pytest.mark.parametrize(
    ("K", "verdict", "least"),
    [
        ([1.0, 1.0, 1.0], "Morse-Bott", 2.0),
        ([1.0, 1.0, 3.0], "Morse-Bott", 2.0),
        ([1.0, 2.0, 3.0], "holds", 1.0),
        ([1.0, 2.0, -3.0], "violated", 1.0),
    ],
)
def test_navigation_function(K, verdict, least):
    row = hypothesis("Υ is a navigation function", weighted(K))
    assert (row.verdict, row.measured) == (verdict, pytest.approx(least))


def test_navigation_function_names_its_critical_points_and_indices():
    assert says(
        hypothesis("Υ is a navigation function", weighted([1.0, 2.0, 3.0])).remark,
        "identity: index 0…",
    )
    assert hypothesis("Υ is a navigation function", weighted([1.0, 1.0, 1.0])).remark == (
        "identity: index 0; half-turns about every axis: index 1, a manifold of dimension 2"
    )


def test_condition_on_the_weight():
    assert hypothesis("Hessian of Υ at I is positive", weighted([1.0, 2.0, -0.5])).measured == 0.5
    row = hypothesis("Hessian of Υ at I is positive", weighted([1.0, 2.0, -3.0]))
    assert (row.verdict, row.measured) == ("violated", -2.0)


def test_rayleigh_tensor():
    G = group_named("SO3")
    loop = closed_loop(G, gains=Gains(np.eye(3), np.diag([1.0, 2.0, -1.0])))
    assert hypothesis("K_d is positive definite", loop).verdict == "violated"
    assert hypothesis("K_d is positive definite", closed_loop(G)).verdict == "holds"


def poses(loop, radius):
    """Q_d on a path whose position is `radius` (samples,) from the origin."""
    Q = np.broadcast_to(loop.group.identity, (101, *loop.group.identity.shape)).copy()
    Q[:, 0, -1] = radius
    return Q


def test_a_pose_is_bounded_by_proof_on_a_compact_group_only():
    assert hypothesis("Q_d is bounded", closed_loop(group_named("SO3"))).verdict == "holds"
    loop = closed_loop(group_named("SE3"))
    assert hypothesis("Q_d is bounded", loop).verdict == "unknown"


@pytest.mark.parametrize(
    ("radius", "verdict"), [(TIMES, "growing"), (np.sin(TIMES), "unknown"), (10 - TIMES, "unknown")]
)
def test_a_pose_that_still_grows_is_said_to(radius, verdict):
    loop = closed_loop(group_named("SE3"))
    row = hypothesis("Q_d is bounded", loop, desired_pose=poses(loop, radius))
    assert row.verdict == verdict
    assert row.measured == pytest.approx(np.sqrt(4 + np.max(np.abs(radius)) ** 2))


def test_a_reference_at_rest_is_bounded():
    loop = closed_loop(group_named("SE3"), reference=ConstantReference())
    assert hypothesis("Q_d is bounded", loop).verdict == "holds"
    moving = hypothesis("Q_d is bounded", loop, desired_velocity=np.ones((101, 6)))
    assert moving.verdict == "unknown"


def test_a_velocity_is_bounded_by_proof_where_the_reference_keeps_it():
    G = group_named("SO3")
    velocity = TIMES[:, None] * np.ones(3)
    for reference, verdict in ((ConstantReference(), "holds"), (None, "growing")):
        loop = closed_loop(G, **({"reference": reference} if reference else {}))
        row = hypothesis("V_d is bounded", loop, desired_velocity=velocity)
        assert (row.verdict, row.measured) == (verdict, pytest.approx(10 * np.sqrt(3)))


@pytest.mark.parametrize(
    ("name", "remark"), [("SO3", "compact"), ("SE3", "compact ⋉ vector space"), ("R3", "compact ⋉")]
)
def test_class_of_remark_6_3(name, remark):
    row = hypothesis("Ad_{Q_d} is bounded with Q_d", closed_loop(group_named(name)))
    assert row.verdict == "holds"
    assert row.remark.startswith(remark)


def test_inertia_is_bounded_by_proof_where_it_is_constant():
    G = group_named("SO3")
    assert hypothesis("𝕀_t and its rate are bounded", closed_loop(G)).verdict == "holds"


@pytest.mark.parametrize(
    ("entry", "verdict", "rate"),
    [("2 + t", "growing", 1.0), ("3 - t/10", "unknown", 0.1), ("2", "unknown", 0.0)],
)
def test_a_varying_inertia_shows_its_bounds(entry, verdict, rate):
    rows = expressions([[entry, "0", "0"], ["0", entry, "0"], ["0", "0", entry]])
    loop = closed_loop(group_named("SO3"), inertia=PrescribedInertia(rows))
    row = hypothesis("𝕀_t and its rate are bounded", loop)
    assert (row.verdict, row.measured) == (verdict, pytest.approx(rate))


@pytest.mark.parametrize(
    ("law", "verdict"),
    [
        (Family(0.3, 0.1, 0.9), "holds"),
        (Family(1.0, 1.0, 1.0), "violated"),
        (controllers.get("stabilising")(feedforward=True), "holds"),
        (controllers.get("stabilising")(feedforward=False), "violated"),
    ],
)
def test_laws_that_the_paper_covers(law, verdict):
    row = hypothesis("theorem for the law", closed_loop(group_named("SO3"), law))
    assert row.verdict == verdict
