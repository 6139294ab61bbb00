"""Colours, lines, fonts and sizes of figures, and text as LaTeX."""

import ast
import math
import re
import traceback
import unicodedata
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import lcm
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib import RcParams, style
from matplotlib.colors import to_hex, to_rgba
from matplotlib.font_manager import FontProperties, findSystemFonts, fontManager, get_font
from matplotlib.style import use

from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.files import refusals, text_in
from eqt_cli.base.option_types import Written, has_unit, number_of

# Text and letters for LaTeX; it knows no figure --------------------------------------------------


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


DOLLAR = re.compile(r"(?<!\\)\$")

_IN_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "`": r"\textasciigrave{}",
    **{character: "\\" + character for character in "{}$&%#_"},
}
"""Escapes of characters that are special in a text for LaTeX."""


def sentence(text: str) -> str:
    """Return words, with mathematics between dollar signs, for a LaTeX document."""
    pieces = DOLLAR.split(text.replace("\n", " "))
    for k, piece in enumerate(pieces):
        if k % 2:  # Matplotlib's mathematics
            safe = re.sub(r"(?<!\\)[%#&]", r"\\\g<0>", piece)
            commands = {x: f"{{{command(x)}}}" for x in safe if command(x)}
            pieces[k] = f"${''.join(commands.get(x, x) for x in safe)}$"
        else:
            plain = unicodedata.normalize("NFC", piece.replace(r"\$", "$"))
            commands = {x: rf"\ensuremath{{{command(x)}}}" for x in plain if command(x)}
            pieces[k] = "".join((commands | _IN_LATEX).get(x, x) for x in plain)
    return "".join(pieces)


# Widths, line styles and style sheets of all figures; the colours are in eqt.mplstyle -------------
#
# Matplotlib checks the values of a user's sheet. eqt refuses what runs code or programs or opens
# files, and numbers that no drawing survives.


Settings = dict[str, Any]

_WITHOUT_COMMENT = re.compile(r'(?:[^"#]|"[^"]*(?:"|$))*')

# Typed as Any, since the stubs do not list every key.
_DEFAULTS: Any = matplotlib.rcParamsDefault


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
        settings: Any = style.library[name]
        return dict(settings)
    hint = suggestion(name, style.available) or f"; Matplotlib has: {', '.join(style.available)}"
    raise EqtError(f"style sheet '{name}' is neither a file nor one of Matplotlib's{hint}")


def read_file(path: Path) -> Settings:
    """Return the settings in a file.

    Matplotlib's own reader would quote lines of a file that is no style sheet.

    Raises
    ------
    EqtError
        If it cannot be read, or a line is wrong.
    """
    with refusals(path, "read as a style sheet"):
        text = text_in(path)
    settings: Any = RcParams()
    for number, line in enumerate(text.splitlines(), start=1):
        content = _WITHOUT_COMMENT.match(line)
        if content is None or not content[0].strip():
            continue
        key, _, value = (part.strip() for part in content[0].partition(":"))
        if len(value) > 1 and value[0] == value[-1] == '"':
            value = value[1:-1]
        try:
            if key not in RcParams.validate:
                near = suggestion(key, RcParams.validate)
                raise ValueError(
                    f"Matplotlib has no key {key}{near}" if near else "expected a key of Matplotlib"
                )
            if key == "axes.prop_cycle":
                check_cycle(value)
            settings[key] = value
            check(key, settings[key])
        except (ValueError, TypeError) as error:
            raise EqtError(f"{path}:{number}: the style sheet is wrong: {error}") from error
    return dict(settings)


_REFUSED = {
    "figure.hooks": "eqt runs no code of a style sheet",
    "path.effects": "eqt runs no code of a style sheet",
    "ps.usedistiller": "eqt starts no program for a style sheet",
    "text.latex": "eqt draws without LaTeX",
    "text.usetex": "eqt draws without LaTeX",
}
"""Why a style may not set the keys with these prefixes."""

MOST, MOST_PER_INCH = 300.0, 2400.0
"""Largest magnitude of a number, such as a size in points, and of a resolution or a weight."""


def check(key: str, value: Any) -> None:
    """Raise a `ValueError` with the reason if a style may not set a key to a value.

    Matplotlib's default may always be set.
    """
    if value == _DEFAULTS.get(key):
        return
    for prefix, reason in _REFUSED.items():
        if key.startswith(prefix):
            raise ValueError(f"Key {key}: {reason}; remove the line")
    if key.startswith("mathtext.") and "file=" in str(value):
        raise ValueError(f"Key {key}: expected the name of a font, got a file")
    most = MOST_PER_INCH if key.endswith(("dpi", "weight")) else MOST
    for number in value if isinstance(value, list | tuple) else [value]:
        if isinstance(number, int | float) and not abs(number) <= most:
            raise ValueError(f"Key {key}: expected numbers of at most {most:g}, got {number:g}")


_IN_CYCLES = "Expression Call keyword Name Load BinOp Add List Tuple UnaryOp USub Constant".split()


def check_cycle(text: str) -> None:
    """Raise a `ValueError` for a property cycle that is no sum of cyclers of literal values.

    Matplotlib before 3.11 evaluates the text, with no names but ``cycler``; without attributes and
    other operators nothing else can be reached, and nothing is larger than it is written.
    """
    try:
        for node in ast.walk(ast.parse(text, mode="eval")):
            name = getattr(node, "id", "cycler")
            if type(node).__name__ not in _IN_CYCLES or name != "cycler":
                raise ValueError
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        reason = "axes.prop_cycle is not a sum of cyclers of literal values"
        raise ValueError(f"{reason}: {text}") from None


Width = Literal["column", "page", "slide"]

ENLARGED: dict[Width, float] = {"column": 1.0, "page": 1.0, "slide": 18 / 8}
"""Enlargement of a drawing from layout to file: 8 pt are 18 pt on a slide."""


class _Widths(dict[Width, float]):
    """Widths by name; while a style has a width of its own, this one."""

    present: ContextVar[float | None] = ContextVar("present", default=None)

    def __getitem__(self, width: Width) -> float:
        return self.present.get() or super().__getitem__(width)


WIDTHS = _Widths({"column": 3.5, "page": 7.16, "slide": 13.3 / ENLARGED["slide"]})
"""Layout widths of one and of both columns of a two-column journal (IEEE's, among others) and of a
slide, in."""

LEAST_WIDTH, MOST_WIDTH = 1.5, 14.0
"""Ends of the widths that a journal may ask for, in."""


def width_of(text: str) -> tuple[Width, float | None]:
    """Return the layout for a width, and its inches where it is a length such as ``84 mm``.

    Raises
    ------
    EqtError
        If it is neither a name nor such a length.
    """
    for name in WIDTHS:
        if text == name:
            return name, None
    inches = number_of(Written(text, ["m"])) / 0.0254 if has_unit(text) else math.nan
    if not LEAST_WIDTH <= inches <= MOST_WIDTH:
        ends = " to ".join(f"{25.4 * end:.0f} mm" for end in (LEAST_WIDTH, MOST_WIDTH))
        raise EqtError(
            f"unknown width '{text}'{suggestion(text, [*WIDTHS]) or ';'} known: "
            f"{', '.join(WIDTHS)}, and lengths of {ends}"
        )
    return "column" if inches < 5 else "page", inches


_PRESENT: Any = matplotlib.rcParams

_SHEETS = Path(__file__).parent

_FIXED: Settings = {
    "figure.constrained_layout.use": True,  # the legends above the panels need it
    "figure.autolayout": False,
    "savefig.bbox": None,  # keeps the given width
    "svg.hashsalt": "eqt",  # equal files for equal figures
    "text.parse_math": True,  # the labels have mathematics in them
}
"""Settings that no sheet changes."""

_GRID = 0.114
"""Share of ink in eqt's own grid."""

# Solid, dashed, dash-dotted, dotted, in units of the line width.
_DASHES: tuple[Any, ...] = ("-", (0, (4.5, 1.5)), (0, (5, 1.2, 1, 1.2)), (0, (1.2, 1)))

_NAMED = {"solid": 0, "--": 1, "dashed": 1, "-.": 2, "dashdot": 2, ":": 3, "dotted": 3}
"""Matplotlib's names of dashes, as indices of those above."""

_MARKERS = "os^DvP*"

_COMPONENT = "#C2185B"
"""Colour of the second component of a vector, between shades of ink."""

_GREYS = (0.55, 0.35)
"""Shares of ink in curves that are not in focus."""
_PALER = 0.55
"""Share of the colour that is left in each further curve with the same dashes."""
_SHADES = 5
"""Number of shades of a colour; the palest is nearly that of the paper."""


@dataclass(frozen=True)
class Style:
    """Style of figures: eqt's own sheet, and the sheets laid over it.

    Attributes
    ----------
    sheets
        Matplotlib style sheets, by path or by name; later ones win.
    width
        Width of the figure: a slide has type of its own.
    inches
        Width of the paper where it is not that of the layout, in.
    dpi
        Dots per inch of pictures of dots; None for those of the sheets.
    """

    sheets: tuple[str, ...] = ()
    width: Width = "column"
    inches: float | None = None
    dpi: float | None = None

    @cached_property
    def settings(self) -> Settings:
        """Matplotlib's settings that differ from its defaults.

        Raises
        ------
        EqtError
            If there is no such sheet, or one is wrong.
        """
        of_sheets: Settings = {}
        for sheet in self.sheets:
            of_sheets |= read(sheet)
        if self.width == "slide":
            of_sheets = read_file(_SHEETS / "slide.mplstyle") | of_sheets
        settings = read_file(_SHEETS / "eqt.mplstyle") | of_sheets | _FIXED
        if self.dpi is not None:
            settings["savefig.dpi"] = self.dpi
        return settings | {"font.family": _installed(settings)}


def _installed(settings: Settings) -> list[str]:
    """Return the installed families of `font.family`; Matplotlib warns of others at every word.

    Raises
    ------
    EqtError
        If none is installed.
    """
    wanted: list[str] = []
    for family in settings["font.family"]:
        generic = f"font.{family}"
        default = _DEFAULTS.get(generic, [family])
        wanted += settings.get(generic, default)
    there = set(fontManager.get_font_names())
    installed = [family for family in wanted if family in there]
    if not installed:
        raise EqtError(
            f"none of the fonts that the style asks for is installed: {', '.join(wanted)}; install "
            "one, or name another in font.family"
        )
    return installed


def _listed_fonts() -> dict[str, str]:
    """Return the files of the fonts that Matplotlib knows, by name."""
    return {x.name: x.fname for x in fontManager.ttflist if not x.name.startswith("Last Resort")}


def _with_letter(letter: str, fonts: Mapping[str, str]) -> str:
    """Return the first font with a letter, those of the style in force first; "" if none."""
    for name in (*_PRESENT["font.family"], *sorted(fonts)):
        if name in fonts and get_font(fonts[name]).get_char_index(ord(letter)):
            return str(name)
    return ""


def give_letters(texts: Iterable[str]) -> None:
    """Add fonts to those of the style in force for the letters of texts that these lack.

    Raises
    ------
    EqtError
        If no installed font has a letter.
    """
    fonts = _listed_fonts()
    letters = {x: text for text in texts for x in text if ord(x) > 127 and x.isprintable()}
    for letter, text in letters.items():
        name = _with_letter(letter, fonts)
        if not name:  # Matplotlib's list may be older than the fonts
            for path in {*findSystemFonts()} - {font.fname for font in fontManager.ttflist}:
                with suppress(OSError, RuntimeError):  # no font after all
                    fontManager.addfont(path)
            fonts = _listed_fonts()
            name = _with_letter(letter, fonts)
        if not name:
            raise EqtError(
                f"no installed font has the letter {letter} (U+{ord(letter):04X}) of “{text}”; "
                "install one, or write it in other letters: --title NAME=TEXT"
            )
        if name not in _PRESENT["font.family"]:
            _PRESENT["font.family"] = [*_PRESENT["font.family"], name]


HOUSE = Style()
"""eqt's own style."""


@contextmanager
def house_style(style: Style = HOUSE) -> Iterator[None]:
    """Draw and save in a style, independent of the user's own Matplotlib settings.

    Raises
    ------
    EqtError
        If a sheet is wrong.
    """
    settings = style.settings
    with matplotlib.rc_context(), _as_wide(style):
        matplotlib.rcdefaults()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # on machine keys, which `use` omits
            use(settings)
        if to_hex(_PRESENT["grid.color"]) == ink():
            # From a sheet without a grid; eqt shows one, and it must not hide the curves.
            _PRESENT["grid.color"] = ink(_GRID)
        with _moderate_numbers():
            yield


@contextmanager
def _as_wide(style: Style) -> Iterator[None]:
    """Give a layout the width of the paper for a while."""
    token = WIDTHS.present.set(style.inches)
    try:
        yield
    finally:
        WIDTHS.present.reset(token)


@contextmanager
def replaced(owner: Any, name: str, by: Any) -> Iterator[None]:
    """Replace an attribute for a while."""
    original = getattr(owner, name)
    setattr(owner, name, by)
    try:
        yield
    finally:
        setattr(owner, name, original)


@contextmanager
def _moderate_numbers() -> Iterator[None]:
    """Turn Matplotlib's exceptions where an axis exceeds the largest float into a sentence.

    Raises
    ------
    EqtError
        In place of the exception.
    """
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            yield
    except (ValueError, OverflowError) as error:
        *_, (frame, _) = traceback.walk_tb(error.__traceback__)
        if frame.f_globals.get("__name__") not in ("matplotlib.ticker", "matplotlib.transforms"):
            raise
        raise EqtError(
            "the figure cannot be drawn: its numbers are too large for an axis; look for runs that "
            "diverge with `eqt show --table metrics`"
        ) from error


@dataclass(frozen=True)
class CurvePlace:
    """Place of a curve among those of a figure: its law gives the colour, its variant the dashes.

    Attributes
    ----------
    law
        Index of the colour of the law.
    variant, variants
        Index of the variant, such as the start of a search or one of several results, and the
        largest number of variants of any law.
    grey
        Index among the grey curves, which are not in focus; None for the others.
    colour
        Colour that the user chose; empty for that of the style.
    """

    law: int
    variant: int = 0
    variants: int = 1
    grey: int | None = None
    colour: str = ""


@dataclass(frozen=True)
class Look:
    """Colour, dashes and marker of a curve."""

    colour: str
    dashes: Any
    marker: str


def distinct(places: Sequence[CurvePlace]) -> list[Look]:
    """Return the looks of curves; no two share colour and dashes, or colour and marker.

    A curve whose wish an earlier one has gets the next dashes and marker, and a paler colour once
    all dashes are taken.
    """
    looks: list[Look] = []
    taken: set[tuple[str, Any]] = set()
    for place in places:
        wished, shade, dashes_of_cycle = _wish(place)
        kind = _kind(dashes_of_cycle)
        first = kind + 1 if isinstance(kind, int) else 0
        others = [_DASHES[(first + k) % len(_DASHES)] for k in range(len(_DASHES))]
        for paler, dashes in product(range(shade, shade + _SHADES), [dashes_of_cycle, *others]):
            colour = mixed(wished, ink(0), _PALER**paler)
            if (colour, _kind(dashes)) not in taken:
                break
        # Where the colours of eqt's own style begin anew, the markers are the next ones.
        begin = place.law + place.law // len(_MARKERS)
        markers = [_MARKERS[(begin + k) % len(_MARKERS)] for k in range(len(_MARKERS))]
        marker = next((one for one in markers if (colour, one) not in taken), markers[0])
        taken |= {(colour, _kind(dashes)), (colour, marker)}
        looks.append(Look(colour, dashes, marker))
    return looks


def _wish(place: CurvePlace) -> tuple[str, int, Any]:
    """Return the colour that a curve has if no other has it, how often it is made paler, dashes.

    Dashes keep curves apart where colours do not: in greyscale, or for a colour-blind reader. They
    come from the sheet's property cycle, or from eqt where it has none. Where laws have variants,
    the variant gives the dashes.
    """
    cycle = list(_PRESENT["axes.prop_cycle"])
    if place.grey is not None:
        shade, dashes = divmod(place.grey, len(_DASHES))
        return ink(_GREYS[shade % len(_GREYS)]), 0, _DASHES[dashes]
    entry = cycle[place.law % len(cycle)]
    if place.variants > 1 and "linestyle" not in entry and "color" in entry:
        shade, dashes = divmod(place.variant, len(_DASHES))
        return place.colour or to_hex(entry["color"]), shade, _DASHES[dashes]
    index = place.law * place.variants + place.variant
    entry = cycle[index % len(cycle)]
    # Dashes shift by one after each full turn: all pairs occur before one repeats.
    turns = index // lcm(len(cycle), len(_DASHES))
    dashes = entry.get("linestyle", _DASHES[(index + turns) % len(_DASHES)])
    return place.colour or to_hex(entry.get("color", ink())), 0, dashes


def _kind(dashes: Any) -> Any:
    """Return the index of eqt's dashes that look like these; other dashes themselves, as text."""
    if dashes in _DASHES:
        return _DASHES.index(dashes)
    return _NAMED.get(str(dashes), str(dashes))


def colours_of_style() -> int:
    """Return how many entries the property cycle of the style has."""
    return len(_PRESENT["axes.prop_cycle"])


def _look(look: int | Look) -> Look:
    """Return a look, or that of a curve by its index among others."""
    return distinct([CurvePlace(k) for k in range(look + 1)])[-1] if isinstance(look, int) else look


def line_style(look: int | Look) -> dict[str, Any]:
    """Return colour and dashes of a curve, by its look or its index."""
    place = _look(look)
    return {"color": place.colour, "linestyle": place.dashes}


def component_style(k: int) -> dict[str, Any]:
    """Return colour and dashes of the k-th component of a vector, in no colour of a law."""
    colours = (ink(), _COMPONENT, ink(0.5))
    dashes = _DASHES[(k + k // len(colours)) % len(_DASHES)]
    return {"color": colours[k % len(colours)], "linestyle": dashes}


def marker(look: int | Look) -> str:
    """Return the marker of a curve, by its look or index."""
    return _look(look).marker


def ink(share: float = 1.0) -> str:
    """Return the colour of text, or a tint of it on the paper: it stands for no controller.

    A share of 0 gives the paper itself.
    """
    grounds = ("axes.facecolor", "figure.facecolor")
    seen = [to_rgba(_PRESENT[key]) for key in grounds]
    paper = next((colour for colour in seen if colour[3] > 0), (1.0, 1.0, 1.0, 1.0))
    return mixed(_PRESENT["text.color"], paper, share)


def mixed(colour: Any, other: Any, share: float) -> str:
    """Mix a share of a colour with the rest of another."""
    both = zip(to_rgba(colour), to_rgba(other), strict=True)
    red, green, blue, _ = (share * a + (1 - share) * b for a, b in both)
    return to_hex((red, green, blue))


def size_of_type(key: str) -> float:
    """Return a setting of a type size, such as ``legend.fontsize``, pt."""
    return float(FontProperties(size=_PRESENT[key]).get_size_in_points())
