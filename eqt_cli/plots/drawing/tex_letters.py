"""Letters and signs of Unicode in the mathematical notation of TeX; it knows no label."""

import unicodedata

_RENAMED = {"LAMDA": "LAMBDA", "OMICRON": "o"}
"""Greek letters that Unicode and TeX name differently."""
_LIKE_LATIN = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧ", "ABEZHIKMNOPTYX", strict=True))
"""Greek capitals for which TeX has no command."""
_SHIFTS = {"<sub>": "_", "<super>": "^"}
"""Unicode's marks of subscript and superscript letters, in TeX."""
_MATHEMATICAL = {
    "‖": r"\|",
    "−": "-",
    "·": r"\cdot",
    "×": r"\times",
    "±": r"\pm",
    "∞": r"\infty",
    "√": r"\surd",
    "∂": r"\partial",
    "∇": r"\nabla",
    "∫": r"\int",
    "∑": r"\sum",
    "∈": r"\in",
    "≈": r"\approx",
    "≠": r"\neq",
    "≤": r"\leq",
    "≥": r"\geq",
    "→": r"\rightarrow",
    "←": r"\leftarrow",
    "↔": r"\leftrightarrow",
    "⋉": r"\ltimes",
    "𝕀": r"\mathbb{I}",
    "ℝ": r"\mathbb{R}",
}
"""Characters that need mathematics in LaTeX, besides Greek letters and indices."""


def shift(letter: str) -> str:
    """Return ``_`` for a subscript letter, ``^`` for a superscript; empty for others."""
    return _SHIFTS.get(unicodedata.decomposition(letter).partition(" ")[0], "")


def mathematical(letter: str) -> str:
    """Return a letter in TeX mathematics: Greek by name, indices lowered to the line."""
    if shift(letter):
        letter = unicodedata.normalize("NFKC", letter)
    words = unicodedata.name(letter, "").split()
    if len(words) == 4 and words[0] == "GREEK" and words[2] == "LETTER":
        name = _RENAMED.get(words[3], words[3])
        if words[1] == "SMALL":
            return name if name == "o" else "\\" + name.lower()
        return _LIKE_LATIN.get(letter) or "\\" + name.capitalize()
    return letter


def command(letter: str) -> str | None:
    """Return the command of a letter that needs mathematics in LaTeX; None for others."""
    if letter in _MATHEMATICAL:
        return _MATHEMATICAL[letter]
    if letter.isascii():
        return None
    found = mathematical(letter)
    if shift(letter):
        return f"{{}}{shift(letter)}{{{found}}}"
    return found if found != letter else None
