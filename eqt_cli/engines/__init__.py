"""Integrators: one file per engine, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.engines.base import Engine
from eqt_cli.engines.problem import Problem, Solution, Status

engines = Registry("engine", __name__, Engine)

__all__ = ["Engine", "Problem", "Solution", "Status", "engines"]
