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

Width = Literal["column", "page"]

WIDTHS: dict[Width, float] = {"column": 3.5, "page": 7.16}
"""Widths in inches of one and of both columns of a two-column journal (IEEE's, among others)."""

# By any key, and not only by those that its types list.
_PRESENT: Any = matplotlib.rcParams
_DEFAULTS: Any = matplotlib.rcParamsDefault

_SHEET = Path(__file__).with_name("eqt.mplstyle")
_LATEX_SHEET = Path(__file__).with_name("latex.mplstyle")

_KEPT: Settings = {
    "figure.constrained_layout.use": True,  # the legends above the panels need it
    "figure.autolayout": False,
    "savefig.bbox": None,  # a figure is as wide as it is said to be
    "svg.hashsalt": "eqt",  # equal files for equal figures
    "text.parse_math": True,  # the labels have mathematics in them
}
"""What no sheet changes."""

_GRID = 0.114
"""The share of ink in a grid: that of eqt's own."""

# Solid, dashed, dash-dotted, dotted, in units of the line width.
_DASHES: tuple[Any, ...] = ("-", (0, (4.5, 1.5)), (0, (5, 1.2, 1, 1.2)), (0, (1.2, 1)))

_MARKERS = "os^DvP*"


@dataclass(frozen=True)
class Style:
    """The look of figures: eqt's own sheet, and what is laid over it.

    Attributes
    ----------
    sheets
        Matplotlib style sheets, by path or by name; later ones win.
    tex
        Whether LaTeX sets the text; a sheet may ask for it too, with ``text.usetex``.
    """

    sheets: tuple[str, ...] = ()
    tex: bool = False

    @cached_property
    def settings(self) -> Settings:
        """Matplotlib's settings where they are not the default ones.

        Raises
        ------
        EqtError
            If there is no such sheet, or one is wrong.
        """
        given: Settings = {}
        for sheet in self.sheets:
            given |= style_sheets.read(sheet)
        settings = style_sheets.read_file(_SHEET) | given | _KEPT
        if not (self.tex or given.get("text.usetex", False)):
            return settings | {"text.usetex": False, "font.family": _installed(settings)}
        # Fonts that a sheet names are Matplotlib's; those of LaTeX come by its preamble.
        kind = {"font.family": given.get("font.family")}
        kept = kind if kind["font.family"] in (["sans-serif"], ["monospace"]) else {}
        preamble = latex.preamble(given.get("text.latex.preamble", ""))
        own = style_sheets.read_file(_LATEX_SHEET) | kept
        return settings | own | {"text.latex.preamble": preamble}

    def prepare(self, formats: Sequence[str] = ("pdf",)) -> None:
        """Make sure that figures can be drawn so, as files of these formats, before any is.

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
    """The families of `font.family` that there are; Matplotlib complains of others at every word.

    Raises
    ------
    EqtError
        If there is none.
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
"""eqt's own look."""


@contextmanager
def house_style(style: Style = HOUSE) -> Iterator[None]:
    """Draw and save in a style alone, whatever the user's own Matplotlib settings are.

    Raises
    ------
    EqtError
        If a sheet is wrong, or LaTeX cannot set a text.
    """
    settings = style.settings
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of keys of a machine, which `use` omits
            use(settings)
        if to_hex(_PRESENT["grid.color"]) == ink():
            # Of a sheet that shows no grid; eqt does, and it must not hide the curves.
            _PRESENT["grid.color"] = ink(_GRID)
        explained = latex.explained() if settings["text.usetex"] else nullcontext()
        with explained, _moderate_numbers():
            yield


@contextmanager
def _moderate_numbers() -> Iterator[None]:
    """Turn what Matplotlib raises where an axis would end beyond the largest float into a sentence.

    Raises
    ------
    EqtError
        In place of it.
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
    """On what the line style of a curve depends.

    Attributes
    ----------
    index
        The controller's position, or the curve's place in the figure.
    pair
        The positions of its colour and its dashes, where these mean two different things.
    pairs
        How many colours and dashes the figure needs for that.
    """

    index: int
    pair: tuple[int, int] = (0, 0)
    pairs: tuple[int, int] = (0, 0)


def line_style(look: int | Look) -> dict[str, Any]:
    """Colour and dashes of a curve, for example of the one of the controller at this position.

    Dashes keep curves apart where colours do not: in greyscale, or for a colour-blind reader. They
    are those of the sheet's property cycle, or eqt's where it has none. A pair is heeded where
    there are as many colours and dashes as the figure needs: no two curves look the same.
    """
    index = look if isinstance(look, int) else look.index
    cycle = list(_PRESENT["axes.prop_cycle"])
    if isinstance(look, Look) and _has_pairs(cycle, look.pairs):
        colour, dashes = look.pair
        return {"color": to_hex(cycle[colour]["color"]), "linestyle": _DASHES[dashes]}
    own = cycle[index % len(cycle)]
    # With every turn through both, dashes move on by one: all pairs occur before one repeats.
    turns = index // lcm(len(cycle), len(_DASHES))
    dashes = own.get("linestyle", _DASHES[(index + turns) % len(_DASHES)])
    return {"color": to_hex(own.get("color", ink())), "linestyle": dashes}


def _has_pairs(cycle: list[dict[str, Any]], needed: tuple[int, int]) -> bool:
    colours, dashes = needed
    free = "linestyle" not in cycle[0] and "color" in cycle[0]
    return free and 0 < colours <= len(cycle) and dashes <= len(_DASHES)


def marker(index: int) -> str:
    """The shape of the points that belong to the controller at this position.

    Where the colours of eqt's own style begin anew, the shapes are the next ones.
    """
    return _MARKERS[(index + index // len(_MARKERS)) % len(_MARKERS)]


def ink(share: float = 1.0) -> str:
    """The colour of what belongs to no controller: that of text, or a tint of it on the paper.

    With a share of 0, the paper itself.
    """
    grounds = ("axes.facecolor", "figure.facecolor")
    seen = [to_rgba(_PRESENT[key]) for key in grounds]
    paper = next((colour for colour in seen if colour[3] > 0), (1.0, 1.0, 1.0, 1.0))
    text = to_rgba(_PRESENT["text.color"])
    red, green, blue, _ = (share * a + (1 - share) * b for a, b in zip(text, paper, strict=True))
    return to_hex((red, green, blue))


def darker(colour: str) -> str:
    """A colour for words: a third of the way to the colour of text."""
    own, text = to_rgba(colour), to_rgba(ink())
    red, green, blue, _ = ((2 * a + b) / 3 for a, b in zip(own, text, strict=True))
    return to_hex((red, green, blue))


def size_of_type(key: str) -> float:
    """A setting that is a size of type, such as ``legend.fontsize``, in points."""
    return float(FontProperties(size=_PRESENT[key]).get_size_in_points())
