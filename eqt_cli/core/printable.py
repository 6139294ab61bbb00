"""Makes text from foreign files safe to show in a terminal or on a page.

Control characters can clear a screen or forge a line, and bidirectional ones reorder text. They
are shown as escapes of Python and YAML, ESC as four characters from a backslash to 1b.
"""

import unicodedata
from collections.abc import Callable


def escape(character: str) -> str:
    """Return the escape of a character in Python, and in double quotes of YAML."""
    return repr(character)[1:-1]


def printable(text: str, keep: str = "", escape: Callable[[str], str] = escape) -> str:
    """Return a text with escapes in place of invisible characters.

    Parameters
    ----------
    keep
        Characters that stay as they are, such as the line breaks of a text of many lines.
    escape
        Returns the escape of a character.
    """
    if text.isprintable():
        return text
    return "".join(c if c in keep or _is_visible(c) else escape(c) for c in text)


def _is_visible(character: str) -> bool:
    """Whether a character has a shape or a width; all spaces have a width."""
    return character.isprintable() or unicodedata.category(character) == "Zs"
