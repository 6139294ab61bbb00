"""Identities are proved by exact numbers, and faults are told that no rounding bound can tell."""

import dataclasses
import re
from fractions import Fraction
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from small_loops import closed_loop, expressions

from eqt_cli.components.inertia import FactoredInertia, Inertia, PrescribedInertia
from eqt_cli.components.laws import EqT, Family, controllers
from eqt_cli.components.mechanics import Gains, Semidirect, Tracking
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.extend import (
    ConstantReference,
    Drag,
    Goodarzi2013,
    Sliding,
    VectorGroup,
    dot,
    group_named,
    norm,
    parse,
    sqrt,
)
from eqt_cli.extensions.proofs import sample as proof
from eqt_cli.extensions.proofs.certificates import Identity, LiteralForm, Verdict, certificates
from eqt_cli.extensions.proofs.exact import Ledger, difference, free, noting
from eqt_cli.extensions.proofs.identities import (
    CriticalPoints,
    Drift,
    DualBracket,
    Exponential,
    FamilyForm,
    FeedforwardPower,
    LeftInvariance,
    LyapunovRate,
    SmallErrors,
    bracket,
)
from eqt_cli.extensions.proofs.sample import (
    ExactStates,
    Parameters,
    Proof,
    Refutation,
    UnprovableError,
    prove,
    sampled,
    written,
)

LAWS = [kind.name for kind in controllers.all() if kind.tasks]
"""Formulas; code of a user's own is none."""

GROUPS = ("SO2", "SO3", "SE2", "SE3", "R3", "SO3*R3")
"""Besides SE_2(3), of which a test of its own is marked slow."""


NINE_DIMENSIONS = pytest.mark.ci("nine dimensions, with rates in every product")


@pytest.fixture
def one_state(monkeypatch):
    """One exact state suffices, to 1e-15: enough to tell a fault, in a third of the time."""
    monkeypatch.setattr(proof, "CERTAIN", 1e-15)


def factored(m):
    S = [[parse(f"1 + t/{i + 2}" if i == j else "t/20") for j in range(m)] for i in range(m)]
    return FactoredInertia(np.eye(m), tuple(map(tuple, S)))


def prescribed(m):
    J = [[f"{i + 2} + sin(t)/5" if i == j else "t/50" for j in range(m)] for i in range(m)]
    return PrescribedInertia(expressions(J))


def states(loop, seed=0):
    return ExactStates("law", loop, np.random.default_rng(seed))


def outcome(identity, loop):
    return prove(identity.sides, states(loop))


def outcomes(loop, *, per_law=(False, True)):
    """What exact numbers say of every identity about a loop, by name; None of what is no claim."""
    known, found = states(loop), {}
    for identity in (kind() for kind in certificates.all() if issubclass(kind, Identity)):
        if identity.per_law in per_law and identity.applies(loop) and not identity.not_rational:
            try:
                found[identity.name] = prove(identity.sides, known)
            except Exception as error:
                found[identity.name] = error
    return found


def unproved(found):
    return {name for name, each in found.items() if each and not isinstance(each, Proof)}


def row(identity, loop):
    """Its row, by rounding bounds and by exact numbers."""
    sample = sampled("law", loop, 5.0, np.random.default_rng(0))
    [found] = identity.check(dataclasses.replace(sample, exact=states(loop)))
    return found


# What is proved -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", GROUPS)
@pytest.mark.usefixtures("one_state")
def test_identities_of_the_paper_are_proved_on_every_group(name):
    found = outcomes(closed_loop(group_named(name)))
    assert unproved(found) == set()
    assert len([each for each in found.values() if each]) >= 15


@NINE_DIMENSIONS
def test_identities_of_the_paper_are_proved_for_extended_poses():
    found = outcomes(closed_loop(group_named("SE23")))
    assert unproved(found) == set()
    assert max(each.probability for each in found.values() if each) < 1e-50


@pytest.mark.parametrize("inertia", [factored, prescribed])
@pytest.mark.usefixtures("one_state")
def test_identities_are_proved_for_every_inertia_that_varies(inertia):
    found = outcomes(closed_loop(group_named("SO3"), inertia=inertia(3)))
    assert unproved(found) == set()
    assert isinstance(found["feedforward of a varying inertia"], Proof)


NOT_PROVED = {"logarithmic": {"rate of L"}, "quaternion": {"rate of L"}}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.usefixtures("one_state")
def test_what_is_proved_of_every_law(name):
    law = controllers.get(name)()
    at_rest = "track" not in law.tasks
    parts = {"reference": ConstantReference()} if at_rest else {}
    found = outcomes(closed_loop(group_named("SO3"), law, **parts), per_law=[True])
    if law.matched is False:  # a law with gains of its own does not claim this
        assert not isinstance(found.pop("stiffness and damping of small errors"), Proof)
    assert unproved(found) == NOT_PROVED.get(name, set())


@pytest.mark.usefixtures("one_state")
def test_tanh_is_a_parameter():
    """Of log cosh, an absolute value is compared with 0, so that it is not proved."""
    found = outcome(LyapunovRate(), closed_loop(group_named("SO3"), Sliding()))
    assert isinstance(found, Proof)
    assert found.functions == "tanh() is a free parameter"
    loop = closed_loop(group_named("SO3"), Goodarzi2013(bound=0.4))
    assert row(SmallErrors(), loop).verdict is Verdict.UNCLAIMED
    found = row(LyapunovRate(), loop)
    assert found.verdict is Verdict.HOLDS
    assert re.fullmatch(
        r"the absolute value of a state is not rational, at classic_laws\.py:\d+: "
        r"size = absolute\(integral / self\.bound\)",
        found.not_proved,
    )


@pytest.mark.usefixtures("one_state")
def test_the_rate_of_L_is_proved_for_every_force_beside_the_law():
    loop = closed_loop(group_named("SO3"), vehicle=Vehicle(forces=(Drag(linear=0.1),)))
    assert isinstance(outcome(LyapunovRate(), loop), Proof)


@pytest.mark.usefixtures("one_state")
def test_options_are_the_dyadic_numbers_that_they_are():
    """0.9 + 0.1 is not 1 there, and the law says what it adds to the rate of L."""
    law = Family(gyroscopic=0.3, transport=0.9, connection=0.1)
    assert isinstance(outcome(LyapunovRate(), closed_loop(group_named("SO3"), law)), Proof)


# With what certainty ------------------------------------------------------------------------------


def test_so_many_states_as_the_probability_needs():
    loop = closed_loop(group_named("SO3"))
    found = outcome(LyapunovRate(), loop)
    assert (found.degree, found.points) == (20, 3)
    # Schwartz-Zippel, with 2^64 integers a parameter and next to no denominators.
    assert found.probability == pytest.approx((20 / 2**64) ** 3, rel=1e-12)
    assert found.probability < 1e-50


@pytest.mark.parametrize(
    ("divided", "chance"), [(0, Fraction(3, 2**64)), (2**63, Fraction(3, 2**63)), (2**64, None)]
)
def test_the_chance_counts_what_was_compared_and_what_must_not_vanish(divided, chance):
    ledger = Ledger(lambda: free(1))
    ledger.degree, ledger.compared = divided, 1
    known = SimpleNamespace(state=lambda *_: (None, ledger))
    if chance is None:
        with pytest.raises(UnprovableError, match="20 random states do not suffice"):
            prove(lambda _: iter([(free(0) * free(5), 0)]), known)
    else:
        found = prove(lambda _: iter([(free(0) * free(5), 0)]), known)
        assert found.probability == float(chance**found.points)


@pytest.mark.parametrize("identity", [LyapunovRate(), FamilyForm()])
def test_the_degree_is_that_of_the_numerator(identity):
    """On a line in the space of all parameters, its differences of order d + 1 vanish.

    The identity is made false, so that there is a numerator.
    """
    loop = closed_loop(group_named("SO3"), Wrong())
    random = np.random.default_rng(0)
    start, step = random.integers(-99, 99, (2, 2000)).tolist()

    def numerators(s):
        values = iter(a + s * b for a, b in zip(start, step, strict=True))
        parameters = SimpleNamespace(integers=lambda *_, **__: next(values))
        made = Parameters(parameters, 0)
        with noting(Ledger(made.one)):
            sample = states(loop)._sample(made)
            left, right = next(identity.sides(sample))
            return difference(np.ravel(left)[0], np.ravel(right)[0])

    first = numerators(0)
    values = [numerators(s).numerator for s in range(first.degree + 2)]
    assert any(values)
    differences = np.diff(np.array(values, dtype=object), first.degree + 1)
    assert differences.tolist() == [0]


def test_denominators_that_vanish_are_drawn_again(monkeypatch):
    draw, drawn = Parameters.symmetric, []

    def singular_at_first(self, size):
        drawn.append(size)
        return draw(self, size) * (0 if len(drawn) < 4 else 1)

    monkeypatch.setattr(Parameters, "symmetric", singular_at_first)
    found = outcome(LyapunovRate(), closed_loop(group_named("SO3")))
    assert isinstance(found, Proof)
    assert (found.points, len(drawn)) == (3, 3 * 2 + 4)  # K and 𝕀 of three states, and of two more


# Faults that no rounding bound can tell -----------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Wrong(EqT):
    """A term of 1e-30 too much."""

    name: ClassVar[str] = "eqt"
    matched: ClassVar[bool | None] = True
    dissipation = EqT.dissipation

    def torque(self, s):
        return super().torque(s) + Fraction(1, 10**30) * s.V_tilde


@dataclasses.dataclass(frozen=True)
class Exchanged(EqT):
    """Two factors of Q_d⁻¹Q exchanged, with a weight that rounds away."""

    name: ClassVar[str] = "eqt"
    matched: ClassVar[bool | None] = True
    dissipation = EqT.dissipation

    def torque(self, s):
        one, other = s.Q @ s.G.inverse(s.Qd), s.G.inverse(s.Qd) @ s.Q
        return super().torque(s) + Fraction(1, 10**30) * s.G.contract(one - other)


def ad_of_the_inverse(monkeypatch):
    """Ad of the inverse, in G ⋉ g*, by a part that rounds away."""

    def planted(self, Y, U):
        V, tau = exact(self, Y, U)
        other, _ = exact(self, self.inverse(Y), U)
        return V + Fraction(1, 10**30) * (other - V), tau

    exact = Semidirect.Ad
    monkeypatch.setattr(Semidirect, "Ad", planted)


PLANTED = {
    "a term": (Wrong(), {"rate of L", "weights (g, c, n, q) of the law"}),
    "two factors": (Exchanged(), {"rate of L", "weights (g, c, n, q) of the law"}),
    "Ad of the inverse": (EqT(), {"error dynamics"}),
}
COMMUTATIVE = ("SO2", "R3")


@pytest.mark.parametrize("name", [*GROUPS, pytest.param("SE23", marks=NINE_DIMENSIONS)])
@pytest.mark.parametrize("fault", PLANTED)
@pytest.mark.usefixtures("one_state")
def test_a_fault_of_1e_30_is_told_on_every_group(name, fault, monkeypatch):
    law, told = PLANTED[fault]
    if fault == "Ad of the inverse":
        ad_of_the_inverse(monkeypatch)
    loop = closed_loop(group_named(name), law)
    if name in COMMUTATIVE and fault != "a term":
        pytest.skip("factors commute, and Ad is the identity: there is no fault")
    for identity in (kind() for kind in certificates.all() if kind.name in told):
        # In floats it is rounded away, in exact numbers it is there.
        if name == "SO3":
            [rounded] = identity.check(sampled("", loop, 5.0, np.random.default_rng(0)))
            assert rounded.verdict is Verdict.HOLDS
        found = outcome(identity, loop)
        assert isinstance(found, Refutation), identity.name
        assert found.difference.denominator % 10**20 == 0  # of 10^30, whatever was cancelled


def test_a_fault_fails_with_the_exact_difference():
    found = row(LyapunovRate(), closed_loop(group_named("SO3"), Wrong()))
    assert found.verdict is Verdict.FAILS
    assert found.measured <= found.bound  # floats do not tell
    number = Fraction(found.difference)
    assert number.denominator % 10**20 == 0
    assert found.remark == (
        f"left − right = {written(number)} of equation 1, at a random state of small integers"
    )


# What cannot be proved says why -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("identity", "reason"),
    [
        (Exponential(), "exp and log are not rational"),
        (Drift(), "a distance is a square root"),
        (CriticalPoints(), "eigenvalues are roots of polynomials"),
    ],
)
def test_what_is_not_rational_is_named(identity, reason):
    found = row(identity, closed_loop(group_named("SO3")))
    assert found.verdict is Verdict.HOLDS
    assert (found.not_proved, found.remark) == (reason, f"not proved: {reason}")


@dataclasses.dataclass(frozen=True)
class Saturated(EqT):
    """Damping by Ṽ/√(1 + |Ṽ|²), with an energy of its own, and a norm."""

    name: ClassVar[str] = "saturated"

    def torque(self, s):
        size = sqrt(1 + dot(s.V_tilde, s.V_tilde))[..., None]
        return super().torque(s) + s.body_damping * 0 - s.V_tilde / size

    def dissipation(self, s):
        size = sqrt(1 + norm(s.V_tilde) ** 2)
        return EqT().dissipation(s) + norm(s.V_tilde) ** 2 / size


def test_roots_are_parameters_with_their_equation():
    loop = closed_loop(group_named("SO3"), Saturated())
    found = outcome(LyapunovRate(), loop)
    assert isinstance(found, Proof)
    assert found.functions == "sqrt() is a free parameter"


def test_a_difference_of_parameters_is_no_refutation():
    class Other(LiteralForm):
        """√(4 + 4x) is twice √(1 + x), which is not known of parameters."""

        name: ClassVar[str] = "twice a root"
        statement: ClassVar[str] = "own"
        section: ClassVar[float] = 1.0
        law: ClassVar[str] = "saturated"

        def sides(self, sample):
            x = sample.s.V
            yield sqrt(4 + 4 * x * x), 2 * sqrt(1 + x * x)

        def torque(self, s, law):
            return s.V

    found = row(Other(), closed_loop(group_named("SO3"), Saturated()))
    assert found.verdict is Verdict.HOLDS
    assert found.not_proved == "the sides differ where sqrt() is a free parameter"


class Leaving(VectorGroup):
    """Its algebra is not that of its Cayley transform."""

    def __init__(self):
        super().__init__(2)
        self.name = "Leaving"

    def cayley(self, V):
        Q = super().cayley(V)
        Q[..., -1, 0] = V[..., 0]
        return Q


def test_a_group_without_rational_poses_says_what_to_do():
    assert row(LeftInvariance(), closed_loop(Leaving())).not_proved == (
        "Cayley's transform leaves the group Leaving; give it a method `cayley` that does not"
    )


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (Fraction(-3, 10**30), f"-3/1{30 * '0'}"),
        (Fraction(2**300, 3**7), "9.314e+86 (a fraction of 95 digits)"),
        (-Fraction(3**50, 2**400), "-2.780e-97 (a fraction of 145 digits)"),
    ],
)
def test_a_fraction_is_written_in_full_or_shortened(number, text):
    assert written(number) == text


# A second proof, by other means -------------------------------------------------------------------


def symbols(sympy, name, *shape):
    return np.array(sympy.symbols(f"{name}:{int(np.prod(shape))}"), dtype=object).reshape(shape)


def expanded(sympy, left, right):
    gaps = np.ravel(np.asarray(left, dtype=object) - right)
    return {sympy.expand(sympy.nsimplify(gap, rational=True)) for gap in gaps}


@pytest.mark.ci("imports SymPy, which expands polynomials in 18 variables")
def test_sympy_proves_the_duality_of_ad():
    """ad* of SE(3), eq. (2), as polynomials."""
    sympy = pytest.importorskip("sympy")
    G = group_named("SE3")
    V, P, U = (symbols(sympy, name, 6) for name in "VPU")
    sample = SimpleNamespace(G=G, inputs=((V, P), (U, None)))
    for left, right in DualBracket().sides(sample):
        assert expanded(sympy, left, right) == {0}
        assert expanded(sympy, left, 2 * right) != {0}
    assert isinstance(outcome(DualBracket(), closed_loop(G)), Proof)


@pytest.mark.ci("imports SymPy, which expands polynomials in 15 variables")
@pytest.mark.parametrize("law", [EqT(), Family(0.5, 0.5, 0.5)])
def test_sympy_proves_the_power_of_the_feedforward(law):
    """§7: of EqT and of GT, on SO(3), as polynomials."""
    sympy = pytest.importorskip("sympy")
    G = group_named("SO3")
    J, V, Vd, tau_d, Q = (
        symbols(sympy, *of) for of in (("J", 3, 3), ("V", 3), ("W", 3), ("t", 3), ("Q", 3, 3))
    )
    J = np.triu(J) + np.triu(J, 1).T
    inertia, none = Inertia(J, np.eye(3)), Gains(np.zeros((3, 3)), np.zeros((3, 3)))
    s = Tracking(G, inertia, none, 0.0, Q, J @ V, Q, J @ Vd, tau_d)
    vars(s).update(V=V, Vd=Vd)  # 𝕀⁻¹𝕀V is V
    transport = dot(s.P_tilde, bracket(G, V, Vd))
    assert expanded(sympy, dot(law.torque(s) - tau_d, s.V_tilde), transport) == {0}
    wrong = law.torque(s) + Fraction(1, 10**30) * V
    assert expanded(sympy, dot(wrong - tau_d, s.V_tilde), transport) != {0}
    assert isinstance(outcome(FeedforwardPower(), closed_loop(G, law)), Proof)
