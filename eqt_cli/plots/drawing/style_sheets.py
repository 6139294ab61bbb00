"""Matplotlib style sheets, refused with a reason where Matplotlib would only warn."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from matplotlib import RcParams, rcParamsDefault, style

from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.files import refusals
from eqt_cli.core.regular_files import text_in
from eqt_cli.plots.drawing import style_bounds

Settings = dict[str, Any]

_CYCLE = "axes.prop_cycle"

_WITHOUT_COMMENT = re.compile(r'(?:[^"#]|"[^"]*")*')

# Typed as Any, since the stubs do not list every key.
_DEFAULTS: Any = rcParamsDefault


def read(name: str) -> Settings:
    """Return the settings of a sheet: a file, or one of Matplotlib's by name.

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
    """Return the settings in a file.

    Nothing in it is executed, whatever the version of Matplotlib, and no line without a key of
    Matplotlib is quoted: the file may be no style sheet.

    Raises
    ------
    EqtError
        If it cannot be read, or a line is wrong.
    """
    with refusals(path, "read as a style sheet"):
        text = text_in(path)
    found: Any = RcParams()
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            for key, value in _setting(line):
                if key == _CYCLE:
                    style_bounds.check_cycle(value)
                found[key] = value
                if key not in style_bounds.OF_A_MACHINE:
                    style_bounds.check(key, found[key], _DEFAULTS.get(key))
        except (ValueError, TypeError) as error:
            raise EqtError(f"{path}:{number}: the style sheet is wrong: {error}") from error
    return {key: found[key] for key in found if key not in style_bounds.OF_A_MACHINE}


def _setting(line: str) -> Iterator[tuple[str, str]]:
    """Yield the key of a line and the text of its value; nothing for an empty line."""
    own = _WITHOUT_COMMENT.match(line)
    assert own is not None  # the pattern matches the empty string, too
    if line[own.end() :].startswith('"'):
        raise ValueError("a closing quotation mark is missing")
    if not own[0].strip():
        return
    key, colon, value = (part.strip() for part in own[0].partition(":"))
    if not colon:
        raise ValueError("expected 'key: value'")
    if key not in RcParams.validate:
        known = suggestion(key, RcParams.validate)
        raise ValueError(
            f"Matplotlib has no key {key}{known}" if known else "expected a key of Matplotlib"
        )
    yield key, value[1:-1] if len(value) > 1 and value[0] == value[-1] == '"' else value
