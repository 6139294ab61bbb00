"""A law in C, before any compiler reads it: what it claims, and what is noted of its options."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from eqt_cli.base.errors import InputError, Problems, TraceError
from eqt_cli.components.laws import claims, controllers, memory_gradient
from eqt_cli.extend import Gains, Inertia, Tracking, group_named
from eqt_cli.extensions.code.controllers import Code
from eqt_cli.numbers.leaves import with_fields

G = group_named("SO3")
GAINS = Gains(np.eye(3), np.diag([1.0, 2.0, 3.0]))
VALUES = ("feedforward_torque", "lyapunov", "velocity_error", "dissipation", "memory_rate")
"""Methods of a state."""


@pytest.fixture
def state():
    Q, Qd = G.exp(np.array([[0.3, -0.2, 0.5], [0.1, 0.4, -0.3]]))
    P, Pd, tau_d, integral = np.random.default_rng(0).standard_normal((4, 3))
    inertia = Inertia(np.diag([1.0, 2.0, 4.0]), np.diag([1.0, 0.5, 0.25]))
    return Tracking(G, inertia, GAINS, 0.0, Q, P, Qd, Pd, tau_d, {"integral": integral})


def notes(**options):
    problems, law = Problems(), Code(**{"file": "mine.c", **options})
    law.check(G, problems)
    law = with_fields(law, claimed=law.law_of(G, Problems()))
    return law, [(problem.path, problem.message) for problem in problems]


@pytest.mark.parametrize("name", ["eqt", "goodarzi2013", "logarithmic"])
def test_it_claims_what_the_law_claims_that_it_is(name, state):
    (code, noted), law = notes(as_=name), controllers.get(name)()
    assert noted == []
    for claim in ("energy", "theorem", "matched", "claims_decrease"):
        assert getattr(code, claim) == getattr(law, claim)
    assert code.formula == law
    assert claims(code, G, GAINS) is claims(law, G, GAINS)
    for value in VALUES:
        np.testing.assert_equal(getattr(code, value)(state), getattr(law, value)(state))
    np.testing.assert_equal(memory_gradient(code, state), memory_gradient(law, state))


def test_without_a_law_it_claims_nothing(state):
    code, noted = notes()
    assert noted == []
    assert (code.energy, code.theorem) == ("½⟨P̃, Ṽ⟩ + Υ(Q_E)", "")
    assert (code.matched, code.claims_decrease, code.formula) == (None, None, None)
    assert claims(code, G, GAINS) is None
    assert code.feedforward_torque(state) is None
    assert code.dissipation(state) is None
    assert memory_gradient(code, state) is None
    assert code.memory_rate(state) == {}
    assert code.lyapunov(state) == state.lyapunov
    np.testing.assert_array_equal(code.velocity_error(state), state.V_tilde)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"memory_": ["a", "b"]}, []),
        ({"memory_": ["a", "a"]}, [("memory", "expected different names, got ['a', 'a']")]),
        ({"memory_": ["a", "2b"]}, [("memory[1]", "expected a name in C, got '2b'")]),
        ({"numbers": {"k": 1.0, "k-d": 2.0}}, [("numbers.k-d", "expected a name in C, got 'k-d'")]),
        ({"function": "my_torque"}, []),
        ({"function": "torque"}, [("function", "expected a name X_torque, got 'torque'")]),
        ({"file": "my law.c", "function": "my_torque"}, []),
        ({"file": "my law.c"}, [("file", "my law.c gives no name in C; name the function with the "
         "key `function`")]),
        ({"as_": {"kind": "code", "file": "a.c"}}, [("as", "expected a law of eqt or of a plugin, "
         "got code")]),
    ],
)  # fmt: skip
def test_what_is_noted_of_its_options(options, expected):
    assert notes(**options)[1] == expected


@pytest.mark.parametrize(
    ("options", "prefix"),
    [({}, "mine"), ({"file": "laws/lee.v2.c"}, "lee.v2"), ({"function": "my_torque"}, "my")],
)
def test_the_name_of_its_functions(options, prefix):
    code = Code(**{"file": "mine.c", **options}).code
    assert code.prefix == prefix


class Compiled:
    """What stands for a compiled function: it notes what it is called with."""

    def __init__(self, **lengths):
        self.lengths = lengths
        names = (
            "t",
            "pose",
            "velocity",
            "desired_pose",
            "desired_velocity",
            "desired_acceleration",
        )
        self.code = SimpleNamespace(inputs=names, adapted=())

    def call(self, begins, numbers, period, memory, inputs):
        self.given = numbers, period, memory, inputs
        first = np.arange(float(sum(self.lengths.values())))
        later = np.broadcast_to(first, memory.shape) if begins else memory + 1.0
        return inputs[:, 10:13], later  # the velocity as the torque

    def call_in_runs(self, *how):
        return *self.call(*how), np.zeros(len(how[-1]), dtype=bool)


@pytest.fixture
def many(state):
    """States with two batch axes."""
    random = np.random.default_rng(1)
    V, Vd, tau_d = random.standard_normal((3, 2, 4, 3))
    Q, Qd = G.exp(random.standard_normal((2, 2, 4, 3)))
    P, Pd = state.inertia.momentum(V), state.inertia.momentum(Vd)
    changes = {"Q": Q, "P": P, "Qd": Qd, "Pd": Pd, "tau_d": tau_d, "memory": {}}
    return dataclasses.replace(state, t=np.linspace(0.0, 1.0, 4), **changes)


def test_it_is_called_with_a_row_for_every_state(many):
    """t, Q, V, Q_d, V_d and V̇_d, the poses row by row; without a period, that is 0."""
    function = Compiled(a=1, b=2)
    law = Code(file="mine.c", numbers={"k": 7.0, "J": [1.0, 2.0]}).calling(function, G)
    torque = law.torque(many)
    assert torque.shape == (2, 4, 3)
    np.testing.assert_allclose(torque, many.V, rtol=1e-15)
    numbers, period, memory, inputs = function.given
    assert numbers.tolist() == 8 * [[7.0, 1.0, 2.0]]
    assert (period, memory.shape, inputs.shape) == (0.0, (8, 3), (8, 28))
    expected = [
        np.r_[many.t[k], many.Q[i, k].ravel(), many.V[i, k], many.Qd[i, k].ravel(), many.Vd[i, k]]
        for i in range(2)
        for k in range(4)
    ]
    np.testing.assert_array_equal(inputs[:, :25], expected)
    np.testing.assert_array_equal(inputs[:, 25:], many.Vd_dot.reshape(8, 3))


def test_its_memory_goes_on_by_its_names(many):
    function = Compiled(a=1, b=2)
    law = Code(file="mine.c").calling(function, G)
    start = law.initial_memory(many)
    assert function.given[1] == 0.0
    assert {name: part.shape for name, part in start.items()} == {"a": (2, 4, 1), "b": (2, 4, 2)}
    assert start["b"][1, 3].tolist() == [1.0, 2.0]
    _, memory = law.answer(dataclasses.replace(many, memory=start), 0.02)
    assert function.given[1] == 0.02
    assert function.given[2].tolist() == 8 * [[0.0, 1.0, 2.0]]
    assert (memory["a"][1, 3].tolist(), memory["b"][0, 0].tolist()) == ([1.0], [2.0, 3.0])


def test_without_memory_there_is_none(many):
    law = Code(file="mine.c").calling(Compiled(), G)
    assert law.initial_memory(many) == {}
    assert law.answer(many, 0.02)[1] == {}


def test_code_is_not_compiled_into_a_loop(many):
    law = Code(file="mine.c").calling(Compiled(), G)
    with pytest.raises(TraceError) as caught:
        law.torque(dataclasses.replace(many, Qd=many.Qd.astype(object)))
    assert str(caught.value).startswith("mine.c is code, which is called and not compiled")


def test_the_memory_has_the_length_of_that_of_the_law():
    code, _ = notes(as_="goodarzi2013")
    running = code.calling(Compiled(ei=3), G)
    assert running.memory(G) == {"integral": 3}
    assert running.formula is code.formula
    with pytest.raises(InputError) as caught:
        code.calling(Compiled(ei=1, more=1), G)
    assert str(caught.value) == (
        "mine_memory in mine.c has 2 numbers that are named in `memory`, and goodarzi2013 keeps 3: "
        "integral (3)"
    )


def test_memory_of_its_own_has_the_names_of_its_fields():
    code, _ = notes(file="laws/mine.c")
    running = code.calling(Compiled(a=1, b=2), G)
    assert running.memory(G) == {"a": 1, "b": 2}
    assert running.function == "mine_torque"


def test_numbers_are_counted_in_their_order():
    law = Code(file="mine.c", numbers={"k": 1.0, "J": [1.0, 2.0, 3.0], "c": [4.0]})
    assert law.code.numbers == (("k", 1), ("J", 3), ("c", 1))
    assert law.values.tolist() == [1.0, 1.0, 2.0, 3.0, 4.0]


def test_laws_that_differ_in_numbers_only_have_one_structure():
    one = Code(file="mine.c", numbers={"k": 1.0})
    assert one.structure == Code(file="mine.c", numbers={"k": 2.0}).structure
    for change in ({"file": "other.c"}, {"numbers": {"c": 1.0}}, {"real": "float"}):
        assert dataclasses.replace(one, **change).structure != one.structure
