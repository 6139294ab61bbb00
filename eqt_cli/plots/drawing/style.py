"""Widths, line styles and style sheets of all figures; the colours are in eqt.mplstyle."""

import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from math import lcm
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, fontManager
from matplotlib.style import use

from eqt_cli.core.errors import EqtError
from eqt_cli.plots.drawing import latex, style_sheets
from eqt_cli.plots.drawing.style_sheets import Settings

Width = Literal["column", "page", "slide"]

ENLARGED: dict[Width, float] = {"column": 1.0, "page": 1.0, "slide": 18 / 8}
"""Enlargement of a drawing from layout to file: 8 pt are 18 pt on a slide."""

WIDTHS: dict[Width, float] = {"column": 3.5, "page": 7.16, "slide": 13.3 / ENLARGED["slide"]}
"""Layout widths of one and of both columns of a two-column journal (IEEE's, among others) and of a
slide, in."""

# Typed as Any, since the stubs do not list every key.
_PRESENT: Any = matplotlib.rcParams
_DEFAULTS: Any = matplotlib.rcParamsDefault

_SHEET = Path(__file__).with_name("eqt.mplstyle")
_SLIDE = Path(__file__).with_name("slide.mplstyle")
_LATEX_SHEET = Path(__file__).with_name("latex.mplstyle")

_KEPT: Settings = {
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

_MARKERS = "os^DvP*"

_GREYS = (0.55, 0.35)
"""Shares of ink in curves that are not in focus."""
_PALER = 0.55
"""Share of the colour that is left in each further variant with the same dashes."""


@dataclass(frozen=True)
class Style:
    """Style of figures: eqt's own sheet, and the sheets laid over it.

    Attributes
    ----------
    sheets
        Matplotlib style sheets, by path or by name; later ones win.
    tex
        Whether LaTeX sets the text; a sheet may ask for it too, with ``text.usetex``.
    width
        Width of the figure: a slide has type of its own.
    """

    sheets: tuple[str, ...] = ()
    tex: bool = False
    width: Width = "column"

    @cached_property
    def settings(self) -> Settings:
        """Matplotlib's settings that differ from its defaults.

        Raises
        ------
        EqtError
            If there is no such sheet, or one is wrong.
        """
        given: Settings = {}
        for sheet in self.sheets:
            given |= style_sheets.read(sheet)
        if self.width == "slide":
            given = style_sheets.read_file(_SLIDE) | given
        settings = style_sheets.read_file(_SHEET) | given | _KEPT
        if not (self.tex or given.get("text.usetex", False)):
            return settings | {"text.usetex": False, "font.family": _installed(settings)}
        # Fonts that a sheet names are Matplotlib's; LaTeX's fonts come with its preamble.
        kind = {"font.family": given.get("font.family")}
        kept = kind if kind["font.family"] in (["sans-serif"], ["monospace"]) else {}
        preamble = latex.preamble(given.get("text.latex.preamble", ""))
        own = style_sheets.read_file(_LATEX_SHEET) | kept
        return settings | own | {"text.latex.preamble": preamble}

    def prepare(self, formats: Sequence[str] = ("pdf",)) -> None:
        """Check that figures can be drawn in this style and these formats, before any is drawn.

        Raises
        ------
        EqtError
            If a sheet is wrong, or LaTeX is needed and does not work.
        """
        with house_style(self):
            if _PRESENT["text.usetex"]:
                probe = Figure(figsize=(1, 1))
                probe.set_layout_engine("none")
                probe.text(0, 0, "eqt")
                for format in formats:
                    probe.savefig(BytesIO(), format=format)


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
        own = _DEFAULTS.get(generic, [family])
        wanted += settings.get(generic, own)
    there = set(fontManager.get_font_names())
    found = [family for family in wanted if family in there]
    if not found:
        raise EqtError(
            f"none of the fonts that the style asks for is installed: {', '.join(wanted)}; install "
            "one, or name another in font.family"
        )
    return found


HOUSE = Style()
"""eqt's own style."""


@contextmanager
def house_style(style: Style = HOUSE) -> Iterator[None]:
    """Draw and save in a style, independent of the user's own Matplotlib settings.

    Raises
    ------
    EqtError
        If a sheet is wrong, or LaTeX cannot set a text.
    """
    settings = style.settings
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # on machine keys, which `use` omits
            use(settings)
        if to_hex(_PRESENT["grid.color"]) == ink():
            # From a sheet without a grid; eqt shows one, and it must not hide the curves.
            _PRESENT["grid.color"] = ink(_GRID)
        explained = latex.explained() if settings["text.usetex"] else nullcontext()
        with explained, _moderate_numbers():
            yield


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
            "diverge with `eqt show --table`"
        ) from error


@dataclass(frozen=True)
class Look:
    """Look of a curve: its law gives the colour, its variant the dashes.

    Attributes
    ----------
    law
        Index of the law among all laws.
    variant, variants
        Index of the variant, such as the start of a search or one of several results, and the
        largest number of variants of any law.
    grey
        Index among the grey curves, which are not in focus; None for the others.
    """

    law: int
    variant: int = 0
    variants: int = 1
    grey: int | None = None


def line_style(look: int | Look) -> dict[str, Any]:
    """Return colour and dashes of a curve, by its look or the index of its controller.

    Dashes keep curves apart where colours do not: in greyscale, or for a colour-blind reader. They
    come from the sheet's property cycle, or from eqt where it has none. Where laws have variants,
    the variant gives the dashes, and a paler colour once all dashes are taken.
    """
    look = Look(look) if isinstance(look, int) else look
    cycle = list(_PRESENT["axes.prop_cycle"])
    if look.grey is not None:
        shade, dashes = divmod(look.grey, len(_DASHES))
        return {"color": ink(_GREYS[shade % len(_GREYS)]), "linestyle": _DASHES[dashes]}
    own = cycle[look.law % len(cycle)]
    colour = to_hex(own.get("color", ink()))
    if look.variants > 1 and "linestyle" not in own and "color" in own:
        shade, dashes = divmod(look.variant, len(_DASHES))
        return {"color": mixed(colour, ink(0), _PALER**shade), "linestyle": _DASHES[dashes]}
    index = look.law * look.variants + look.variant
    own = cycle[index % len(cycle)]
    # Dashes shift by one after each full turn: all pairs occur before one repeats.
    turns = index // lcm(len(cycle), len(_DASHES))
    dashes = own.get("linestyle", _DASHES[(index + turns) % len(_DASHES)])
    return {"color": to_hex(own.get("color", ink())), "linestyle": dashes}


def marker(look: int | Look) -> str:
    """Return the marker of a controller, by its look or index.

    Where the colours of eqt's own style begin anew, the markers are the next ones.
    """
    index = look if isinstance(look, int) else look.law
    return _MARKERS[(index + index // len(_MARKERS)) % len(_MARKERS)]


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


def darker(colour: str) -> str:
    """Return a colour for words: a third of the way to the colour of text."""
    return mixed(colour, ink(), 2 / 3)


def size_of_type(key: str) -> float:
    """Return a setting of a type size, such as ``legend.fontsize``, pt."""
    return float(FontProperties(size=_PRESENT[key]).get_size_in_points())
