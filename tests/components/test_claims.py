"""Which laws claim that L falls, and on what they depend."""

from types import SimpleNamespace

import numpy as np
import pytest

from eqt_cli.api.loading import load_experiment
from eqt_cli.components.classic_laws import CancellingLaw, Goodarzi2013, Quaternion, Stabilising
from eqt_cli.components.laws import Family, claims, controllers
from eqt_cli.config.remarks import remarks
from eqt_cli.extend import Gains, Inertia, Tracking, group_named


@pytest.mark.parametrize(
    ("transport", "connection", "claimed"),
    [
        *((1.0, 0.0, True), (0.5, 0.5, True), (-0.3, 1.3, True), (0.1, 0.9, True)),
        (1 - 1e-13, 0.0, True),  # rounding of what is computed
        *((1 + 1e-13, 0.0, True), (1 - 1e-9, 0.0, False), (1 + 1e-9, 0.0, False)),
        *((0.5, 0.0, False), (1.0, 1.0, False), (1.0, -1.0, False), (-1.0, 0.0, False)),
    ],
)
def test_members_of_the_family_claim_it_on_the_plane(transport, connection, claimed):
    assert Family(transport=transport, connection=connection).claims_decrease is claimed


def test_the_gyroscopic_weights_do_not_matter():
    assert Family(gyroscopic=7.0, quadratic=-3.0).claims_decrease is True


def test_the_quadratic_term_has_its_weight():
    """−q ad*_Ṽ 𝕀Ṽ, on SO3 q Ṽ × 𝕀Ṽ."""
    G, moments, rest = group_named("SO3"), np.array([1.0, 2.0, 4.0]), np.zeros(3)
    inertia, V = Inertia(np.diag(moments), np.diag(1 / moments)), np.array([1.0, -2.0, 0.5])
    gains = Gains(np.eye(3), np.eye(3))
    s = Tracking(G, inertia, gains, 0.0, np.eye(3), moments * V, np.eye(3), rest, rest)
    difference = Family(quadratic=2.0).torque(s) - Family().torque(s)
    assert difference == pytest.approx(2 * np.cross(V, moments * V), abs=1e-14)


@pytest.mark.parametrize("feedforward", [True, False])
def test_stabilising_claims_it_with_its_feedforward(feedforward):
    assert Stabilising(feedforward=feedforward).claims_decrease is feedforward


def test_every_shipped_law_that_tracks_claims_it_or_asks_for_its_gains():
    claimed = {law.name: law().claims_decrease for law in controllers.all() if "track" in law.tasks}
    assert claimed.pop("goodarzi2013") is None  # its integral may be too strong for the gains
    assert claimed.pop("pd") is None  # it has no feedforward
    # Of extensions: designed for small errors, or for gains that its own state leaves open.
    for law in claimed.keys() & {"lqr", "eqr", "super_twisting", "geometric_adaptive"}:
        assert claimed.pop(law) is None
    assert set(claimed.values()) == {True}, claimed


def test_the_integral_of_goodarzi_follows_the_gains_unless_it_is_given():
    """0.1 · 2 kp on SO3, so that kp: 1 gives 0.2; a result follows them again at other gains."""
    data = {
        "group": "SO3",
        "inertia": 0.05,
        "gains": {"kp": 0.01, "kd": 0.02},
        "reference": {"kind": "constant"},
        "controllers": [
            "goodarzi2013",
            {"kind": "goodarzi2013", "label": "stiff", "gains": {"kp": 1}},
            {"kind": "goodarzi2013", "label": "given", "ki": 0.5},
        ],
        "time": {"duration": 5},
    }
    found = load_experiment(data)
    assert [loop.controller.ki for loop in found.base.loops.values()] == [0.002, 0.2, 0.5]
    written = found.base.resolved["controllers"]
    assert [entry.get("ki") for entry in written] == [None, None, 0.5]
    said = map(str, remarks(found.base, found.base.reference_over_horizon()))
    slow = "the loop of 'goodarzi2013' is slower than the runs last: small errors take "
    assert slow in next(said)


@pytest.mark.parametrize(
    "law", [law for law in controllers.all() if issubclass(law, CancellingLaw)]
)
def test_laws_that_cancel_all_other_forces_claim_what_their_damping_takes_out(law):
    """⟨K_d V, V⟩ before a target at rest."""
    G, gains = group_named("SO3"), Gains(np.eye(3), np.diag([1.0, 2.0, 3.0]))
    Q, V, rest = G.exp(np.array([0.3, -0.2, 0.5])), np.array([1.0, -2.0, 0.5]), np.zeros(3)
    s = Tracking(G, Inertia(np.eye(3), np.eye(3)), gains, 0.0, Q, V, G.identity, rest, rest)
    assert claims(law(), G, gains) is True
    assert law().dissipation(s) == pytest.approx(1 + 2 * 4 + 3 / 4, rel=1e-14)


@pytest.mark.parametrize("bound", [None, 0.3, 2.0])
def test_the_stored_energy_of_an_integral_has_its_force_as_gradient(bound):
    """d/de_I of the energy is k_I times the integral as the torque sees it; 0 at e_I = 0."""
    law, at, h = Goodarzi2013(ki=0.7, bound=bound), np.array([0.4, -0.2, 0.05]), 1e-6

    def stored(integral):
        return law._stored(SimpleNamespace(memory={"integral": integral}))

    slopes = [(stored(at + h * E) - stored(at - h * E)) / (2 * h) for E in np.eye(3)]
    force = law.ki * law._bounded(SimpleNamespace(memory={"integral": at}))
    assert slopes == pytest.approx(force, rel=1e-7)
    assert stored(np.zeros(3)) == pytest.approx(0.0, abs=1e-15)


def test_the_mean_stiffness_of_the_quaternion_law_is_a_third_of_the_trace():
    stiffness = np.array([[1.0, 0.3, 0.1], [0.3, 2.0, 0.4], [0.1, 0.4, 6.0]])
    assert Quaternion()._mean(SimpleNamespace(stiffness=stiffness)) == pytest.approx([3.0])


def test_a_member_says_in_which_errors_its_L_is():
    assert Family().energy == "½⟨P̃, Ṽ⟩ + Υ(Q_E)"
    assert Family(error="body").energy == "½⟨𝕀e, e⟩ + Υ(Q_L)"


def test_a_law_with_a_name_of_its_own_has_no_title_of_another():
    class Mine(Family):
        name = "mine"

    class Titled(Mine):
        name, title = "titled", "Titled"

    titles = Mine.title, Titled.title, type("Same", (Titled,), {}).title
    assert titles == ("mine", "Titled", "Titled")


def test_defaults_of_the_laws_are_those_of_their_documentation():
    """Where a configuration says nothing, they decide every number of a run."""
    expected = {
        "family": {"gyroscopic": 1.0, "transport": 1.0, "connection": 0.0, "quadratic": 0.0},
        "goodarzi2013": {"ki": 0.2, "c2": 0.5, "bound": None},
        "maithripala2006": {"damping_rate": 0.5},
        "slotine_li": {"slope": 0.5},
        "sliding": {"slope": 0.5, "gain": 0.5, "layer": 0.5},
        "stabilising": {"feedforward": True},
    }
    for name, options in expected.items():
        law = controllers.get(name)()
        assert {option: getattr(law, option) for option in options} == options


@pytest.mark.parametrize("name", [law.name for law in controllers.all() if law.tasks])
def test_gains_are_matched_where_small_errors_meet_them(name):
    """Where −∂τ/∂x is the Hessian of Υ and −∂τ/∂V is K_d, before a target at rest."""
    G, rest, h = group_named("SO3"), np.zeros(3), 1e-6
    inertia = Inertia(np.diag([1.0, 2.0, 4.0]), np.diag([1.0, 0.5, 0.25]))
    K, K_d = np.diag([1.0, 2.0, 4.0]), np.diag([0.7, 0.3, 0.4])
    law = controllers.get(name)()

    def torque(x, V):
        memory = {key: np.zeros(length) for key, length in law.memory(G).items()}
        Q, P = G.exp(x), inertia.momentum(V)
        s = Tracking(G, inertia, Gains(K, K_d), 0.0, Q, P, np.eye(3), rest, rest, memory)
        return law.torque(s)

    steps = h * np.eye(3)
    stiffness = [(torque(-d, rest) - torque(d, rest)) / (2 * h) for d in steps]
    damping = [(torque(rest, -d) - torque(rest, d)) / (2 * h) for d in steps]
    found = np.allclose(stiffness, np.diag([6.0, 5.0, 3.0]), rtol=0, atol=1e-6)
    found = found and np.allclose(damping, K_d, rtol=0, atol=1e-6)
    if name in (
        "goodarzi2013",
        "geometric_adaptive",
    ):  # its integral is the error, too, and makes it stiffer
        assert found and law.matched is False
    else:
        assert found is law.matched


def test_a_law_with_a_torque_of_its_own_makes_no_claim_of_another():
    class Other(Family):
        name = "other"

        def torque(self, s):
            return 2 * super().torque(s)

    class Claiming(Other):
        name, matched, claims_decrease = "claiming", False, True

        def torque(self, s):
            return super().torque(s)

    other = Other()
    assert (other.claims_decrease, other.matched) == (None, None)
    assert other.dissipation(None) is None
    assert other.feedforward_torque(None) is None
    assert (Claiming().claims_decrease, Claiming().matched) == (True, False)
    with pytest.raises(TypeError):
        type("Misspelt", (Family,), {}, titel="Mine")
