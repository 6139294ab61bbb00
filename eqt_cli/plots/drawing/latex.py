"""LaTeX as a program: what it needs, and what its failures mean; it knows no figure."""

from __future__ import annotations

import re
import shutil
from ast import literal_eval
from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib
from matplotlib.texmanager import TexManager

from eqt_cli.core.errors import EqtError

_INSTALL = (
    "install TeX Live's packages (Debian, Ubuntu: apt-get install texlive-latex-extra cm-super "
    "dvipng; others: tlmgr install cm-super dvipng type1cm underscore), or draw without LaTeX"
)
_PREAMBLE = r"\usepackage[T1]{fontenc}\usepackage{amsmath}"
"""Letters with accents, and < and > as they are; commands that Matplotlib has of its own."""
_SYMBOLS = r"\usepackage{amssymb}"
_PROBE = "eqt"
_DVIPNG = "latex+dvipng"

_REFUSED = re.compile(r"(\w+) was not able to process the following string:\s+(b?['\"].*)\n")
_COMMAND = re.compile(r"^(?:<recently read>|l\.\d+).*(\\\w+) *$", re.MULTILINE)
_MISSING_FILE = re.compile(r"File `([^']+)' not found")


def preamble(given: str) -> str:
    """The preamble of every text: eqt's, then that of a sheet.

    The symbols of the AMS are left out where a sheet has its own, since many font packages bring
    them, and refuse to be loaded after others.
    """
    return "\n".join([_PREAMBLE, given or _SYMBOLS])


def require(*, png: bool) -> None:
    """Make sure, within `explained`, that LaTeX is there and works with the present settings.

    Parameters
    ----------
    png
        Whether PNG files are wanted, for which some versions of Matplotlib need dvipng.

    Raises
    ------
    EqtError
        If a program, or a file of TeX Live, is missing, or the preamble is wrong.
    """
    # Since 3.11 Matplotlib draws glyphs of TeX by itself, unless it is told not to.
    engine = matplotlib.rcParams.get("text.latex.engine", _DVIPNG)
    programs = ["latex", "kpsewhich", *(["dvipng"] if png and engine == _DVIPNG else [])]
    for program in programs:
        if shutil.which(program) is None:
            use = "PNG files with text by LaTeX need" if program == "dvipng" else "LaTeX needs"
            raise EqtError(f"{use} the program '{program}', which is not found; {_INSTALL}")
    TexManager.make_dvi(_PROBE, float(matplotlib.rcParams["font.size"]))


@contextmanager
def explained() -> Iterator[None]:
    """Turn what Matplotlib raises when LaTeX fails, log and all, into a sentence.

    Raises
    ------
    EqtError
        In place of it.
    """
    try:
        yield
    except RuntimeError as error:
        sentence = _sentence(str(error))
        if sentence is None:
            raise
        raise EqtError(sentence) from error
    except LookupError as error:
        if "PostScript font" not in str(error):
            raise
        font = re.search(r"TeX font '([^']+)'", str(error))
        name = f" '{font[1]}'" if font else ""
        raise EqtError(f"TeX has no outlines of its font{name}; {_INSTALL}") from error


def _sentence(message: str) -> str | None:
    """What failed and why; None if it was not TeX."""
    if message.startswith("Failed to process string with tex"):
        program = message.partition(" because ")[2].partition(" ")[0]
        return f"LaTeX needs the program '{program}', which is not found; {_INSTALL}"
    refused = _REFUSED.match(message)
    if refused is None:
        return None
    program, text = refused[1], _text(refused[2])
    reason = _reason(message)
    file = _MISSING_FILE.search(reason)
    if file and not _in_preamble(file[1]):
        return f"LaTeX finds no {file[1]}, which Matplotlib needs; {_INSTALL}"
    if "cm-super" in reason:
        return f"LaTeX finds no fonts of cm-super, which Matplotlib needs; {_INSTALL}"
    if text == _PROBE:
        return (
            f"LaTeX stops before the first label: {reason}; mend text.latex.preamble of the "
            "style sheet, or install what is missing"
        )
    return f"{program} cannot typeset '{text}': {reason}; change the text, or draw without LaTeX"


def _in_preamble(file: str) -> bool:
    """Whether a sheet has asked for this file."""
    package = file.removesuffix(".sty")
    return package in matplotlib.rcParams["text.latex.preamble"].partition("\n")[2]


def _text(quoted: str) -> str:
    """The text that could not be set, which Matplotlib quotes as bytes."""
    found = literal_eval(quoted)
    return found.decode("unicode_escape") if isinstance(found, bytes) else str(found)


def _reason(message: str) -> str:
    """The first error in a log, without the lines around it."""
    lines = iter(message.splitlines())
    for line in lines:
        if line.startswith("! "):
            break
    else:
        return "it gives no reason"
    found = [line.removeprefix("! ").removeprefix("LaTeX Error: ")]
    for line in lines:
        if not line.strip() or line.startswith(("See ", "Type ", "<", "!")):
            break
        if line.startswith("l."):
            break
        found.append(line)
    if found[0].startswith("Undefined control sequence"):
        found[1:] = _COMMAND.findall(message.partition(found[0])[2])[:1]
    return " ".join(" ".join(found).split()).replace(". \\", " \\").rstrip(".")
