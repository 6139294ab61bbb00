"""Names that a module offers from elsewhere, imported when they are asked for; a stub lists them.

Type checkers read the same stub, so that a name stands in one place.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path
from typing import Any


def places(module: str) -> dict[str, str]:
    """The modules of the names that the stub beside a module imports."""
    stub = Path(str(sys.modules[module].__file__)).with_suffix(".pyi")
    return {
        alias.name: str(statement.module)
        for statement in ast.parse(stub.read_text("utf-8")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }


def asked(module: str, known: dict[str, str], name: str) -> Any:
    """What a module offers by a name, imported only then: figures bring Matplotlib, for one."""
    if name not in known:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    found = getattr(import_module(known[name]), name)
    setattr(sys.modules[module], name, found)
    return found
