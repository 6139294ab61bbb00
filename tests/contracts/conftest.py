"""Every component of every registry, eqt's own and the plugins of these tests, for shared tests.

A test takes one as an argument: `controller_class`, `engine_class`, and so on. A component that a
scan of its folder finds is tested without a further line, unless it has options that must be given:
those are in `OPTIONS`.
"""

from __future__ import annotations

import operator
import os
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugin_sources import forget_plugins

from eqt_cli.base.arrays import FUNCTIONS, register_symbols
from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.registry import load_plugin, registry
from eqt_cli.components.actuators import actuators
from eqt_cli.components.laws import Designed, controllers
from eqt_cli.components.references import PathFactor, references
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.waypoints import Waypoint
from eqt_cli.extend import ClosedLoop, Force, Gains, Inertia, group_named
from eqt_cli.loop.linearised import designed

TESTS = Path(__file__).parents[1]
PLUGINS = [*sorted(TESTS.glob("plugins/*.py")), TESTS.parent / "examples" / "runge_kutta.py"]
PLUGINS += [Path(file) for file in os.environ.get("EQT_PLUGINS", "").split()]  # of whoever asks
if "certificates" not in all_kinds():  # its extension is away
    PLUGINS.remove(TESTS / "plugins/certificates.py")

collect_ignore = [] if "certificates" in all_kinds() else ["test_certificates.py"]

ARGUMENTS = {"velocities": "velocity"}
"""Singulars that are not the plural without its s."""

OPTIONS: dict[str, dict[str, Any]] = {
    "torque": {"torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)", "1", "t", "sin(2*t)"]},
    "constant force": {"force": [0.1, -0.2, 0.3, 0.4, 0.5, -0.6]},
    "expression": {"force": ["cos(t)", "sin(t)", "1", "1", "t", "sin(2*t)"]},
    "restoring": {"weight": 2.0, "buoyancy": 1.5, "centre_of_mass": [0.1, 0.0, -0.2]},
    "gust": {"std": 0.1, "time_constant": 2.0},
    "dryden": {"linear": 0.2, "current": [3.0, 1.0, 0.5], "std": [1.0, 0.8, 0.5],
        "length": [200.0, 150.0, 50.0]},
    "payload": {"mass": 0.3, "at": [0.1, -0.1, 0.2], "since": 0.5},
    "limit": {"limit": 0.5},
    "rate_limit": {"rate": 0.5},
    "deadband": {"width": 0.4},
    "delay": {"ticks": [1, 2, 0, 3, 1, 2]},
    "scale": {"factor": 0.8},
    "quantisation": {"resolution": 0.4},
    "momentum_limit": {"momentum": 0.5},
    "wheels": {"pyramid": 0.95, "limit": 0.5, "momentum": 2.0, "start": 0.1},
    "gyros": {"pyramid": 0.95, "momentum": 0.5, "inertia": 0.1, "gain": 0.4, "limit": 0.5},
    "gravity_gradient": {"rate": 0.3, "inertia": [[1.0, 0.1, 0], [0.1, 2.0, 0], [0, 0, 2.5]]},
    "magnetorquers": {"limit": 0.2, "flux": ["2e-5", "3e-5*cos(t)", "3e-5*sin(t)"]},
    "b_dot": {"k": 4e4},
    "lever": {"at": [0.1, 0.2, 0.3]},
    "noise": {"std": 0.1},
    "lag": {"time_constant": 0.2},
    "drift": {"time": 5.0, "std": 0.1},
    "rate_loop": {"gains": 2.0, "cutoff": 3.0, "kd": 0.01, "feedforward": 0.1},
    "thrusters": {"matrix": [[1.0 * (row == k) + 0.1 * (k > 5) for k in range(8)] for row in
        range(6)], "low": -0.5, "high": 0.4, "time_constant": 0.2},
    "propellers": {"matrix": [[1.0 * (row == k) + 0.1 * (k > 5) for k in range(8)] for row in
        range(6)], "thrust_constant": 1e-3, "time_constant": 0.2, "low_speed": -20.0,
        "high_speed": 25.0, "astern": 0.8, "dead_speed": 6.0},
    "path": {"factors": [PathFactor("wz", "0.3*sin(t)"), PathFactor("wx", "0.1*t**2")]},
    "rates": {"rates": ["cos(t)", "sin(t)", "cos(t)*sin(t)", "1", "t", "sin(2*t)"]},
    "slew": {"to": {"rotvec": [0, 0.5, 1]}, "duration": 3.0},
    "waypoints": {"points": [Waypoint(0.0, "identity"), Waypoint(1.0, {"rotvec": [0.3, 0, 0]}),
        Waypoint(3.0, {"rotvec": [0, 0.5, 0.5]})]},
    "log": {"file": "motion.csv"},
    "swinging": {"frequencies": [1.0, 2.0, 0.5, 1.5, 0.1, 3.0]},
}  # fmt: skip
"""Of components that have no default for them; lists are cut to the dimension of the group."""

if "flat" in references.names():
    from eqt_cli.extensions.underactuated.flat import Knot

    snap = [Knot(0.0, [0.0, 0.1, 0.2]), Knot(3.0, [1.0, 2.0, 3.0])]
    OPTIONS["flat"] = {"minimum_snap": snap}

FILES = {
    "motion.csv": """t,qx,qy,qz,qw,x,y,z,wx,wy,wz,vx,vy,vz
0,0,0,0,1,0,0,0,0.3,0,0,1,0,0
1,0.6,0,0,0.8,1,0.5,0,0.5,0.2,0,1,0.5,0.1
3,0,0,0.8,0.6,1,2,3,0,0.1,0.4,0,0,1
"""
}
"""Those that options name."""

SLOW = {
    ("engine_class", "rk4_fixed"): "takes many steps; runge_kutta is an engine of a plugin, too",
    ("executor_class", "local"): "starts processes, as runs/test_executors.py does",
}
"""Components whose contracts take seconds, and why."""


@cache
def components() -> dict[str, list[type]]:
    """Of eqt and of the plugins in ``tests/plugins``, which stay unknown to the other tests."""
    with pytest.MonkeyPatch.context() as patch:
        forget_plugins(patch)
        for path in PLUGINS:
            load_plugin(path)
        # Code of a user's own is for any task, and no formula; some executors are somewhere. What
        # predicts by an accelerometer has sensors of its own: tests/extensions/navigation.
        return {
            kind: [
                each
                for each in registry(kind).all()
                if getattr(each, "tasks", True)
                and getattr(each, "at", None) != ""
                and getattr(each, "reads_specific_force", None) is not True
            ]
            for kind in all_kinds()
        }


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    for kind in all_kinds():
        argument = f"{ARGUMENTS.get(kind, kind[:-1])}_class"
        if argument in metafunc.fixturenames:
            found = [
                pytest.param(each, id=each.name, marks=[pytest.mark.ci(reason)] * bool(reason))
                for each in components()[kind]
                for reason in [SLOW.get((argument, each.name), "")]
            ]
            metafunc.parametrize(argument, found)


@pytest.fixture
def load_plugins() -> Any:
    """Load plugins, by the names of their files, for one test."""

    def load(*names: str) -> None:
        for path in PLUGINS:
            if path.stem in names:
                load_plugin(path)

    return load


def made(component: type, dimension: int = 3) -> Any:
    """A component with its default options."""
    kind = " force" if issubclass(component, Force) and component.name == "constant" else ""
    options = OPTIONS.get(component.name + kind, {})
    found = component(
        **{
            name: values[:dimension] if isinstance(values, list) else values
            for name, values in options.items()
        }
    )
    return found.with_files(FILES) if "file" in options else found


@pytest.fixture
def make() -> Any:
    return made


# A closed loop for whatever is looked at ----------------------------------------------------------


@pytest.fixture
def loop_with() -> Any:
    """A closed loop on a group, with a controller or a reference of one's own."""

    def loop(group: str = "SO3", controller: Any = None, reference: Any = None) -> ClosedLoop:
        law = controller or controllers.get("eqt")()
        moves = "track" in law.tasks
        G = group_named(group)
        m, random = G.dimension, np.random.default_rng(1)
        matrices = [random.uniform(-1, 1, (n, n)) / np.sqrt(n) for n in (m, G.size, m)]
        inertia, kp, kd = (A @ A.T + np.eye(len(A)) / 2 for A in matrices)
        if m == 3 and group == "SO3":  # principal moments that a body can have
            inertia = np.array([[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]])
        magnets = (made(actuators.get("magnetorquers"), m),) if law.commands == "dipole" else ()
        made_loop = ClosedLoop(
            group=G,
            inertia=Inertia(inertia, np.linalg.inv(inertia)),
            gains=Gains(kp, kd),
            reference=reference
            or (made(references.get("torque"), m) if moves else made(references.get("constant"))),
            controller=law,
            vehicle=Vehicle(actuators=magnets),
        )
        if not isinstance(law, Designed):
            return made_loop
        at_rest = np.broadcast_to(G.identity, (3, *G.identity.shape)), np.zeros((3, m))
        return designed(made_loop, np.zeros(3), *at_rest)

    return loop


def states_of(loop: ClosedLoop, batch: tuple[int, ...], seed: int = 3) -> np.ndarray:
    """Random flat states, with memory; the reference rests where the law is for a resting one."""
    G, random = loop.group, np.random.default_rng(seed)
    Q, Qd = (G.exp(random.standard_normal((*batch, G.dimension))) for _ in range(2))
    V, Vd = random.standard_normal((2, *batch, G.dimension))
    if "track" not in loop.controller.tasks:
        Vd = 0 * Vd
    found = loop.initial_state(Q, V, Qd, Vd)
    for name, where in loop.layout.slices.items():
        if name.startswith("controller."):
            found[..., where] = random.standard_normal(found[..., where].shape)
    return found


@pytest.fixture
def states() -> Any:
    return states_of


# Symbols ------------------------------------------------------------------------------------------


class Symbol:
    """A number that is no float: neither NumPy nor `if` can look into it."""

    def __init__(self, value: float) -> None:
        self.value = value

    def __bool__(self) -> bool:
        raise TypeError("a symbol is neither true nor false")

    def __float__(self) -> float:
        raise TypeError("a symbol is no number")


def _plain(x: Any) -> float:
    return x.value if isinstance(x, Symbol) else float(x)


def _applied(function: Any, *arguments: Any) -> Symbol:
    return Symbol(function(*map(_plain, arguments)))


for _name in ("add", "sub", "mul", "truediv", "pow", "neg"):
    _function = getattr(operator, _name)
    setattr(Symbol, f"__{_name}__", lambda *a, f=_function: _applied(f, *a))
    setattr(Symbol, f"__r{_name}__", lambda a, b, f=_function: _applied(f, b, a))

register_symbols(
    Symbol,
    {name: partial(_applied, getattr(np, name)) for name in FUNCTIONS}
    | {
        "less": partial(_applied, operator.lt),
        "where": partial(_applied, lambda condition, a, b: a if condition else b),
    },
)


@pytest.fixture
def symbols() -> Any:
    """Numbers as symbols, and back."""

    def to(values: np.ndarray | float) -> Any:
        found = np.empty(np.shape(values), dtype=object)
        for index, value in np.ndenumerate(np.asarray(values)):
            found[index] = Symbol(float(value))
        return found if found.shape else found[()]

    def back(values: np.ndarray) -> np.ndarray:
        return np.vectorize(_plain, otypes=[float])(values)

    return to, back
