"""Executors, which compute numbered items: one per file, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.execution.executors.base import MOST_TRIES, Executor, Outcome, Task, TaskContext

executors = Registry("executor", __name__, Executor)

__all__ = ["MOST_TRIES", "Executor", "Outcome", "Task", "TaskContext", "executors"]
