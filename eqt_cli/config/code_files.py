"""Code in C that a configuration names: its text, with the files beside it that it includes.

It is executed, so it is read as plugins are: that of a result only if it is trusted.
"""

import re
from hashlib import sha256
from pathlib import Path

from eqt_cli.config.plugins import trusted_text
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import ComponentError, InputError
from eqt_cli.core.files import text_of

MOST_DEPTH = 20
"""Of files that include others."""

_WHOLE = "#line 1 "
"""How a text begins that is whole already, as eqt keeps it beside a result."""

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"[^\n]*$', re.MULTILINE)
_ONCE = re.compile(r"^[ \t]*#[ \t]*pragma[ \t]+once[ \t]*$", re.MULTILINE)


def code_text(source: ConfigSource, name: str, trusted: bool) -> str:
    """The text of a C file, in which files in quotes stand instead of being included.

    Raises
    ------
    InputError
        If it cannot be had, or may not be executed.
    """
    try:
        text = trusted_text(source, name, trusted, "C file")
    except ComponentError as error:
        raise InputError(str(error.args[0]), *error.remedies) from error
    if source.stored_plugins is not None or text.startswith(_WHOLE):
        return text
    return _whole(source.folder / name, text, [])


def _whole(path: Path, text: str, above: list[Path]) -> str:
    """A text with those that it includes, seen from its folder; others stay as they are."""
    if len(above) > MOST_DEPTH:
        raise InputError(f"{path.name} includes itself: {MOST_DEPTH} files deep")
    parts, last, line = [f'{_WHOLE}"{_shown(path)}"\n'], 0, 1
    for found in _INCLUDE.finditer(text):
        beside = path.parent / found[1]
        if not beside.is_file():
            continue
        parts.append(text[last : found.start()])
        line += text.count("\n", last, found.end())
        included = text_of(beside, "it is included", InputError)
        parts.append(_whole(beside, included, [*above, path]))
        parts.append(f'\n#line {line} "{_shown(path)}"')
        last = found.end()
    whole = "".join([*parts, text[last:]])
    if not _ONCE.search(text):
        return whole
    guard = f"EQT_ONCE_{sha256(str(path.resolve()).encode()).hexdigest()[:16]}"
    return f"#ifndef {guard}\n#define {guard}\n{_ONCE.sub('', whole)}\n#endif\n"


def _shown(path: Path) -> str:
    """The name of a file, as a compiler is told of it."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", path.name)
