"""Matplotlib style sheets, found, read and checked; it knows nothing of eqt's own look."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

from eqt_cli.core.errors import EqtError, suggestion

Settings = dict[str, Any]

SUFFIX = ".mplstyle"

_NOT_OF_STYLE = frozenset(
    {
        "backend",
        "backend_fallback",
        "date.epoch",
        "docstring.hardcopy",
        "figure.max_open_warning",
        "figure.raise_window",
        "interactive",
        "savefig.directory",
        "timezone",
        "tk.window_focus",
        "toolbar",
        "webagg.address",
        "webagg.open_in_browser",
        "webagg.port",
        "webagg.port_retries",
    }
)
"""Keys of a machine rather than of a figure, which Matplotlib too ignores in a style sheet."""

_DEFAULTS: Any = matplotlib.rcParamsDefault
_LINE = re.compile(r'(?P<content>(?:[^"#]|"[^"]*")*)(?:#.*)?')
_CYCLE = "axes.prop_cycle"
# What `cycler("color", ["r", "g"]) + cycler(lw=[1, 2])` is made of, and no more.
_OF_A_CYCLE = (
    ast.Expression,
    ast.Call,
    ast.keyword,
    ast.Name,
    ast.Load,
    ast.BinOp,
    ast.Add,
    ast.Mult,
    ast.Subscript,
    ast.Slice,
    ast.List,
    ast.Tuple,
    ast.Constant,
    ast.UnaryOp,
    ast.USub,
)


def read(name: str) -> Settings:
    """The settings of a sheet: a file, or one that Matplotlib ships or its user has installed.

    Raises
    ------
    EqtError
        If there is no such sheet, or a line of it is wrong.
    """
    return read_file(_found(name))


def read_file(path: Path) -> Settings:
    """The settings in a file of lines ``key: value``.

    No part of a sheet is executed, whatever the version of Matplotlib.

    Raises
    ------
    EqtError
        If it cannot be read, or a line is wrong; the message says which.
    """
    settings: Any = matplotlib.RcParams()  # by any key, and not only by those that its types list
    for place, key, value in _entries(path):
        if key in _NOT_OF_STYLE:
            continue
        if key not in _DEFAULTS:
            hint = suggestion(key, list(_DEFAULTS))
            raise EqtError(
                f"{place}: Matplotlib {matplotlib.__version__} has no setting '{key}'"
                f"{hint or '; leave it out'}"
            )
        try:
            if key == _CYCLE:
                _check_cycle(value)
            settings[key] = value
        except (ValueError, TypeError) as error:
            reason = str(error).removeprefix(f"Key {key}: ").rstrip(".")
            hint = _expected(key, value)
            raise EqtError(f"{place}: {key} cannot be '{value}': {reason}; {hint}") from error
    return dict(settings)


def available() -> list[str]:
    """The names of all sheets that need no path."""
    return sorted(
        path.stem
        for folder in _folders()
        for path in folder.glob(f"*{SUFFIX}")
        if not path.stem.startswith("_")
    )


def _found(name: str) -> Path:
    path = Path(name).expanduser()
    if path.suffix == SUFFIX or len(path.parts) > 1 or path.is_file():
        return path
    for folder in _folders():
        file = folder / f"{name}{SUFFIX}"
        if file.is_file():
            return file
    hint = suggestion(name, available()) or f"; Matplotlib has: {', '.join(available())}"
    raise EqtError(f"style sheet '{name}' is neither a file nor one of Matplotlib's{hint}")


def _folders() -> list[Path]:
    """Where Matplotlib looks for sheets: the user's own come first."""
    return [
        Path(root, "stylelib") for root in (matplotlib.get_configdir(), matplotlib.get_data_path())
    ]


def _entries(path: Path) -> Iterator[tuple[str, str, str]]:
    """Place, key and value of every line that says something."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise EqtError(f"{path}: is no style sheet: it is not UTF-8 text") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise EqtError(f"{path}: the style sheet cannot be read: {reason}") from error
    for number, line in enumerate(text.splitlines(), start=1):
        place = f"{path}:{number}"
        match = _LINE.fullmatch(line)
        if match is None:
            raise EqtError(f"{place}: a quotation mark (\") is not closed: '{line.strip()}'")
        content = match["content"].strip()
        if not content:
            continue
        key, colon, value = content.partition(":")
        if not colon:
            raise EqtError(f"{place}: expected 'key: value', got '{content}'")
        value = value.strip()
        if len(value) > 1 and value[0] == value[-1] == '"':
            value = value[1:-1]
        yield place, key.strip(), value


def _expected(key: str, value: str) -> str:
    """What to write in place of a value that cannot be."""
    if not value:
        return "'#' begins a comment, so write colours as E2E2E2"
    if key == _CYCLE:
        return 'write cycler("color", ["0072B2", "D55E00"])'
    return f"Matplotlib's own value is {_DEFAULTS[key]!r}"


def _check_cycle(text: str) -> None:
    """Let cyclers of literals pass only, since Matplotlib before 3.11 evaluates them as Python.

    Raises
    ------
    ValueError
        If it is anything else.
    """
    try:
        nodes = list(ast.walk(ast.parse(text, mode="eval")))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        nodes = []
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    literal = all(isinstance(node, _OF_A_CYCLE) for node in nodes)
    if not nodes or not literal or not names <= {"cycler", "concat"}:
        raise ValueError("it is no cycler of literal values")
