"""Laws in the compiled engine: the numbers of solve_ivp, and messages for what fails."""

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from small_loops import any_matrix, closed_loop, expressions

from eqt_cli.base import arrays
from eqt_cli.base.arrays import FUNCTIONS
from eqt_cli.base.errors import TraceError
from eqt_cli.components.inertia import FactoredInertia
from eqt_cli.components.laws import Controller, EqT, controllers
from eqt_cli.extend import Native, Problem, SolveIvp, Status, TorqueReference, group_named
from eqt_cli.loop.law_program import law_program

pytestmark = pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler")

SO3 = group_named("SO3")


def problem_of(loop, runs, duration=2.0, samples=9, seed=4):
    """Runs from anywhere, on a reference that starts anywhere."""
    G, random = loop.group, np.random.default_rng(seed)
    Q, Qd = (G.exp(random.standard_normal((runs, G.dimension))) for _ in range(2))
    V, Vd = random.standard_normal((2, runs, G.dimension))
    if "track" not in loop.controller.tasks:
        Vd = 0 * Vd
    return Problem(loop, loop.initial_state(Q, V, Qd, Vd), np.linspace(0.0, duration, samples))


def assert_engines_agree(problem):
    """To 1e-8: a thousand rtol of solve_ivp, near half-turns, where the others err far less."""
    theirs = SolveIvp(rtol=1e-11, atol=1e-14, block=problem.runs).solve(problem)
    ours = Native(rtol=1e-11, atol=1e-11).solve(problem)
    assert not ours.status.any()
    assert np.abs(ours.states - theirs.states).max() < 1e-8


# Agreement with solve_ivp -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["eqt", "stabilising"])
def test_engines_agree_with_a_time_varying_inertia(name):
    rows = (("1 + t/4", "0", "0"), ("sin(t)/5", "1", "0"), ("0", "0", "exp(-t/9)"))
    factor = expressions(rows)
    loop = closed_loop(
        SO3, controllers.get(name)(), inertia=FactoredInertia(any_matrix(3, 1), factor)
    )
    assert_engines_agree(problem_of(loop, runs=2, duration=0.5, samples=3))


# An argument for each function that stays in its domain as t goes from 0 to 2.
ARGUMENTS = {
    **dict.fromkeys(FUNCTIONS, "t/3"),
    "acosh": "1.5 + t",
    "log": "1 + t",
    "sqrt": "1 + t",
    "abs": "t - 1",
}


TEXTS = [
    *(f"{name}({argument})" for name, argument in ARGUMENTS.items()),
    *("(1 + t)**t", "2**t", "t**7", "(1 + t)**-0.5", "-t**2", "t**3/(1 + t)", "3*pi"),
]


def test_expressions_of_the_grammar():
    """A third of them in the sum about each axis."""
    texts = [" + ".join(f"({text})" for text in TEXTS[first::3]) for first in range(3)]
    assert_engines_agree(problem_of(closed_loop(SO3, reference=TorqueReference(texts)), 2))


# Laws of a user's own -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Own(Controller):
    """A law that is given as a function."""

    name: ClassVar[str] = "own"

    law: object = None

    def torque(self, s):
        return self.law(s)


SMOOTH_LAWS = {
    "tanh": lambda s: s.tau_d - arrays.tanh(s.gradient + 3 * s.V_tilde),
    "exp": lambda s: -s.V * arrays.exp(-s.V * s.V),
    "norm": lambda s: s.tau_d - s.V_tilde * arrays.norm(s.V_tilde)[..., None],
    "frobenius": lambda s: -s.gradient * arrays.frobenius(s.G.identity - s.Q_E)[..., None],
    "stack": lambda s: arrays.stack([s.V[..., 0], arrays.sin(s.t), arrays.cos(s.V[..., 1])]),
    "sqrt": lambda s: -s.V * arrays.sqrt(1 + arrays.dot(s.V, s.V))[..., None],
    "log": lambda s: -s.V * arrays.log(2 + arrays.dot(s.V, s.V))[..., None],
    "power": lambda s: -s.V * (1 + arrays.dot(s.V, s.V))[..., None] ** 0.3,
    "cube": lambda s: s.tau_d - s.V_tilde**3,  # s.V_tilde is 0 on the reference
    "numpy": lambda s: np.cross(s.V, s.P) - np.einsum("...i,i->...i", s.V, [1.0, 2.0, 3.0]),
    "constant": lambda s: np.array([0.1, 0.2, 0.3]),
}


@pytest.mark.parametrize("name", SMOOTH_LAWS)
def test_engines_agree_on_a_law_of_array_functions(name):
    """The second run starts on the reference, where norms of errors have no derivative."""
    loop = closed_loop(SO3, Own(SMOOTH_LAWS[name]))
    states = problem_of(loop, runs=2).states
    states[1] = loop.initial_state(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3))
    assert_engines_agree(Problem(loop, states, np.linspace(0.0, 0.2, 3)))


WAY_OUT = (
    "; write it with operators, @ and the functions of eqt_cli.extend, or use `engine: solve_ivp`"
)


class Sine(Own):
    def torque(self, s):
        return -np.sin(s.V)


class Inverse(Own):
    def torque(self, s):
        return -np.linalg.inv(s.gains.K_d) @ s.V


class Branch(Own):
    def torque(self, s):
        return -s.V if s.V[..., 0] > 0 else s.V


class Drift(Own):
    def torque(self, s):
        return s.G.violation(s.Q) * s.V


class Condition(Own):
    def torque(self, s):
        return -s.V if arrays.less(s.t, 1.0) else s.V


class Assignment(Own):
    def torque(self, s):
        tau = np.zeros(s.V.shape)
        tau[..., 0] = s.V[..., 0]
        return tau


UNTRACEABLE = {
    Sine: "TypeError: loop of ufunc does not support argument 0 of type Symbol which has no "
        "callable sin method at test_compiled_laws.py:LINE: return -np.sin(s.V)",
    Inverse: "UFuncTypeError: Cannot cast ufunc 'inv' input from dtype('O') to dtype('float64') "
        "with casting rule 'same_kind' at test_compiled_laws.py:LINE: return "
        "-np.linalg.inv(s.gains.K_d) @ s.V",
    Branch: "TypeError: '>' not supported between instances of 'Symbol' and 'int' at "
        "test_compiled_laws.py:LINE: return -s.V if s.V[..., 0] > 0 else s.V",
    Condition: "TypeError: a symbol has no truth value; choose by where(less(a, b), x, y) at "
        "test_compiled_laws.py:LINE: return -s.V if arrays.less(s.t, 1.0) else s.V",
    Assignment: "TypeError: float() argument must be a string or a real number, not 'Symbol' at "
        "test_compiled_laws.py:LINE: tau[..., 0] = s.V[..., 0]",
}  # fmt: skip


def trace_error(controller):
    """What is said of a law, without the lines."""
    with pytest.raises(TraceError) as caught:
        Native().rehearse(problem_of(closed_loop(SO3, controller), runs=1))
    return re.sub(r"(\.py):\d+", r"\1:LINE", str(caught.value))


@pytest.mark.parametrize("law", UNTRACEABLE)
def test_message_of_a_law_that_cannot_be_traced(law):
    message = f"controller 'own' cannot be compiled: {UNTRACEABLE[law]}{WAY_OUT}"
    assert trace_error(law()) == message


def test_message_of_a_law_that_asks_the_group_for_what_cannot_be_traced():
    message = trace_error(Drift())
    assert re.fullmatch(
        r"group 'SO3' cannot be compiled: .+ at groups\.py:LINE: .+, "
        r"called by controller 'own' at test_compiled_laws\.py:LINE: "
        r"return s\.G\.violation\(s\.Q\) \* s\.V" + re.escape(WAY_OUT),
        message,
    )


def test_message_of_a_torque_of_the_wrong_shape():
    message = trace_error(Own(lambda s: np.concatenate([s.V, s.V])))
    assert message.startswith("the closed loop cannot be compiled: ValueError: ")
    assert message.endswith(WAY_OUT)


class Forgetful(Own):
    def memory(self, G):
        return {"estimate": 3}

    def answer(self, s, period):
        return -s.V, {}


def test_message_of_an_answer_without_the_memory_of_the_law():
    with pytest.raises(TraceError, match=r"from answer and initial_memory: no 'estimate'"):
        law_program(closed_loop(SO3, Forgetful()))


# Runs that fail -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Faulty(Controller):
    """EqT, but for runs with a `fault` a torque that cannot be integrated."""

    name: ClassVar[str] = "faulty"

    fault: float = 0.0

    def torque(self, s):
        return EqT().torque(s) + self.bad_torque(s)


class Escaping(Faulty):
    def bad_torque(self, s):
        return self.fault * 4 * s.P * arrays.dot(s.P, s.P)[..., None]


class RootOfANegativeNumber(Faulty):
    def bad_torque(self, s):
        return arrays.sqrt(1 - self.fault * s.t) * s.P


class Pole(Faulty):
    def bad_torque(self, s):
        return s.P / (1 - self.fault * s.t)


class NotANumberAtOnce(Faulty):
    def bad_torque(self, s):
        return arrays.log(-self.fault + 0 * s.P + 0.5)


class Rattling(Faulty):
    def bad_torque(self, s):
        return self.fault * 1e4 * arrays.sin(1e5 * s.t) + 0 * s.P


NO_LONGER_FINITE = "the state or its derivative is no longer finite"
STEP_LIMIT = Status.STEP_LIMIT, "step limit: 500 steps (solver.max_steps)"
NO_STEP_IS_SHORT_ENOUGH = "no step is short enough: the state has no bound, or the law is singular"
FAULTS = {
    "escape": (Escaping, Status.SOLVER_FAILED, NO_STEP_IS_SHORT_ENOUGH),
    "root": (RootOfANegativeNumber, Status.NON_FINITE, NO_LONGER_FINITE),
    "pole": (Pole, *STEP_LIMIT),
    "at_once": (NotANumberAtOnce, Status.NON_FINITE, NO_LONGER_FINITE),
    "rattling": (Rattling, *STEP_LIMIT),
}
ENGINE = Native(max_steps=500)


def faulty_problem(controller, faults):
    problem = problem_of(closed_loop(SO3, controller()), runs=len(faults))
    varying = {"controller.fault": np.array(faults, dtype=float)[:, None]}
    return Problem(problem.loop, problem.states, problem.times, varying)


@pytest.mark.parametrize("fault", FAULTS)
def test_failing_run_gets_a_status_and_keeps_its_samples_up_to_the_failure(fault):
    controller, status, reason = FAULTS[fault]
    problem = faulty_problem(controller, [1])
    solution = ENGINE.solve(problem)
    assert solution.status[0] == status
    assert solution.messages[0].endswith(f" s: {reason}")
    at = float(re.search(r"t = (\S+) s", solution.messages[0]).group(1))
    known = np.isfinite(solution.states[0]).all(axis=1)
    # At a pole itself there is no state, but the message rounds to it.
    assert known.tolist() in ((problem.times <= at).tolist(), (problem.times < at).tolist())
