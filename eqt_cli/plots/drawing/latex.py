"""Text and letters for LaTeX: escapes, the preamble, and explained failures; it knows no figure."""

import re
import unicodedata
from ast import literal_eval
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import takewhile

from eqt_cli.core.errors import EqtError

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
    symbol = mathematical(letter)
    if shift(letter):
        return f"{{}}{shift(letter)}{{{symbol}}}"
    return symbol if symbol != letter else None


_PREAMBLE = r"\usepackage[T1]{fontenc}\usepackage{amsmath}"
"""Packages for accented letters, literal < and >, and commands that Matplotlib itself knows."""
_SYMBOLS = r"\usepackage{amssymb}"

_MEND = (
    "change the text or the preamble of the style sheet, install what is missing of TeX Live "
    "(Debian, Ubuntu: apt-get install texlive-latex-extra cm-super dvipng; others: tlmgr install "
    "cm-super dvipng type1cm underscore), or draw without LaTeX"
)
_REFUSED = re.compile(r"\w+ was not able to process the following string:\s+(b?['\"].*)\n")
_MISSING = re.compile(
    r"Failed to process string with tex because (.*)"
    r"|(.*(?:TeX implementation|PostScript font|usable font file).*)"
)
DOLLAR = re.compile(r"(?<!\\)\$")
_COMMAND = re.compile(r"^(?:<recently read>|l\.\d+).*(\\\w+) *$", re.MULTILINE)

_IN_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "`": r"\textasciigrave{}",
    "'": r"'{}",  # two would be a quotation mark, as two hyphens a dash
    ",": r",{}",
    "-": r"-{}",
    **{character: "\\" + character for character in "{}$&%#_"},
}
"""Escapes of characters that are special in a text for LaTeX."""


def preamble(given: str) -> str:
    """Return the preamble of every text: eqt's, then the sheet's.

    The AMS symbols are left out where a sheet has a preamble, since many font packages bring them
    and refuse to be loaded after others.
    """
    return "\n".join([_PREAMBLE, given or _SYMBOLS])


def escaped(text: str, kept: str = "") -> str:
    """Escape text but the letters that are `kept`, so that no character is a command."""
    letters = unicodedata.normalize("NFC", text)
    return "".join(x if x in kept else _escaped_letter(x) for x in letters)


def _escaped_letter(letter: str) -> str:
    if letter in _IN_LATEX:
        return _IN_LATEX[letter]
    symbol = command(letter)
    return letter if symbol is None else rf"\ensuremath{{{symbol}}}"


def sentence(text: str) -> str:
    """Return words, with mathematics between dollar signs, for a LaTeX document."""
    return with_mathematics(text.replace("\n", " "), kept="-,'")


def with_mathematics(text: str, kept: str = "") -> str:
    """Return words as `escaped` does, with mathematics between dollar signs."""
    return "".join(
        f"${_mathematics(piece)}$" if number % 2 else escaped(piece.replace(r"\$", "$"), kept)
        for number, piece in enumerate(DOLLAR.split(text))
    )


def _mathematics(text: str) -> str:
    """Return Matplotlib's mathematics for LaTeX, with ``%``, ``#`` and ``&`` escaped."""
    safe = re.sub(r"(?<!\\)[%#&]", r"\\\g<0>", text)
    return "".join(
        letter if (symbol := command(letter)) is None else f"{{{symbol}}}" for letter in safe
    )


@contextmanager
def explained() -> Iterator[None]:
    """Turn the exceptions of Matplotlib when LaTeX fails, log and all, into a sentence.

    Raises
    ------
    EqtError
        In place of the exception.
    """
    try:
        yield
    except (RuntimeError, LookupError, FileNotFoundError, ValueError) as error:
        message = str(error.args[0]) if error.args else ""
        if refused := _REFUSED.match(message):
            text = literal_eval(refused[1])
            text = text.decode("unicode_escape") if isinstance(text, bytes) else text
            raise EqtError(f"LaTeX cannot set '{text}': {_reason(message)}; {_MEND}") from error
        if missing := _MISSING.match(message):
            raise EqtError(f"LaTeX does not work: {missing[1] or missing[2]}; {_MEND}") from error
        raise


def _reason(message: str) -> str:
    """Return the first error in a log, without the lines around it."""
    log = message.partition("\n! ")[2].removeprefix("LaTeX Error: ")
    lines = takewhile(lambda line: not re.match(r"\s*$|l\.|See |Type |<|!", line), log.splitlines())
    reason = " ".join(" ".join(lines).split()).rstrip(".") or "it gives no reason"
    commands = _COMMAND.findall(log) if reason == "Undefined control sequence" else []
    return " ".join([reason, *commands[:1]])
