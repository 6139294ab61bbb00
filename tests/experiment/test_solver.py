"""The engine of a configuration, and the one that redoes some of its runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest

from eqt_cli.core.problems import Problems
from eqt_cli.engines import engines
from eqt_cli.engines.base import Engine
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.engines.taylor import Taylor
from eqt_cli.experiment.solver import solver_from


@dataclass(frozen=True)
class Adams(SolveIvp):
    """An engine of eqt's own that comes first in the alphabet."""

    name: ClassVar[str] = "adams"
    cross_check_rank: ClassVar[int | None] = None


@dataclass(frozen=True)
class Borrowed(SolveIvp):
    """A plugin's engine, derived from one of eqt's."""

    name: ClassVar[str] = "borrowed"


Borrowed.__module__ = "eqt_plugin_of_a_test"


@pytest.fixture
def more_engines(monkeypatch: pytest.MonkeyPatch) -> None:
    engines.names()  # which scans
    monkeypatch.setitem(engines._found, "adams", Adams)
    monkeypatch.setitem(engines._plugins, "borrowed", Borrowed)
    monkeypatch.setattr(Taylor, "unavailable", classmethod(lambda cls: None))


def other(name: str) -> Engine | None:
    problems = Problems()
    solver = solver_from({"engine": name}, problems)
    problems.raise_if_any()
    assert solver is not None
    return solver.other


@pytest.mark.usefixtures("more_engines")
@pytest.mark.parametrize(
    ("name", "checked_by"),
    [
        ("solve_ivp", "taylor"),
        ("taylor", "solve_ivp"),
        ("adams", "solve_ivp"),
        ("borrowed", "solve_ivp"),
    ],
)
def test_the_alphabet_does_not_choose_who_cross_checks(name: str, checked_by: str) -> None:
    found = other(name)
    assert found is not None
    assert found.name == checked_by
