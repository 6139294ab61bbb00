"""Components of a user's own, as the text of a plugin, and how plugins are forgotten."""

from eqt_cli.config.catalogue import KINDS, registry
from eqt_cli.core import registry as registries


def forget_plugins(monkeypatch):
    """As in a process that has loaded none."""
    monkeypatch.setattr(registries, "_loaded_plugins", {})
    for kind in KINDS:
        monkeypatch.setattr(registry(kind), "_plugins", {})


ESCAPE = """\
from dataclasses import dataclass
from typing import ClassVar
from eqt_cli.controllers import Controller

@dataclass(frozen=True)
class Escape(Controller):
    name: ClassVar[str] = "escape"
    title: ClassVar[str] = "Escape"

    def torque(self, s):
        return 20 * s.V_tilde**3
"""
SHIFTED = """\
from dataclasses import dataclass
from typing import ClassVar
from eqt_cli.engines.solve_ivp import SolveIvp

@dataclass(frozen=True)
class Shifted(SolveIvp):
    name: ClassVar[str] = "shifted"

    def solve(self, problem, workers=1, progress=lambda runs: None):
        solution = super().solve(problem, workers, progress)
        solution.states[:] += 0.01
        return solution
"""
EVERY_KIND = '''\
"""One component of every kind, each a copy of one of eqt's under another name."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.eqt import EqT
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.ensemble.poses.haar import Haar
from eqt_cli.ensemble.velocities.normal import Normal
from eqt_cli.groups.so3 import SO3
from eqt_cli.plots.figures.runs import RunsFigure
from eqt_cli.references.torque import TorqueReference


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
