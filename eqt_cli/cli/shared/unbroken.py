"""Text that stays on one line: words, norms, integrals, intervals, shares; knows no layout."""

import re
import textwrap

_WORD = re.compile(
    r"(?:‖[^‖]*‖|\|\|[^|]*\|\||∫.*? dt|\[[-−+\d.e, ]{1,40}\]|\d %|[-−+\d.e]+ N m\b|\S)+"
)


def words(text: str) -> list[str]:
    """Return the pieces of a text between which a line may be broken."""
    return _WORD.findall(text)


def folded(line: str, width: int, indent: str = "") -> str:
    """Wrap a line to a width, with the further lines indented."""
    kept = _WORD.sub(lambda word: word[0].replace(" ", "\u00a0"), line)
    return textwrap.fill(
        kept, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    ).replace("\u00a0", " ")
