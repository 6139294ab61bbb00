"""Components of a user's own, as the text of a plugin, and how plugins are forgotten."""

import re
from uuid import uuid4

from eqt_cli.base import registry as registries
from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.registry import registry
from eqt_cli.config import document


def forget_plugins(monkeypatch, *, stranger=True):
    """As in a process that has loaded none, of a stranger, who has never executed one."""
    if stranger:
        monkeypatch.setattr(document, "EXECUTED", f".{uuid4().hex}")
    monkeypatch.setattr(registries, "_loaded_plugins", {})
    for kind in all_kinds():
        monkeypatch.setattr(registry(kind), "_plugins", {})


def begin_as_a_stranger():
    """Forget what an earlier test has loaded, for a fraction of the time of `forget_plugins`."""
    document.EXECUTED = f".{uuid4().hex}"
    if registries._loaded_plugins:
        registries._loaded_plugins = {}
        for kind in all_kinds():
            registry(kind)._plugins = {}


def component(text):
    """The source of a component: of imports, `name(BASE):` with the path of a class, and a body."""
    head, body = re.split(r":\n", text.lstrip(), maxsplit=1)
    imports, name, base = re.fullmatch(r"((?:.+\n)*)(\w+)\(([\w.]+)\)", head).groups()
    module, _, kind = base.rpartition(".")
    lines = (
        "from dataclasses import dataclass",
        "from typing import ClassVar",
        f"from {module} import {kind}",
        imports,
        "@dataclass(frozen=True)",
        f"class {name.title().replace('_', '')}({kind}):",
        f'    name: ClassVar[str] = "{name}"',
    )
    return "\n".join([*lines, body])


ESCAPE = component("""
escape(eqt_cli.components.laws.Controller):
    title: ClassVar[str] = "Escape"

    def torque(self, s):
        return 20 * s.V_tilde**3
""")
SHIFTED = component("""
shifted(eqt_cli.engines.solve_ivp.SolveIvp):
    def solve(self, problem, workers=1, progress=lambda runs: None):
        solution = super().solve(problem, workers, progress)
        solution.states[:] += 0.01
        return solution
""")
EVERY_KIND = '''\
"""One component of every kind, each a copy of one of eqt's under another name."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.components.laws import EqT
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.components.initial_states import Haar
from eqt_cli.components.initial_states import Normal
from eqt_cli.components.matrix_groups import SO3
from eqt_cli.figures.run_figures import RunsFigure
from eqt_cli.components.references import TorqueReference


class MyGroup(SO3):
    name: ClassVar[str] = "MyGroup"


@dataclass(frozen=True)
class MyLaw(EqT):
    name: ClassVar[str] = "my_law"


@dataclass(frozen=True)
class MyReference(TorqueReference):
    name: ClassVar[str] = "my_reference"


@dataclass(frozen=True)
class MyPoses(Haar):
    name: ClassVar[str] = "my_poses"


@dataclass(frozen=True)
class MyVelocities(Normal):
    name: ClassVar[str] = "my_velocities"


@dataclass(frozen=True)
class MyEngine(SolveIvp):
    name: ClassVar[str] = "my_engine"


@dataclass(frozen=True)
class MyFigure(RunsFigure):
    name: ClassVar[str] = "my_figure"
'''
