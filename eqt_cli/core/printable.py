"""Text that may have come from a file, as a terminal or a page can show it.

Control characters can clear a screen or forge a line, and bidirectional ones reorder what is read.
They are shown as Python and YAML write them, ESC as four characters from a backslash to 1b.
"""

import unicodedata
from collections.abc import Callable


def escape(character: str) -> str:
    """A character as Python, and YAML between double quotes, write one that cannot be seen."""
    return repr(character)[1:-1]


def printable(text: str, keep: str = "", escape: Callable[[str], str] = escape) -> str:
    """A text with what cannot be seen written as escapes.

    Parameters
    ----------
    keep
        Characters that stay as they are, such as the line breaks of a text of many lines.
    escape
        How one is written, where not as `escape` does.
    """
    if text.isprintable():
        return text
    return "".join(c if c in keep or _is_seen(c) else escape(c) for c in text)


def _is_seen(character: str) -> bool:
    """Whether it has a shape, or a width, of its own; spaces of any width have one."""
    return character.isprintable() or unicodedata.category(character) == "Zs"
