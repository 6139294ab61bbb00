"""Matplotlib style sheets, refused with a reason where Matplotlib itself would only warn."""

import ast
import logging
import re
from pathlib import Path
from typing import Any

from matplotlib import rc_params_from_file, style

from eqt_cli.core.errors import EqtError, suggestion

Settings = dict[str, Any]

_CYCLE = re.compile(r"^\s*axes\.prop_cycle\s*:(.*)$", re.MULTILINE)


def read(name: str) -> Settings:
    """The settings of a sheet: a file, or one that Matplotlib has by name.

    Raises
    ------
    EqtError
        If there is no such sheet, or a line of it is wrong.
    """
    path = Path(name).expanduser()
    if path.is_file() or path.suffix or len(path.parts) > 1:
        return read_file(path)
    if name in style.library:
        found: Any = style.library[name]
        return dict(found)
    hint = suggestion(name, style.available) or f"; Matplotlib has: {', '.join(style.available)}"
    raise EqtError(f"style sheet '{name}' is neither a file nor one of Matplotlib's{hint}")


def read_file(path: Path) -> Settings:
    """The settings in a file.

    No part of it is executed, whatever the version of Matplotlib.

    Raises
    ------
    EqtError
        If it cannot be read, or a line is wrong.
    """

    def refuse(remark: logging.LogRecord) -> bool:
        message = remark.getMessage().strip().partition("\n")[0]
        if not message.startswith("Duplicate key"):  # where the last one wins
            raise ValueError(message)
        return False

    log = logging.getLogger("matplotlib")
    log.addFilter(refuse)
    try:
        _check_cycles(path.read_text(encoding="utf-8"))
        found: Any = rc_params_from_file(path, fail_on_error=True, use_default_template=False)
        return dict(found)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise EqtError(f"{path}: the style sheet cannot be read: {reason}") from error
    except ValueError as error:
        raise EqtError(f"{path}: the style sheet is wrong: {error}") from error
    finally:
        log.removeFilter(refuse)


def _check_cycles(text: str) -> None:
    """Refuse cyclers that reach for attributes, since Matplotlib before 3.11 evaluates them.

    It gives them no names but ``cycler``; without attributes nothing else can be reached.

    Raises
    ------
    ValueError
        If there is one, or one is no expression.
    """
    for cycle in _CYCLE.findall(text):
        try:
            nodes = list(ast.walk(ast.parse(cycle.strip().strip('"'), mode="eval")))
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            nodes = []
        if not nodes or any(isinstance(node, ast.Attribute) for node in nodes):
            raise ValueError(f"axes.prop_cycle is no cycler of literal values: {cycle.strip()}")
