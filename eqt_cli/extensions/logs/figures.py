"""Figures of the errors in recordings."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.base.files import write_all
from eqt_cli.extensions.logs.logs import QUANTITIES, TrackingErrors, error_files
from eqt_cli.figures import layout, style
from eqt_cli.figures.labels import in_words
from eqt_cli.figures.render import FORMATS, encode

THIN = 0.8
"""Line width of a curve, pt."""


def thin_curve(k: int) -> dict[str, Any]:
    """The look of the curve of a coordinate."""
    return {"linewidth": THIN, **style.component_style(k)}


def encoded(drawing: Drawing, panels: Any, x: str, remark: str, path: Path) -> dict[Path, bytes]:
    """Finish a figure of panels below each other; return its files by their paths."""
    layout.add_letters(drawing)
    if x:
        list(panels.values())[-1].set_xlabel(in_words(x, "s"))
    layout.add_remarks(drawing, [remark])
    layout.freeze(drawing)
    return {
        path.with_suffix(f".{form}"): encode(drawing, form, remark, "Errors") for form in FORMATS
    }


def save_errors(tracking: TrackingErrors, name: str, folder: Path) -> None:
    """Draw the errors over time, a panel for each quantity, and write them with their tables.

    Raises
    ------
    EqtError
        If a file cannot be written.
    """
    times = np.concatenate([t for t, _ in tracking.curves.values()])
    with style.house_style():
        ends, rows = (float(times.min()), float(times.max())), layout.rows_of([*tracking.curves], 1)
        drawing, panels = layout.sheet("column", rows, ends, "s")
        for quantity, (t, errors) in tracking.curves.items():
            unit, axes = QUANTITIES[quantity]
            gaps = np.flatnonzero(np.diff(t) > 1.0) + 1  # nothing is drawn where none is compared
            behind = np.insert(t, gaps, np.nan), np.insert(errors, gaps, np.nan, axis=0)
            for k, axis in [*enumerate(axes)][-3:]:
                panels[quantity].plot(behind[0], behind[1][:, k], label=axis, **thin_curve(k % 3))
            layout.name_scale(panels[quantity], in_words(f"{quantity} error", unit))
            panels[quantity].legend(ncols=3, loc="upper right")
        remark = f"{name}: {tracking.headline}."
        files = encoded(drawing, panels, "time", remark, folder / "errors")
    write_all(files | error_files(tracking, folder), folder)
