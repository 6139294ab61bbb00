"""Imports the names that a module re-exports only when they are used; a stub file lists them.

Type checkers read the same stub, so each name is written once.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path
from typing import Any


def places(module: str) -> dict[str, str]:
    """Return the module of each name that the stub beside a module imports."""
    stub = Path(str(sys.modules[module].__file__)).with_suffix(".pyi")
    return {
        alias.name: str(statement.module)
        for statement in ast.parse(stub.read_text("utf-8")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }


def imported(module: str, known: dict[str, str], name: str) -> Any:
    """Return the object of a name, and import its module, for example Matplotlib, only now."""
    if name not in known:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    value = getattr(import_module(known[name]), name)
    setattr(sys.modules[module], name, value)
    return value
