"""Certificates can fail: a fault planted in any law turns the rows red that are about it, no other.

Every fault is a wrong sign, a wrong factor or a missing term, planted for the time of one test in
all modules that use the function. The rows that must turn red are named; all others must hold.
"""

import dataclasses
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from case_tables import in_ci

from eqt_cli.components import inertia as critical_points
from eqt_cli.components import mechanics, motions
from eqt_cli.components.inertia import CriticalSet, FactoredInertia, Inertia, PrescribedInertia
from eqt_cli.components.laws import Family, controllers
from eqt_cli.components.mechanics import Semidirect, Tracking, lie_poisson
from eqt_cli.components.references import MovingReference
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.extend import (
    ClosedLoop,
    EuclideanGroup,
    MatrixLieGroup,
    ProductGroup,
    Stabilising,
    apply_matrix,
    transpose,
)
from eqt_cli.extensions.proofs import identities
from eqt_cli.extensions.proofs.certificates import Verdict
from eqt_cli.extensions.proofs.verification import verify_experiment

SHORT = ["time.duration=0.5", "time.samples=6", "ensemble.runs=2"]

FACTOR = [["1 + t/8", "t/20", 0], [0, 1, 0], [0, 0, "exp(t/10)"]]
FACTORED = f"inertia={{initial: [[2, 0, 0.1], [0, 3, 0], [0.1, 0, 4]], factor: {FACTOR}}}".replace(
    "'", '"'
)
PRESCRIBED = 'inertia={matrix: [["2 + t/5", 0, "sin(t)/5"], [0, 3, 0], ["sin(t)/5", 0, 4]]}'
KEPT = "reference={kind: constant, velocity: [0.3, 0.2, -0.1]}"
PATH = "reference={kind: path, factors: [{axis: wz, by: sin(t)}, {axis: [1, 2, 0], by: cos(t)}]}"
TWO_BODIES = ["group=SO3*SO3", "gains.kp=[[1, 1.5, 2], [2, 2.5, 3]]", "initial.pose=[haar, haar]"]

TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])

EXPERIMENTS = {
    "paper": ("paper", []),
    "bluerov2": ("se3_bluerov2", []),
    "factored": ("paper", [FACTORED]),
    "prescribed": ("paper", [PRESCRIBED]),
    "satellite": ("satellite_panels", []),
    "kept velocity": ("paper", [PRESCRIBED, KEPT]),
    "path": ("paper", [PATH]),
    "body and slider": ("body_and_slider", []),
    "two bodies": ("body_and_slider", TWO_BODIES),
    "attitude": ("attitude_distinct", []),
    "plane": ("se2_vehicle", []),
    "extended poses": ("se23", []),
}


def red_rows(name, *more):
    """(what, law) of every row that fails; more keys may be set."""
    config, overrides = EXPERIMENTS[name]
    settings = {setting.partition("=")[0]: setting for setting in [*SHORT, *overrides, *more]}
    path = shipped.folder() / f"{config}.yaml"
    experiment = build(read_config(path, list(settings.values())))
    found = verify_experiment(experiment)
    return {(row.name, row.controller) for row in found.rows if row.verdict is Verdict.FAILS}


def on(laws, *names):
    """These rows for each of these laws; the law "" is none."""
    return {(name, law) for name in names for law in laws.split(",")}


def without_force_of_the_inertia(exact, reference, G, inertia, *rest):
    return exact(reference, G, dataclasses.replace(inertia, change=None), *rest)


def with_acceleration_of_first_factor_left_out(exact, G, links, numbers, angles):
    first, *others = angles
    return exact(G, links, numbers, [first * np.array([[1.0], [1.0], [0.0]]), *others])


# Where a fault is planted -------------------------------------------------------------------------


def everywhere(monkeypatch, function, planted):
    """Replace a function in every module that has it, under whatever name it was imported."""
    for module in list(sys.modules.values()):
        if getattr(module, "__name__", "").startswith("eqt_cli"):
            for name, value in list(vars(module).items()):
                if value is function:
                    monkeypatch.setattr(module, name, planted)


def in_method(owner, name, fault):
    """A fault in a method: `fault(original, self, *arguments)` takes its place."""

    def plant(monkeypatch):
        original = vars(owner)[name]
        monkeypatch.setattr(owner, name, lambda self, *rest: fault(original, self, *rest))

    return plant


def in_function(function, fault):
    """A fault in a function: `fault(function, *arguments)` takes its place."""

    def plant(monkeypatch):
        everywhere(monkeypatch, function, lambda *rest: fault(function, *rest))

    return plant


def in_torque(term, owner=Family):
    """A torque with `term(law, s)` too much."""
    return in_method(owner, "torque", lambda exact, law, s: exact(law, s) + term(law, s))


def in_change(owner, factor):
    """Another rate of a varying inertia."""

    def fault(exact, law, t):
        now = exact(law, t)
        return dataclasses.replace(now, change=factor(now.change))

    return in_method(owner, "at", fault)


in_product = partial(in_method, Semidirect)


def in_jacobian(translations):
    """Other translations in an exponential."""

    def fault(exact, G, V):
        return G.assemble(G.rotation(exact(G, V)), translations(exact, G, V))

    return in_method(EuclideanGroup, "exp", fault)


def with_jacobian_transposed(exact, G, V):
    turn, columns = np.split(V, [G.rotations], axis=-1)
    return G.translations(exact(G, np.concatenate([-turn, columns], axis=-1)))


def with_jacobian_left_out(exact, G, V):
    return transpose(G._columns(V))


def in_property(owner, name, fault):
    """A fault in a cached property of the state."""

    def plant(monkeypatch):
        exact = vars(owner)[name].func
        monkeypatch.setattr(owner, name, property(lambda self: fault(exact(self), self)))

    return plant


def in_law(name, **numbers):
    """A copy of a registered law in its place, whose class has other numbers."""

    def plant(monkeypatch):
        law = controllers.get(name)
        fields = {key: dataclasses.field(default=n, init=False) for key, n in numbers.items()}
        types = {key: type(number) for key, number in numbers.items()}
        copy = type(law.__name__, (law,), {"__annotations__": types, "name": name, **fields})
        planted = dataclasses.dataclass(frozen=True)(copy)
        exact = controllers._shipped
        found = lambda each: planted if each == name else exact(each)  # noqa: E731
        monkeypatch.setattr(controllers, "_shipped", found)

    return plant


def together(*plants):
    """Several faults at once."""

    def plant(monkeypatch):
        for each in plants:
            each(monkeypatch)

    return plant


def gyroscopic_sign(law, s):
    return 2 * law.gyroscopic * s.G.ad_star(s.V_tilde, s.Pd)


def transport_sign(law, s):
    return 2 * law.transport * s.G.ad_star(s.Vd, s.P_tilde)


def connection_sign(law, s):
    return -2 * law.connection * s.inertia.momentum(s.G.ad(s.V, s.Vd))


def connection_factor(law, s):
    return law.connection * s.inertia.momentum(s.G.ad(s.V, s.Vd))


def damping_sign(law, s):
    spatial = s.G.Ad_star(s.Qd, law.spatial * s.spatial_damping)
    return 2 * (spatial + (1 - law.spatial) * s.body_damping)


def spatial_damping_in_the_body_frame(law, s):
    return law.spatial * (s.G.Ad_star(s.Qd, s.spatial_damping) - s.body_damping)


def gradient_sign(law, s):
    return 2 * s.G.Ad_star(s.Qd, s.gradient)


def gradient_not_transported(law, s):
    return s.G.Ad_star(s.Qd, s.gradient) - s.gradient


def inertia_force_sign(law, s):
    return -2 * s.inertia_force


def reference_torque_missing(law, s):
    return -s.tau_d


def transposed_damping(exact, s):
    return apply_matrix(transpose(s.gains.K_d), s.V_tilde)


def transposed_spatial_damping(exact, s):
    return apply_matrix(transpose(s.gains.K_d), s.V_E)


def damping_in_space(exact, s):
    return s.G.Ad_star(s.Qd, s.spatial_damping)


def initial_state_at_0(exact, loop, Q, V, Qd, Vd, t=0.0):
    return exact(loop, Q, V, Qd, Vd, 0.0)


def of_the_inverse_in_the_second_factor(exact, G, Q):
    matrix, block, axes = exact(G, Q).copy(), G.places[1], G.coordinates[1]
    second = G.factors[1]
    matrix[..., axes, axes] = second.Ad_matrix(second.inverse(Q[..., block, block]))
    return matrix


def least_drift(exact, G, Q):
    drifts = [f.drift(Q[..., block, block]) for f, block in zip(G.factors, G.places, strict=True)]
    return np.min(drifts, axis=0)


def log_without_jacobian(exact, G, Q):
    columns = transpose(G.translations(Q)).reshape(*Q.shape[:-2], -1)
    return np.concatenate([exact(G, Q)[..., : G.rotations], columns], axis=-1)


def gyroscopic_change(change):
    """Another S for the same 𝕀_t: the skew part of A has no power, but another torque."""
    return change + (change - transpose(change)) / 2


class Planted(NamedTuple):
    """An experiment, the fault that is planted in it, and the rows that turn red."""

    experiment: str
    plant: Callable
    red: set


def negated(exact, *rest):
    return -exact(*rest)


def doubled(exact, *rest):
    return 2 * exact(*rest)


# Which rows turn red ------------------------------------------------------------------------------

ALL = "eqt,gt,nog,asym"
WEIGHTS = "weights (g, c, n, q) of the law"
THROUGH = on(ALL, WEIGHTS)  # the control of Theorem 6.2
POWER = "power of the feedforward"
SMALL = "stiffness and damping of small errors"
CRITICAL = "critical points of Υ"
EXP = on("", "exp and log")
BALANCE = ("energy balance", "rate of L")
FORCED, CARRIED = (THROUGH | on(ALL, *more, *BALANCE) for more in ((POWER,), ()))
MOVED = on("", "motion of the reference") | on(ALL, "energy balance")


INVARIANCE = ("left invariance", "equivariance", "error dynamics")
OF_PRODUCTS = ("product and inverse of G ⋉ g*", *INVARIANCE, "error velocity and energy")
DUAL, ENERGY = "Ad* is the dual of conjugation", "error velocity and energy"
OF_INERTIA = "feedforward of the error inertia"
VARYING = on("", "feedforward of a varying inertia", OF_INERTIA)
EXCHANGED = (DUAL, OF_PRODUCTS[0], *INVARIANCE, "rate of Ad_{Q_d⁻¹}", OF_INERTIA)
TURNED = on("", *EXCHANGED) | on(ALL, *BALANCE)
OF_GRADIENT = on("", "gradient of Υ", CRITICAL) | on(ALL, SMALL, *BALANCE)

PLANTS = {
    # Gyroscopic: no power; nog has none.
    "g: sign": Planted("paper", in_torque(gyroscopic_sign), THROUGH - on("nog", WEIGHTS)),
    "c: sign": Planted("paper", in_torque(transport_sign), FORCED),
    "n: sign": Planted("paper", in_torque(connection_sign),
        on("gt,asym", WEIGHTS, POWER, *BALANCE)),
    "n: factor 2": Planted("paper", in_torque(connection_factor),
        on("gt,asym", WEIGHTS, POWER, *BALANCE)),
    "damping: sign": Planted("paper", in_torque(damping_sign), THROUGH | on(ALL, SMALL, *BALANCE)),
    "damping: frame": Planted("bluerov2", in_torque(spatial_damping_in_the_body_frame),
        THROUGH - on("gt", WEIGHTS) | on("eqt,nog,asym", *BALANCE)),
    "gradient term: sign": Planted("paper", in_torque(gradient_sign),
        THROUGH | on(ALL, SMALL, *BALANCE)),
    "gradient term: not transported":
        Planted("paper", in_torque(gradient_not_transported), CARRIED),
    "gradient term: not transported, SE(3)":
        Planted("bluerov2", in_torque(gradient_not_transported), CARRIED),
    "reference torque: missing": Planted("paper", in_torque(reference_torque_missing), FORCED),
    "inertia force: sign, factored": Planted("factored", in_torque(inertia_force_sign), FORCED),
    "inertia force: sign, prescribed": Planted("prescribed", in_torque(inertia_force_sign), FORCED),
    "stabilising feedforward: sign":
        Planted("satellite", in_torque(lambda law, s: -2 * law.compensation * s.inertia_force,
        Stabilising), on("feedforward", "stabilising control", *BALANCE)),
    "stabilising damping: sign": Planted("satellite",
        in_torque(lambda law, s: 2 * s.body_damping, Stabilising),
        on("feedforward,no feedforward", "stabilising control", SMALL, *BALANCE)),
    "S-dot: factor 2": Planted("factored", in_change(FactoredInertia, lambda A: 2 * A),
        VARYING | on(ALL, *BALANCE)),
    "S-dot: sign": Planted("satellite", in_change(FactoredInertia, lambda A: -A),
        VARYING | on("feedforward,no feedforward", *BALANCE)),
    "S-dot: skew part": Planted("factored", in_change(FactoredInertia, gyroscopic_change),
        on("", "feedforward of a varying inertia")),
    "I-dot: factor 2": Planted("prescribed", in_change(PrescribedInertia, lambda A: 2 * A),
        VARYING | on(ALL, *BALANCE)),
    "gradient of the potential: sign":
        Planted("paper", in_function(mechanics.gradient, negated), OF_GRADIENT),
    "gradient of the potential: factor 2":
        Planted("bluerov2", in_function(mechanics.gradient, doubled), OF_GRADIENT),
    # The theorem's control and the body's change together, so that they still agree for EqT.
    "ad*: sign": Planted("paper", in_method(MatrixLieGroup, "ad_star", negated),
        on("", "ad* is the dual of the bracket", OF_INERTIA) |
        on("", "left invariance", "error dynamics") | on("gt,nog,asym", WEIGHTS) | on(ALL, POWER) |
        on("gt,asym", *BALANCE)),
    "ad*: not transposed": Planted("bluerov2",
        in_method(MatrixLieGroup, "ad_star",
            lambda exact, G, V, P: apply_matrix(G.ad_matrix(V), P)),
        on("", "ad* is the dual of the bracket", *INVARIANCE, OF_INERTIA) | THROUGH |
        on(ALL, POWER, *BALANCE)),
    "Ad*: not transposed": Planted("bluerov2",
        in_method(MatrixLieGroup, "Ad_star",
            lambda exact, G, Q, P: apply_matrix(G.Ad_matrix(Q), P)),
        on("", DUAL, *OF_PRODUCTS, OF_INERTIA) | CARRIED),
    "Ad*: sign": Planted("paper", in_method(MatrixLieGroup, "Ad_star", negated),
        on("", DUAL, OF_PRODUCTS[0], "left invariance", ENERGY) | on(ALL, SMALL, *BALANCE)),
    "Ad: of the inverse": Planted("paper",
        in_method(EuclideanGroup, "Ad_matrix", lambda exact, G, Q: exact(G, G.inverse(Q))), TURNED),
    "Ad: sign of the translation":
        Planted("bluerov2", in_method(EuclideanGroup, "Ad_matrix",
            lambda exact, G, Q: 2 * np.tril(np.triu(exact(G, Q), -2), 2) - exact(G, Q)),
        on("", *EXCHANGED, ENERGY) | CARRIED),
    "eq. (5): sign of ad*": Planted("paper",
        in_function(lie_poisson,
            lambda exact, G, Q, P, V, tau: (exact(G, Q, P, V, tau)[0], tau - G.ad_star(V, P))),
        on("", *INVARIANCE) | on(ALL, *BALANCE)),
    "eq. (15): sign of P": Planted("paper",
        in_product("compose", lambda exact, S, X, Y: exact(S, X, (Y[0], -Y[1]))),
        on("", *OF_PRODUCTS) | THROUGH),
    "eq. (15): P not transported":
        Planted("paper", in_product("compose", lambda exact, S, X, Y: (X[0] @ Y[0], X[1] + Y[1])),
        on("", *OF_PRODUCTS) | THROUGH),
    "inverse of G ⋉ g*: sign": Planted("paper",
        in_product("inverse", lambda exact, S, X: (exact(S, X)[0], -exact(S, X)[1])),
        on("", *OF_PRODUCTS) - on("", "left invariance") | THROUGH),
    "eq. (19): sign of the force":
        Planted("paper", in_product("error_input",
            lambda exact, S, X_d, U, U_d: (exact(S, X_d, U, U_d)[0], -exact(S, X_d, U, U_d)[1])),
        on("", "error dynamics")),
    "eq. (20): Ad of X_d": Planted("paper",
        in_product("closed_loop_input",
            lambda exact, S, X_d, tau_d, U_E: exact(S, S.inverse(X_d), tau_d, U_E)), THROUGH),
    "eq. (20): sign": Planted("bluerov2",
        in_product("closed_loop_input",
            lambda exact, S, X_d, tau_d, U_E: 2 * tau_d - exact(S, X_d, tau_d, U_E)), THROUGH),
    "eq. (22): no feedforward": Planted("paper",
        in_function(identities.feedforward, lambda exact, s, P_E: 0 * P_E),
        on("", OF_INERTIA) | THROUGH),
    "eq. (27): no ad*": Planted("paper",
        in_product("Ad", lambda exact, S, Y, U: exact(S, (Y[0], 0 * Y[1]), U)),
        on("", "equivariance", "error dynamics") | THROUGH),
    "L: factor of the kinetic energy":
        Planted("paper", lambda monkeypatch:
        monkeypatch.setattr(Tracking, "lyapunov",
        property(lambda s: ((s.P_tilde * s.V_tilde).sum(axis=-1) +
        mechanics.potential(s.G, s.gains.K, s.Q_E)))), on("", ENERGY) | on(ALL, *BALANCE)),
    "dissipation: sign": Planted("paper",
        in_method(Family, "dissipation", lambda exact, law, s: -exact(law, s)), on(ALL, *BALANCE)),
    "inverse of the inertia: factor":
        Planted("paper", in_method(Inertia, "velocity",
            lambda exact, now, P: 1.001 * exact(now, P)),
        on("", "momentum of a velocity", ENERGY) | on(ALL, SMALL) | on("gt,asym", POWER, *BALANCE)),
    "GT: g = 0.6": Planted("paper", in_law("gt", gyroscopic=0.6), on("gt", WEIGHTS)),
    "GT: c = 0.6": Planted("paper", in_law("gt", transport=0.6), on("gt", WEIGHTS, POWER)),
    # On SO(3) with K_d a multiple of the identity, so that no run can tell the frames apart.
    "GT: K_d in space": Planted("paper", in_law("gt", damping="spatial"), on("gt", WEIGHTS)),
    "GT: K_d in space, SE(3)": Planted("bluerov2", in_law("gt", damping="spatial"),
        on("gt", WEIGHTS)),
    "stabilising: K_d in space": Planted("satellite",
        in_property(Tracking, "body_damping", damping_in_space),
        on("feedforward,no feedforward", "stabilising control")),
    "K_d: transposed": Planted("bluerov2",
        together(in_property(Tracking, "body_damping", transposed_damping),
        in_property(Tracking, "spatial_damping", transposed_spatial_damping)), THROUGH),
    "V_E: in the body": Planted("bluerov2",
        in_property(Tracking, "V_E", lambda exact, s: s.V_tilde),
        THROUGH - on("gt", WEIGHTS) | on("eqt,nog,asym", *BALANCE)),
    "state: inertia of t = 0": Planted("prescribed",
        in_method(ClosedLoop, "initial_state", initial_state_at_0),
        on("", "momentum of a velocity")),
    # The law is driven by V_d and its rate, so it does not see the force.
    "reference: no force of the inertia":
        Planted("kept velocity", in_method(MovingReference, "_driven",
        without_force_of_the_inertia), on("", "motion of the reference")),
    "reference: acceleration along a path":
        Planted("path", in_function(motions.motion_along,
        with_acceleration_of_first_factor_left_out), MOVED),
    "exp: Jacobian transposed": Planted("bluerov2",
        in_jacobian(with_jacobian_transposed), EXP),
    "exp: Jacobian left out": Planted("bluerov2", in_jacobian(with_jacobian_left_out), EXP),
    "log: Jacobian left out": Planted("bluerov2",
        in_method(EuclideanGroup, "log", log_without_jacobian), EXP),
    "exp: Jacobian of the plane transposed":
        Planted("plane", in_jacobian(with_jacobian_transposed), EXP),
    "SE_2(3): columns exchanged": Planted("extended poses",
        in_method(EuclideanGroup, "_columns", lambda exact, G, V: exact(G, V)[..., ::-1, :]), EXP),
    "product: Ad of the inverse": Planted("two bodies",
        in_method(ProductGroup, "Ad_matrix", of_the_inverse_in_the_second_factor), TURNED),
    # The bounds of two more rows lean on the drift of the poses that are drawn.
    "product: drift of the best factor":
        Planted("body and slider", in_method(ProductGroup, "drift", least_drift),
        on("", "drift of every part", DUAL, OF_PRODUCTS[0])),
    "critical points: index counts what rises":
        Planted("paper", lambda monkeypatch:
        monkeypatch.setattr(CriticalSet, "index",
        property(lambda each: int((each.hessian > each._zero).sum()))), on("", CRITICAL)),
    "critical points: Hessian, factor 2":
        Planted("bluerov2", in_function(critical_points._hessian, doubled), on("", CRITICAL)),
    "critical points: half-turns about other axes":
        Planted("attitude", in_function(critical_points._eigenspaces,
            lambda exact, values, vectors: exact(values, TURN @ vectors)), on("", CRITICAL)),
}  # fmt: skip

SYMPTOMS = {"decrease of L", "Q → Q_d", "P → P_d", "tracks"}
"""What a run shows of a fault depends on where it starts; the cause does not."""


@pytest.mark.parametrize(
    "experiment",
    [in_ci("verifies a whole experiment", name, unless=name == "paper") for name in EXPERIMENTS],
)
def test_without_a_fault_nothing_is_red(experiment):
    # In half a second, the errors of the satellite hardly move, and *tracks* asks that they do.
    longer = ["time.duration=1"] if experiment == "satellite" else []
    assert red_rows(experiment, *longer) == set()


FAST = ("n: factor 2", "inertia force: sign, prescribed", "ad*: sign", "eq. (20): Ad of X_d")
"""Four kinds, besides the one below; `make test-all` plants all of them."""


@pytest.mark.parametrize(
    "fault", [in_ci("one of many faults", fault, unless=fault in FAST) for fault in PLANTS]
)
def test_a_fault_turns_the_rows_red_that_are_about_it(fault, monkeypatch):
    experiment, plant, expected = PLANTS[fault]
    plant(monkeypatch)
    causes = {row for row in red_rows(experiment) if row[0] not in SYMPTOMS}
    assert causes == expected


@pytest.mark.parametrize(
    ("fault", "laws"),
    [
        ("damping: sign", ALL),
        in_ci("one of many faults", "gradient term: sign", ALL),
        in_ci("one of many faults", "stabilising damping: sign", "feedforward"),
    ],
)
def test_a_law_that_drives_the_error_up_is_seen_on_its_runs(fault, laws, monkeypatch):
    experiment, plant, _ = PLANTS[fault]
    plant(monkeypatch)
    rows = red_rows(experiment)
    assert on(laws, "decrease of L") <= rows
    assert fault != "damping: sign" or on(laws, "Q → Q_d", "P → P_d") <= rows


# The table of all of them -------------------------------------------------------------------------

PAGE = Path(__file__).parents[2] / "README.md"


def table():
    """All planted faults, with the rows that they turn red, as it stands on the page."""
    lines = ["| fault | planted in | rows of `eqt verify` that turn red |", "|---|---|---|"]
    for fault, (experiment, _, red) in PLANTS.items():
        config, changes = EXPERIMENTS[experiment]
        where = config + (", changed" if changes else "")
        lines.append(f"| {fault} | {where} | {'; '.join(_rows(red))} |")
    return "\n".join(lines)


def _rows(red):
    """Names of rows, with the laws where only some of those that run are meant."""
    named = {name: sorted(law for row, law in red if row == name) for name, _ in sorted(red)}
    said = {
        name: "all" if laws == sorted(ALL.split(",")) else ", ".join(laws)
        for name, laws in named.items()
    }
    return [name + (f" ({laws})" if laws else "") for name, laws in said.items()]


def test_the_page_has_the_table_of_all_faults():
    """To mend it, put there what `table()` gives."""
    assert table() in PAGE.read_text(encoding="utf-8")
