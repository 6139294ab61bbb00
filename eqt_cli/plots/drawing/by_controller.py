"""Panels by controller and part of a norm; it knows no signal and not what is drawn."""

from __future__ import annotations

from collections.abc import Sequence

from eqt_cli.plots.drawing.labels import part_name
from eqt_cli.plots.drawing.layout import Mosaic, rows_of


def panel(controller: str, part: str) -> str:
    """The name of the panel of a controller, by its label, and a part."""
    return f"runs of {controller}{part}"


def mosaic(controllers: Sequence[str], parts: Sequence[str], columns: int = 2) -> Mosaic:
    """A row per controller and a column per part; or, with one part, controllers in rows.

    Parameters
    ----------
    controllers
        Their labels.
    parts
        Suffixes of the norms with units of their own; one if there is nothing to tell apart.
    columns
        Panels in a row where there is one part.
    """
    if len(parts) > 1:
        return [[panel(label, part) for part in parts] for label in controllers]
    return rows_of([panel(label, parts[0]) for label in controllers], columns)


def panel_title(controller: str, part: str) -> str:
    """What stands above a panel."""
    return f"{controller}, {part_name(part)}" if part else controller
