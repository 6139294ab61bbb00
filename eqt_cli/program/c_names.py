"""Names that are valid in C: ASCII letters, digits and underscores, and no keywords."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while asm bool catch class delete explicit export false friend "
    "mutable namespace new operator private protected public template this throw true try typeid "
    "typename using virtual real".split()
)
"""Keywords of C and C++, and the type of the exported numbers."""


def c_name(text: str) -> str:
    """Return a name in C for a text: the text itself if it is one."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") if not _is_name(text) else text
    if not name or name[0].isdigit():
        name = f"n_{name}".rstrip("_")
    return f"{name}_" if name in KEYWORDS else name


def distinct(texts: Iterable[str], taken: Collection[str] = ()) -> list[str]:
    """Return distinct names in C for texts, none of which is taken."""
    found: list[str] = []
    for text in texts:
        name, number = c_name(text), 1
        while name in found or name in taken:
            number += 1
            name = f"{c_name(text)}_{number}"
        found.append(name)
    return found


def _is_name(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text, re.ASCII) is not None
