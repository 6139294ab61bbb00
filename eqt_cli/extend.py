"""Everything that a plugin needs, from one place: base classes, array functions, numbers, errors.

These names stay what they are from version to version, also for plugins whose source is kept in a
result. ``extend.pyi`` lists them. A plugin that is built upon a component of eqt imports that from
its own file, which is called as the component is: ``from eqt_cli.controllers.eqt import EqT``.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

PLACES = {
    alias.name: str(statement.module)
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for alias in statement.names
}
"""The modules of the names."""

__all__ = sorted(PLACES)


def __getattr__(name: str) -> Any:
    """What is asked for, imported only then: figures bring Matplotlib, and results h5py."""
    if name not in PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(PLACES[name]), name)
    return found


def __dir__() -> list[str]:
    return __all__
