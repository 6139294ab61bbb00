"""The taylor engine: the same numbers as solve_ivp, for any law, any neighbours and any threads.

Where engines are compared, or runs fail, native is looked at as well.

All but one test use compact code, which compiles in a fraction of the time. Errors are measured
at the sample points, against the same engine at the smallest tolerance of doubles or, where that
would beg the question, against solve_ivp.
"""

import dataclasses
import platform
import re
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller, controllers
from eqt_cli.controllers.eqt import EqT
from eqt_cli.controllers.family import Family
from eqt_cli.core import arrays
from eqt_cli.core.arrays import FUNCTIONS, clip
from eqt_cli.core.errors import TraceError
from eqt_cli.core.expressions import parse
from eqt_cli.core.leaves import with_leaves
from eqt_cli.engines import Problem, Status, stability, taylor, traced_loop
from eqt_cli.engines.native import Native
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.engines.taylor import EPSILON, SMALLEST_TOL, Taylor, integrator, library
from eqt_cli.engines.taylor.evaluation import AT_ONCE, compiled_function
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import FactoredInertia, Inertia
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.program import traced
from eqt_cli.references import references
from eqt_cli.references.constant import ConstantReference
from eqt_cli.references.log import LogReference
from eqt_cli.references.path import PathFactor, PathReference
from eqt_cli.references.rates import RatesReference
from eqt_cli.references.slew import SlewReference
from eqt_cli.references.torque import TorqueReference
from eqt_cli.references.waypoints import Waypoint, WaypointsReference
from eqt_cli.vehicle.sampling import Sampling
from eqt_cli.vehicle.vehicle import Vehicle

pytest.importorskip("heyoka", reason="the taylor extra is not installed")

PAPER = ["eqt", "gt", "nog", "asym"]
TORQUE = ["cos(t)", "sin(t)", "cos(t)*sin(t)"] * 9
INERTIA = np.array([[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]])


def any_matrix(n, seed):
    """A positive definite matrix with eigenvalues between ½ and about 2."""
    A = np.random.default_rng(seed).uniform(-1.0, 1.0, (n, n)) / np.sqrt(n)
    return A @ A.T + np.eye(n) / 2


def any_inertia(n, seed):
    matrix = any_matrix(n, seed)
    return Inertia(matrix, np.linalg.inv(matrix))


def loop_of(controller, G=None, reference=None, inertia=None):
    """A loop with gains that have no symmetry; with the paper's inertia on SO(3)."""
    G = G or group_named("SO3")
    m = G.dimension
    return ClosedLoop(
        group=G,
        inertia=inertia
        or (Inertia(INERTIA, np.linalg.inv(INERTIA)) if m == 3 else any_inertia(m, 1)),
        gains=Gains(any_matrix(G.size, 2), any_matrix(m, 3)),
        reference=reference or TorqueReference(TORQUE[:m]),
        controller=controller,
    )


def problem_of(loop, runs, duration=2.0, samples=9, seed=4):
    """Runs from anywhere, on a reference that starts anywhere."""
    G, random = loop.group, np.random.default_rng(seed)
    Q, Qd = (G.exp(random.standard_normal((runs, G.dimension))) for _ in range(2))
    V, Vd = random.standard_normal((2, runs, G.dimension))
    if "track" not in loop.controller.tasks:
        Vd = 0 * Vd
    return Problem(loop, loop.initial_state(Q, V, Qd, Vd), np.linspace(0.0, duration, samples))


def paper_problem(runs, duration=2.0, controller=None, samples=9):
    return problem_of(loop_of(controller or EqT()), runs, duration, samples)


def difference(one, other):
    """The largest difference of the states of each run."""
    return np.abs(one.states - other.states).max(axis=(1, 2))


def equal(one, other, runs=slice(None)):
    """Whether a solution has, bit for bit, what another has for some of its runs."""
    messages = np.array(other.messages)[runs].tolist()
    return (
        np.array_equal(one.states, other.states[runs], equal_nan=True)
        and np.array_equal(one.steps, other.steps[runs])
        and np.array_equal(one.status, other.status[runs])
        and one.messages == messages
    )


def assert_engines_agree(problem):
    """To 1e-8: a thousand rtol of solve_ivp, near half-turns, where the others err far less."""
    theirs = SolveIvp(rtol=1e-11, atol=1e-14, block=problem.runs).solve(problem)
    for engine in (Taylor(tol=1e-13), Native(rtol=1e-11, atol=1e-11)):
        ours = engine.solve(problem)
        assert not ours.status.any()
        assert difference(ours, theirs).max() < 1e-8, engine.name


# Agreement with solve_ivp -------------------------------------------------------------------------


def test_engines_agree_on_every_group_and_controller(law_on_group):
    """Every law where it is cheap to compile: contracts/test_programs.py has all on a product."""
    G, controller = law_on_group
    if controller.name != "eqt" and G.name == "SE3*SO2":
        pytest.skip("the same law on SO3 is tried")
    driven = "track" in controller.tasks
    torque = TORQUE[: G.dimension] if driven else [0.0] * G.dimension
    loop = loop_of(controller, G, TorqueReference(torque))
    assert_engines_agree(problem_of(loop, runs=2, duration=0.5, samples=3))


RECORDED = """\
t,qx,qy,qz,qw,wx,wy,wz
0,0,0,0,1,0.3,0,0.1
0.7,0.1,0,0,0.99498743710662,0.3,0.2,0.1
30,0,0.1,0,0.99498743710662,0,0.2,0
"""

REFERENCES = {
    "log": LogReference(file="a.csv").with_files({"a.csv": RECORDED}),
    "constant": ConstantReference(),
    "torque": TorqueReference(["exp(-t)", 1, "sqrt(1 + t**2)"]),
    "rates": RatesReference(["cos(t)", 1, "sqrt(1 + t**2)"]),
    "path": PathReference([PathFactor("wz", "0.3*sin(t)"), PathFactor("wx", "0.1*t**2")]),
    "slew": SlewReference(to={"rotvec": [0, 0.5, 1]}, start=0.2, duration=0.5),
    "waypoints": WaypointsReference(
        points=[
            Waypoint(0.0, "identity"),
            Waypoint(0.7, {"rotvec": [0.3, 0, 0]}),
            Waypoint(30.0, {"rotvec": [0, 0.5, 0.5]}),
        ]
    ),
}


DENSE = WaypointsReference(
    points=[Waypoint(0.15 * k, {"rotvec": [0.1 * k, 0, 0.02 * k**2]}) for k in range(15)]
)


@pytest.mark.parametrize("name", references.names())
def test_engines_agree_on_every_reference(name):
    assert_engines_agree(problem_of(loop_of(EqT(), reference=REFERENCES[name]), runs=2))


@pytest.mark.parametrize("name", ["eqt", "stabilising"])
def test_engines_agree_with_a_time_varying_inertia(name):
    rows = (("1 + t/4", "0", "0"), ("sin(t)/5", "1", "0"), ("0", "0", "exp(-t/9)"))
    factor = tuple(tuple(parse(entry) for entry in row) for row in rows)
    loop = loop_of(controllers.get(name)(), inertia=FactoredInertia(INERTIA, factor))
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


@pytest.mark.parametrize(
    "first", range(0, len(TEXTS), 3), ids=lambda k: ", ".join(TEXTS[k : k + 3])
)
def test_expressions_of_the_grammar(first):
    """Three at a time, one for each axis."""
    texts = [*TEXTS, "0", "t"][first : first + 3]
    assert_engines_agree(problem_of(loop_of(EqT(), reference=TorqueReference(texts)), 2))


class Limited(EqT):
    """EqT with its torque cut off at ±1, as runs far from the reference ask for more."""

    def torque(self, s):
        return clip(super().torque(s), -1.0, 1.0)


@pytest.mark.parametrize(
    "law",
    [EqT(), pytest.param(Limited(), marks=pytest.mark.slow("solve_ivp steps over many limits"))],
    ids=["smooth", "limited"],
)
def test_knots_are_passed_as_if_each_piece_were_solved_by_itself(law):
    """Every lane comes to a knot at its own step, and a law's comparisons go on there."""
    problem = problem_of(loop_of(law, reference=DENSE), runs=7, samples=2)
    knots = problem.loop.knots
    times = np.array([*knots[knots < 2.0], 2.0])
    assert len(times) > 10
    states = problem.states
    for piece in pairwise(times):
        part = Problem(problem.loop, states, np.array(piece))
        states = Taylor(tol=1e-14).solve(part).states[:, -1]
    whole = Taylor(tol=1e-14).solve(problem)
    assert not whole.status.any()
    # Measured 1e-14 for the smooth law; a comparison switches within 1e-12 of its place.
    np.testing.assert_allclose(whole.states[:, -1], states, rtol=0, atol=1e-11)
    assert_engines_agree(problem)


def test_initial_time_need_not_be_zero():
    whole = paper_problem(runs=2, duration=4.0, samples=41)
    first = Taylor(tol=1e-13).solve(whole).states
    rest = Problem(whole.loop, first[:, 20], whole.times[20:])
    again = Taylor(tol=1e-13).solve(rest).states
    # Both halves are exact to the tolerance, amplified by less than ten in two seconds.
    np.testing.assert_allclose(again, first[:, 20:], rtol=0, atol=1e-12)


# Accuracy -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_problem():
    return paper_problem(runs=40, duration=10.0, samples=101)


@pytest.fixture(scope="module")
def exact(long_problem):
    return Taylor(tol=EPSILON).solve(long_problem)


@pytest.mark.parametrize("tol", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_errors_follow_the_tolerance(long_problem, exact, tol):
    """Measured: the median between 0.03 and 0.3 tol, the largest up to 8 tol."""
    errors = difference(Taylor(tol=tol).solve(long_problem), exact)
    assert errors.max() < 50 * tol
    assert 1e-3 * tol < np.median(errors) < tol


@pytest.mark.parametrize("tol", [1e-6, 1e-9, 1e-12])
def test_a_tenth_of_the_tolerance_estimates_the_error(long_problem, exact, tol):
    """What `error_estimate` compares: within a factor 2 of the true error for nearly all runs.

    The tighter solve has an error of its own, which is on average a tenth of what it measures.
    """
    engine = Taylor(tol=tol)
    solution = engine.solve(long_problem)
    estimate = difference(solution, engine.tightened(0.1).solve(long_problem))
    ratio = estimate / difference(solution, exact)
    assert np.mean((ratio > 0.5) & (ratio < 2)) > 0.9
    assert (ratio > 0.1).all()


@pytest.mark.slow("compiles full code, for many states")
def test_full_code_agrees_with_compact_code(long_problem, exact):
    full = Taylor(tol=1e-10, code="full").solve(long_problem)
    assert difference(full, exact).max() < 50 * 1e-10
    assert equal(Taylor(tol=1e-10, code="full").solve(long_problem.select([7])), full, [7])


# What a run's numbers depend on -------------------------------------------------------------------


@pytest.fixture(scope="module", params=[REFERENCES["torque"], DENSE], ids=["torque", "waypoints"])
def alone(request):
    """More runs than two batches of lanes, and not a multiple of any number of lanes."""
    problem = problem_of(loop_of(EqT(), reference=request.param), runs=21)
    return problem, Taylor().solve(problem)


@pytest.mark.parametrize("seed", range(3))
def test_permuted_runs_are_bit_identical(alone, seed):
    problem, whole = alone
    order = np.random.default_rng(seed).permutation(problem.runs)
    assert equal(Taylor().solve(problem.select(order)), whole, order)


@pytest.mark.parametrize("runs", [[0], [20], [3, 17], list(range(8)), list(range(1, 10)), [5] * 9])
def test_neighbours_change_no_bit(alone, runs):
    problem, whole = alone
    assert equal(Taylor().solve(problem.select(runs)), whole, runs)


@pytest.mark.parametrize("workers", [2, 3, 64])
def test_number_of_workers_changes_no_bit(alone, workers):
    problem, whole = alone
    assert equal(Taylor().solve(problem, workers), whole)


def test_first_sample_is_the_initial_state(alone):
    problem, whole = alone
    assert (whole.states[:, 0] == problem.states).all()


@pytest.mark.parametrize("reference", [REFERENCES["torque"], DENSE], ids=["torque", "waypoints"])
def test_sample_grid_changes_no_bit(reference):
    """Samples are read off the same steps, wherever they are, also where a span has none."""
    fine = problem_of(loop_of(EqT(), reference=reference), runs=3, samples=17)
    coarse = Problem(fine.loop, fine.states, fine.times[::4])
    assert (Taylor().solve(coarse).states == Taylor().solve(fine).states[:, ::4]).all()


@pytest.mark.parametrize("workers", [1, 2])
def test_progress_adds_up_to_the_number_of_runs(alone, workers):
    problem, _ = alone
    reports = []
    Taylor().solve(problem, workers, reports.append)
    assert sum(reports) == problem.runs
    assert len(reports) > 1


def test_progress_adds_up_over_instants():
    reference = TorqueReference(["step(t, 0.5)", "step(t, 1)", 0.0])
    reports = []
    Taylor().solve(problem_of(loop_of(EqT(), reference=reference), runs=5), progress=reports.append)
    assert sum(reports) == pytest.approx(5)
    assert len(reports) > 2


def test_an_error_in_one_thread_ends_all(alone):
    problem, _ = alone

    def interrupt(runs):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Taylor().solve(problem, 2, interrupt)


# Runtime parameters -------------------------------------------------------------------------------


@pytest.fixture
def compilations():
    """How many integrators have been compiled since."""
    integrator.compiled.cache_clear()
    return lambda: integrator.compiled.cache_info().misses


def test_one_compilation_serves_the_family(compilations):
    """The paper's four laws and any other point, with any inertia and gains."""
    for index, controller in enumerate([*(controllers.get(name)() for name in PAPER), Family()]):
        loop = loop_of(controller, inertia=any_inertia(3, index))
        gains = Gains(any_matrix(3, index), any_matrix(3, index + 1))
        loop = dataclasses.replace(loop, gains=gains)
        Taylor().solve(problem_of(loop, runs=1, duration=0.1))
    assert compilations() == 1


def test_a_loop_is_traced_once(monkeypatch):
    loops, trace = [], traced_loop.trace
    monkeypatch.setattr(traced_loop, "trace", lambda loop: loops.append(loop) or trace(loop))
    problem = problem_of(loop_of(EqT()), runs=2, duration=0.1)
    for tol in (1e-8, 1e-9):
        Taylor(tol=tol).solve(problem)
    assert loops == [problem.loop]


CACHE_OF_A_PROCESS = """
from eqt_cli.engines.taylor.library import heyoka_module
compiler = heyoka_module().llvm_state
print(compiler.get_diskcache_path(), compiler.get_diskcache_limit())
"""


@pytest.mark.parametrize(
    "own",
    [False, pytest.param(True, marks=pytest.mark.slow("starts an interpreter once more"))],
    ids=["default", "HEYOKA_CACHE_DIR"],
)
def test_compiled_laws_are_kept_in_a_small_file_of_their_own(tmp_path, monkeypatch, own):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("HEYOKA_CACHE_DIR", raising=False)
    if own:
        monkeypatch.setenv("HEYOKA_CACHE_DIR", str(tmp_path / "mine"))
    told = subprocess.run(
        [sys.executable, "-c", CACHE_OF_A_PROCESS], capture_output=True, text=True, check=True
    )
    path, limit = told.stdout.split()
    assert path == str(tmp_path / ("mine" if own else "eqt"))
    assert (int(limit) == library.CACHED_BYTES) is not own


def test_where_nothing_can_be_kept_laws_are_compiled_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "cache"))
    monkeypatch.delenv("HEYOKA_CACHE_DIR", raising=False)
    compile_one = "x = heyoka_module().make_vars('x'); heyoka_module().cfunc([x], [x])"
    code = f"from eqt_cli.engines.taylor.library import heyoka_module; {compile_one}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "loop",
    [
        loop_of(EqT(), reference=ConstantReference()),
        loop_of(controllers.get("stabilising")()),
        loop_of(EqT(), G=group_named("SE2")),
    ],
    ids=["reference", "controller", "group"],
)
def test_another_structure_is_another_compilation(compilations, loop):
    for each in (loop_of(EqT()), loop):
        Taylor().solve(problem_of(each, runs=1, duration=0.1))
    assert compilations() == 2


def test_parameters_may_differ_from_run_to_run():
    """And each run is, bit for bit, what it is with its parameters shared by all."""
    loop, runs = loop_of(Family()), 11
    problem = problem_of(loop, runs)
    random = np.random.default_rng(8)
    inertia = np.array([any_matrix(3, seed) for seed in range(runs)])
    varying = {
        "inertia.matrix": inertia,
        "inertia.inverse": np.linalg.inv(inertia),
        "gains.K": np.array([any_matrix(3, seed + 50) for seed in range(runs)]),
        "gains.K_d": np.array([any_matrix(3, seed + 99) for seed in range(runs)]),
        "controller.gyroscopic": random.uniform(-1, 1, (runs, 1)),
        "controller.spatial": (np.arange(runs) % 2.0)[:, None],
    }
    together = Taylor().solve(Problem(loop, problem.states, problem.times, varying))
    for run in range(runs):
        own = {name: values[run] for name, values in varying.items()}
        one = Problem(with_leaves(loop, own), problem.states[[run]], problem.times)
        assert equal(Taylor().solve(one), together, [run])


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
    assert_engines_agree(problem_of(loop_of(Own(SMOOTH_LAWS[name])), runs=2, duration=0.5))


@pytest.mark.parametrize("name", SMOOTH_LAWS)
def test_law_of_array_functions_may_start_on_the_reference(name):
    """Where every error is 0, and norms and powers of it have no series by themselves."""
    loop = loop_of(Own(SMOOTH_LAWS[name]))
    start = loop.initial_state(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3))
    assert_engines_agree(Problem(loop, start[None], np.linspace(0.0, 0.5, 6)))


WAY_OUT = (
    "; write it with operators, @ and the functions of eqt_cli.core.arrays, "
    "or use `engine: solve_ivp`"
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
    Sine: (
        "TypeError: loop of ufunc does not support argument 0 of type Symbol which has no "
        "callable sin method at test_taylor.py:LINE: return -np.sin(s.V)"
    ),
    Inverse: (
        "UFuncTypeError: Cannot cast ufunc 'inv' input from dtype('O') to dtype('float64') with "
        "casting rule 'same_kind' at test_taylor.py:LINE: "
        "return -np.linalg.inv(s.gains.K_d) @ s.V"
    ),
    Branch: (
        "TypeError: '>' not supported between instances of 'Symbol' and 'int' "
        "at test_taylor.py:LINE: return -s.V if s.V[..., 0] > 0 else s.V"
    ),
    Condition: (
        "TypeError: a symbol has no truth value; choose by where(less(a, b), x, y) "
        "at test_taylor.py:LINE: return -s.V if arrays.less(s.t, 1.0) else s.V"
    ),
    Assignment: (
        "TypeError: float() argument must be a string or a real number, not 'Symbol' "
        "at test_taylor.py:LINE: tau[..., 0] = s.V[..., 0]"
    ),
}


def trace_error(controller):
    """What is said of a law, without the lines."""
    with pytest.raises(TraceError) as caught:
        Taylor().solve(problem_of(loop_of(controller), runs=1))
    return re.sub(r"(\.py):\d+", r"\1:LINE", str(caught.value))


@pytest.mark.parametrize("law", UNTRACEABLE)
def test_message_of_a_law_that_cannot_be_traced(law):
    message = f"controller 'own' cannot be compiled: {UNTRACEABLE[law]}{WAY_OUT}"
    assert trace_error(law()) == message


@pytest.mark.parametrize("engine", [Taylor(), Native()], ids=lambda each: each.name)
def test_a_rehearsal_says_that_a_law_cannot_be_traced(engine):
    with pytest.raises(TraceError, match="a symbol has no truth value"):
        engine.rehearse(problem_of(loop_of(Condition()), runs=1))
    engine.rehearse(problem_of(loop_of(EqT()), runs=1))


def test_message_names_the_line():
    with pytest.raises(TraceError, match=r"at test_taylor\.py:(\d+): ") as caught:
        Taylor().solve(problem_of(loop_of(Sine()), runs=1))
    line = int(re.search(r"\.py:(\d+)", str(caught.value)).group(1))
    assert line == Sine.torque.__code__.co_firstlineno + 1


def test_message_of_a_law_that_asks_the_group_for_what_cannot_be_traced():
    message = trace_error(Drift())
    assert re.fullmatch(
        r"group 'SO3' cannot be compiled: .+ at base\.py:LINE: .+, "
        r"called by controller 'own' at test_taylor\.py:LINE: "
        r"return s\.G\.violation\(s\.Q\) \* s\.V" + re.escape(WAY_OUT),
        message,
    )


def test_message_of_a_torque_of_the_wrong_shape():
    message = trace_error(Own(lambda s: np.concatenate([s.V, s.V])))
    assert message.startswith("the closed loop cannot be compiled: ValueError: ")
    assert message.endswith(WAY_OUT)


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
FAULTS = {
    "escape": (Escaping, Status.NON_FINITE, NO_LONGER_FINITE),
    "root": (RootOfANegativeNumber, Status.NON_FINITE, NO_LONGER_FINITE),
    "pole": (Pole, Status.NON_FINITE, NO_LONGER_FINITE),
    "at_once": (NotANumberAtOnce, Status.NON_FINITE, NO_LONGER_FINITE),
    "rattling": (Rattling, Status.STEP_LIMIT, "step limit: 500 steps (solver.max_steps)"),
}
NO_STEP_IS_SHORT_ENOUGH = "no step is short enough: the state has no bound, or the law is singular"
OF_NATIVE = {
    "escape": (Status.SOLVER_FAILED, NO_STEP_IS_SHORT_ENOUGH),
    "pole": (Status.STEP_LIMIT, "step limit: 500 steps (solver.max_steps)"),
}
"""Where it ends otherwise: it comes closer to where the state has no bound."""


@pytest.fixture(params=[Taylor(max_steps=500), Native(max_steps=500)], ids=lambda each: each.name)
def fault_engine(request):
    """One that gives up after 500 steps."""
    return request.param


def faulty_problem(controller, faults):
    problem = problem_of(loop_of(controller()), runs=len(faults))
    varying = {"controller.fault": np.array(faults, dtype=float)[:, None]}
    return Problem(problem.loop, problem.states, problem.times, varying)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("workers", [1, 2])
def test_failing_run_gets_a_status_and_harms_no_other(fault, workers, fault_engine):
    """The fourth of ten runs fails; the others are, bit for bit, what they are without it."""
    controller, status, reason = FAULTS[fault]
    if fault_engine.name == "native":
        status, reason = OF_NATIVE.get(fault, (status, reason))
    problem = faulty_problem(controller, np.arange(10) == 3)
    solution = fault_engine.solve(problem, workers)
    assert solution.status[3] == status
    assert solution.messages[3].endswith(f" s: {reason}")
    others = np.delete(np.arange(10), 3)
    healthy = fault_engine.solve(problem.select(others))
    assert not healthy.status.any()
    assert equal(healthy, solution, others)


@pytest.mark.parametrize("fault", FAULTS)
def test_failing_run_keeps_its_samples_up_to_the_failure(fault, fault_engine):
    problem = faulty_problem(FAULTS[fault][0], [1])
    solution = fault_engine.solve(problem)
    at = float(re.search(r"t = (\S+) s", solution.messages[0]).group(1))
    known = np.isfinite(solution.states[0]).all(axis=1)
    # At a pole itself there is no state, but the message rounds to it.
    assert known.tolist() in ((problem.times <= at).tolist(), (problem.times < at).tolist())


def test_message_of_a_finite_time_escape():
    """Ṗ = P², from P = 1: infinite at t = 1."""
    loop = loop_of(Own(lambda s: s.P * s.P), G=group_named("SO2"))
    states = loop.initial_state(
        np.eye(2), loop.inertia.velocity(np.ones(1)), np.eye(2), np.zeros(1)
    )
    problem = Problem(loop, states[None], np.linspace(0.0, 2.0, 5))
    solution = Taylor().solve(problem)
    assert solution.status[0] == Status.NON_FINITE
    assert solution.messages == [f"t = 1 s: {NO_LONGER_FINITE}"]
    P = loop.tracking(problem.times, solution.states[0]).P[:, 0]
    np.testing.assert_allclose(P[:2], [1.0, 2.0], rtol=1e-8)  # 1 / (1 - t)


def test_message_of_a_root_of_a_negative_number():
    """heyoka does not say when; the last sample before it does."""
    solution = Taylor().solve(faulty_problem(RootOfANegativeNumber, [1]))
    assert solution.messages == [f"after t = 1 s: {NO_LONGER_FINITE}"]


def test_message_of_a_vector_field_that_is_not_finite_from_the_start():
    solution = Taylor().solve(faulty_problem(NotANumberAtOnce, [1]))
    assert solution.messages == [f"after t = 0 s: {NO_LONGER_FINITE}"]


def test_step_limit_bounds_the_steps():
    solution = Taylor(max_steps=5).solve(paper_problem(runs=3))
    assert solution.status.tolist() == [Status.STEP_LIMIT] * 3
    assert solution.steps.tolist() == [5] * 3
    assert re.fullmatch(
        r"t = \d\.\d+ s: step limit: 5 steps \(solver\.max_steps\)", solution.messages[0]
    )


def test_a_step_limit_that_a_period_has_used_up_ends_the_next():
    loop = dataclasses.replace(loop_of(EqT()), vehicle=Vehicle(control=Sampling(period=0.5)))
    steps = int(Taylor().solve(problem_of(loop, 1, duration=0.5, samples=2)).steps[0])
    solution = Taylor(max_steps=steps).solve(problem_of(loop, 1, samples=3))
    assert solution.messages == [f"t = 0.5 s: step limit: {steps} steps (solver.max_steps)"]
    assert solution.steps.tolist() == [steps]


# Options ------------------------------------------------------------------------------------------


def test_default_tolerance_is_a_tenth_of_rtol():
    assert Taylor(rtol=1e-7).step_tolerance == pytest.approx(1e-8)
    assert Taylor(rtol=1e-7, tol=1e-5).step_tolerance == 1e-5


def test_tightened_tolerance():
    engine = Taylor(rtol=1e-7, max_steps=9).tightened(0.1)
    assert engine.step_tolerance == pytest.approx(1e-9)
    assert (engine.rtol, engine.max_steps) == (1e-7, 9)
    assert Taylor(tol=1e-15).tightened(1e-3).step_tolerance == EPSILON


@pytest.mark.parametrize(("tol", "order"), [(0.9, 2), (0.1, 3), (1e-10, 13), (1e-15, 19)])
def test_work_for_stability_is_that_of_polynomials_of_heyokas_order(tol, order):
    """heyoka's order is the least whole number from 1 − ½ ln(tol) on, and 2 at least."""
    rates = np.array([[-50.0, -1.0], [-70.0, -2.0]])
    work = Taylor(tol=tol).work_for_stability(rates, 3.0)
    assert work == stability.steps(stability.taylor(order), rates, 3.0)


def test_smallest_tolerance_can_still_be_tightened():
    assert Taylor(tol=SMALLEST_TOL).tightened(0.1).step_tolerance == pytest.approx(EPSILON)


@pytest.mark.parametrize(
    ("engine", "problems"),
    [
        (Taylor(), []),
        (Taylor(tol=SMALLEST_TOL), []),
        (Taylor(tol=1e-15), [("tol", "expected a number from 2.22e-15 to 1, got 1e-15")]),
        (Taylor(tol=1.0), [("tol", "expected a number from 2.22e-15 to 1, got 1")]),
        (Taylor(rtol=1e-14), [("rtol", "expected a number from 2.22e-14 to 1, got 1e-14")]),
        (Taylor(rtol=5.0), [("rtol", "expected a number from 2.22e-14 to 1, got 5")]),
        (Taylor(rtol=5.0, tol=1e-9), []),
    ],
)
def test_tolerances_that_make_sense(engine, problems, noted):
    assert noted(engine) == problems


@pytest.mark.parametrize(
    ("runs", "length", "code"),
    [
        (1, 25, "compact"),
        (taylor.FULL_CODE_RUNS, 25, "full"),
        (taylor.FULL_CODE_RUNS - 1, 25, "compact"),
        (taylor.FULL_CODE_RUNS, taylor.FULL_CODE_STATES, "full"),
        (taylor.FULL_CODE_RUNS, taylor.FULL_CODE_STATES + 1, "compact"),
        (taylor.FULL_CODE_RUNS, 49, "compact"),
        (taylor.MUCH_WORK_RUNS, 49, "full"),
        (taylor.MUCH_WORK_RUNS - 1, 49, "compact"),
    ],
)
def test_code_follows_the_size_of_the_work(runs, length, code):
    assert Taylor().sized(runs, length).code == code
    assert Taylor(code="compact").sized(runs, length).code == "compact"


def test_a_block_fills_4_mebibytes_with_whole_batches_of_lanes():
    """16 runs of 1,310 samples of 25 numbers, and a bit; of more samples, one batch."""
    lanes = library.heyoka_module().recommended_simd_size()
    for samples, fitting in ((1310, 16), (2000, 10), (200_000, 0)):
        problem = paper_problem(runs=23, samples=samples)
        blocks = Taylor(code="full").blocks(problem)
        size = max(fitting // lanes * lanes, lanes)
        assert [len(block) for block in blocks] == [size] * (23 // size) + [23 % size]
        np.testing.assert_array_equal(np.sort(np.concatenate(blocks)), np.arange(23))
        speeds = [arrays.norm(problem.states[block]) for block in blocks]
        assert all(one.max() <= other.min() for one, other in pairwise(speeds))


@pytest.mark.parametrize(
    ("code", "reference", "cut"),
    [
        ("full", REFERENCES["torque"], True),
        ("full", DENSE, True),
        ("full", TorqueReference(["step(t, 1)", 0.0, 0.0]), False),
        ("compact", REFERENCES["torque"], False),
    ],
    ids=["large", "knots", "an instant", "small"],
)
def test_blocks_are_cut_of_large_works_that_need_not_wait(code, reference, cut):
    problem = problem_of(loop_of(EqT(), reference=reference), runs=23, samples=2000)
    assert (len(Taylor(code=code).blocks(problem)) > 1) == cut


def test_a_compiled_function_takes_its_numbers_from_everywhere():
    """More samples than are evaluated at once, of runs that share one of two parameters."""

    def function(given):
        state, (t,), (held,) = given["state"], given["time"], given["held"]
        first, second = given["parameters"]
        return {"one": np.array([t * state[0] + held]), "more": first * state[1:] + second}

    program = traced(function, {"state": 6, "time": 1, "parameters": 2, "held": 1})
    runs, samples, random = 3, AT_ONCE // 2 - 3, np.random.default_rng(3)
    rows = [random.normal(size=(runs, samples, length)) for length in (1, 2, 3)]
    times, held = random.normal(size=samples), random.normal(size=(samples, 1))
    parameters = np.column_stack([random.normal(size=runs), np.full(runs, 0.7)])
    found = compiled_function(program, 0).at_samples(times, rows, parameters, held)
    state = np.concatenate(rows, axis=-1)
    one = times[:, None] * state[..., :1] + held
    more = parameters[:, 0, None, None] * state[..., 1:] + 0.7
    np.testing.assert_allclose(found["one"], one, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found["more"], more, rtol=0, atol=1e-14)


def test_message_where_heyoka_is_missing(monkeypatch):
    monkeypatch.setattr(library, "find_spec", lambda name: None)
    monkeypatch.setattr(platform, "system", lambda: "Darwin")
    monkeypatch.setattr(platform, "machine", lambda: "arm64")
    assert Taylor.unavailable() == (
        "engine taylor needs heyoka: 'pip install heyoka' on Linux, 'conda install -c "
        "conda-forge heyoka.py' elsewhere (this is Darwin on arm64); or use engine solve_ivp"
    )
