"""The look of every figure: the style sheet, widths and line styles; it knows no result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import matplotlib

Width = Literal["column", "page"]

WIDTHS: dict[Width, float] = {"column": 3.5, "page": 7.16}
"""Widths in inches of one and of both columns of a two-column journal (IEEE's, among others)."""

_SHEET = Path(__file__).with_name("eqt.mplstyle")

# Solid, dashed, dash-dotted, dotted, in units of the line width. Their number shares no factor with
# the sheet's seven colours, so that 28 curves differ.
_DASHES: tuple[Any, ...] = ("-", (0, (4.5, 1.5)), (0, (5, 1.2, 1, 1.2)), (0, (1.2, 1)))


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and save with the style sheet alone, whatever the user's own Matplotlib settings are."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            matplotlib.rc_params_from_file(_SHEET, use_default_template=False)
        )
        yield


def line_style(index: int) -> dict[str, Any]:
    """Colour and dashes of the curve that belongs to the controller at this position.

    Dashes keep curves apart where colours do not: in greyscale, or for a colour-blind reader.
    """
    colours = matplotlib.rcParams["axes.prop_cycle"].by_key()["color"]
    return {"color": colours[index % len(colours)], "linestyle": _DASHES[index % len(_DASHES)]}
