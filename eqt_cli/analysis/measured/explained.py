"""Shares of a measured tracking error that a run explains: numbers, a table, and plain data."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.measured.run import Error, MeasuredRun
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup

ShownIn = Callable[[str, str], tuple[str, float]]
"""The unit in which a quantity is shown, and the factor to it, from its name and its unit."""


@dataclass(frozen=True)
class Share:
    """The share of a measured error that a run explains.

    Attributes
    ----------
    quantity, part, axis, unit
        The quantity (``pose``, ``velocity`` or ``wrench``), the part of the coordinates, the axis
        (empty for all axes of the part), and the unit.
    measured, simulated, difference
        Root mean squares over the rows of the measured error, the simulated error, and their
        difference.
    explained
        1 − difference² / measured²: 1 if the run has the measured error, 0 if the run is as far
        from the recording as the reference is, and negative if it is farther.
    """

    quantity: str
    part: str
    axis: str
    unit: str
    measured: float
    simulated: float
    difference: float
    explained: float


@dataclass(frozen=True)
class Explanation:
    """The shares of the errors of a recording that the run of a controller explains.

    Attributes
    ----------
    controller, title, run
        Label and display name of the controller, and number of the run.
    offset, offset_error
        Clock offset of the recording and its standard error, s; NaN if the offset was given.
    rows
        Number of compared rows.
    shares
        Shares by quantity, part and axis.
    notes
        Notes on the compared rows, on missing measurements, and on the file.
    """

    controller: str
    title: str
    run: int
    offset: float
    offset_error: float
    rows: int
    shares: list[Share]
    notes: list[str]


def explained(measured: MeasuredRun, shown_in: ShownIn) -> Explanation:
    """Compute the shares of the errors of a recording that the run explains, in units of a user."""
    seen, G = measured.recording, measured.recording.group
    shares = [share for error in measured.errors for share in _shares(G, error, shown_in)]
    return Explanation(
        measured.label,
        measured.title,
        measured.run,
        measured.alignment.offset,
        measured.alignment.error,
        len(seen.times),
        shares,
        [*measured.notes, *(f"{seen.name}: {note}" for note in seen.notes)],
    )


def _shares(G: MatrixLieGroup, error: Error, shown_in: ShownIn) -> Iterator[Share]:
    for part in G.parts:
        axes = list(range(*part.axes.indices(G.dimension)))
        known = [axis for axis in axes if not np.isnan(error.measured[:, axis]).any()]
        if not known:
            continue
        chosen = [("", known)]
        if len(axes) > 1:
            chosen += [(G.axis_names[axis], [axis]) for axis in known]
        unit, by = shown_in(error.quantity, error.unit(part))
        for name, of in chosen:
            every = error.measured, error.simulated, error.difference
            first, second, left = (by * _size(values[:, of]) for values in every)
            share = 1 - (left / first) ** 2 if first > 0 else np.nan
            yield Share(error.quantity, part.name, name, unit, first, second, left, share)


def _size(values: Array) -> float:
    """Return the root mean square of the norm over the rows."""
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1))))


def records(found: Sequence[Explanation]) -> list[dict[str, Any]]:
    """Return a record for each share."""
    return [
        {"controller": one.controller, "run": one.run, "rows": one.rows, "offset": one.offset}
        | asdict(share)
        for one in found
        for share in one.shares
    ]


def explained_table(found: Sequence[Explanation], write: Plain, *, axes: bool) -> TextTable:
    """Return the table of shares, a block per law; rows of single axes only if `axes`."""
    several = len(found) > 1
    blocks = [
        Block(
            write.text(one.title) if several else "",
            [_row(share, write) for share in one.shares if axes or not share.axis],
        )
        for one in found
    ]
    notes = [
        "Errors relative to the reference, in the body frame: root mean squares over the rows. "
        "Explained: 1 − difference² / measured error². It is 100 % where the run has the measured "
        "error, 0 % where it is as far from the recording as the reference is, and negative where "
        "it is farther.",
        *(f"{note}." for note in found[0].notes),
    ]
    whose = "each controller" if several else found[0].title
    return TextTable(
        "measured",
        write.text(f"How much of the measured error run {found[0].run} of {whose} explains"),
        ["error of", "axis", "unit", "measured", "simulated", "difference", "explained"],
        blocks,
        [write.text(note) for note in notes],
        spare=("simulated",),
        keys=2,
    )


def _row(share: Share, write: Plain) -> list[str]:
    numbers = (share.measured, share.simulated, share.difference)
    known = share.explained == share.explained
    return [
        write.text(f"{share.quantity}, {share.part.replace('_', ' ')}"),
        write.text(share.axis.lstrip("ωv") if share.axis else "all"),
        write.unit(share.unit),
        *(write.number(f"{number:.3g}") for number in numbers),
        write.text(f"{100 * share.explained:.1f} %") if known else "-",
    ]
