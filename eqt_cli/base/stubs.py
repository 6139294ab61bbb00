"""Modules with many names, each imported when it is used, as a stub beside the module lists them.

Type checkers read the same stub.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def places(module: str) -> dict[str, str]:
    """Return the module of each name that the stub beside a module imports.

    ``*`` stands for the names in a stub of an extension, if it is there.
    """
    return _listed(Path(str(sys.modules[module].__file__)).with_suffix(".pyi"))


def _listed(stub: Path) -> dict[str, str]:
    modules: dict[str, str] = {}
    for statement in ast.parse(stub.read_text("utf-8")).body:
        if isinstance(statement, ast.ImportFrom):
            module = str(statement.module)
            if statement.names[0].name == "*":
                place = Path(__file__).parents[2].joinpath(*module.split("."))
                extension = place / "__init__.pyi" if place.is_dir() else place.with_suffix(".pyi")
                modules |= _listed(extension) if extension.exists() else {}
            else:
                modules |= dict.fromkeys((alias.name for alias in statement.names), module)
    return modules


def lazily(module: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__all__``, ``__getattr__`` and ``__dir__`` of a module by the stub beside it."""
    itself, modules = sys.modules[module], places(module)

    def imported(name: str) -> Any:
        """Return the object of a name, and import its module, for example Matplotlib, only now."""
        if name not in modules:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        value = getattr(import_module(modules[name]), name)
        setattr(itself, name, value)
        return value

    return sorted(modules), imported, lambda: sorted({*vars(itself), *modules})
