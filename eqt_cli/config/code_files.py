"""Reads C files that a configuration names, with the files that they include.

The code is executed, so it is read like a plugin: from a result only if the result is trusted.
"""

import re
from hashlib import sha256
from pathlib import Path

from eqt_cli.config.plugins import trusted_text
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import ComponentError, InputError
from eqt_cli.core.files import text_of

MAX_DEPTH = 20
"""Largest depth of files that include others."""

_EXPANDED = "#line 1 "
"""Prefix of a text whose includes are expanded already, as eqt stores it beside a result."""

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"[^\n]*$', re.MULTILINE)
_ONCE = re.compile(r"^[ \t]*#[ \t]*pragma[ \t]+once[ \t]*$", re.MULTILINE)


def code_text(source: ConfigSource, name: str, trusted: bool) -> str:
    """Return the text of a C file, with files included in quotes expanded in place.

    Raises
    ------
    InputError
        If the file cannot be read, or may not be executed.
    """
    try:
        text = trusted_text(source, name, trusted, "C file")
    except ComponentError as error:
        raise InputError(str(error.args[0]), *error.remedies) from error
    if source.stored_plugins is not None or text.startswith(_EXPANDED):
        return text
    return _expanded(source.folder / name, text, [])


def _expanded(path: Path, text: str, above: list[Path]) -> str:
    """Expand the includes in quotes that exist in the file's folder; others stay unchanged."""
    if len(above) > MAX_DEPTH:
        raise InputError(f"{path.name} includes itself: {MAX_DEPTH} files deep")
    parts, last, line = [f'{_EXPANDED}"{_shown(path)}"\n'], 0, 1
    for include in _INCLUDE.finditer(text):
        file = path.parent / include[1]
        if not file.is_file():
            continue
        parts.append(text[last : include.start()])
        line += text.count("\n", last, include.end())
        included = text_of(file, "it is included", InputError)
        parts.append(_expanded(file, included, [*above, path]))
        parts.append(f'\n#line {line} "{_shown(path)}"')
        last = include.end()
    expanded = "".join([*parts, text[last:]])
    if not _ONCE.search(text):
        return expanded
    guard = f"EQT_ONCE_{sha256(str(path.resolve()).encode()).hexdigest()[:16]}"
    return f"#ifndef {guard}\n#define {guard}\n{_ONCE.sub('', expanded)}\n#endif\n"


def _shown(path: Path) -> str:
    """Return the name of a file for the messages of a compiler."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", path.name)
