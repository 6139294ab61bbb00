"""Two sources in one table, such as motion capture and an estimate: how far their clocks differ."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import norm
from eqt_cli.base.errors import InputError
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.extensions.logs import logs
from eqt_cli.extensions.logs.delay import delay_of
from eqt_cli.extensions.logs.log_check import largest_group
from eqt_cli.extensions.logs.log_table import Sheet, open_sheet
from eqt_cli.extensions.logs.logs import Series, motions_of
from eqt_cli.extensions.logs.recording import read_log
from eqt_cli.extensions.logs.setpoints import setpoint_columns
from eqt_cli.extensions.logs.usual_names import Column, usual_columns

AXES = ("x", "y", "z")

LEAST, SURE = 2e-3, 3.0
"""Least difference of clocks that is named, s, and by how many standard errors."""


class Clocks(NamedTuple):
    """Two sources of the position, and by how much the second one is later, with its error, s."""

    first: str
    second: str
    later: float
    error: float
    speed: float

    def __str__(self) -> str:
        """Which is later, and how far the vehicle moves meanwhile."""
        way = "later" if self.later > 0 else "earlier"
        size = f"{1e3 * abs(self.later):.3g} ± {1e3 * self.error:.1g} ms {way} than {self.first}"
        path = (
            f"{1e3 * abs(self.later) * self.speed:.2g} mm at the mean speed of {self.speed:.2g} m/s"
        )
        advice = "setpoints by the clock of the other are compared at that distance"
        return f"two clocks: {self.second} are {size}, {path}; {advice}"


def clocks_of(text: str, name: str, mapping: LogMapping) -> Clocks | None:
    """Return how far the clocks of two positions in a table differ, if they do."""
    sheet = open_sheet(text, name, "csv", mapping)
    other = _other_position(sheet, mapping)
    if not other or not {*AXES} <= {*sheet.names}:
        return None
    heading = dict(zip(sheet.names, sheet.headings, strict=True))
    columns = mapping.columns | {"t": heading.get("t", "t")}
    columns |= {axis: column.heading for axis, column in other.items()}
    units = mapping.units | {a: x.unit for a, x in other.items() if x.unit and a in AXES}
    try:
        first = _position(text, name, mapping)
        second = _position(text, name, replace(mapping, columns=columns, units=units, setpoint={}))
    except InputError:
        return None
    if first is None or second is None:
        return None
    pair = logs.paired(second, first, logs.NO_SPANS, "linear", (-np.inf, np.inf))
    late = delay_of(pair)
    later, error = float(late.late[0]), float(late.errors[0])
    if not (abs(later) > max(LEAST, SURE * error)):
        return None
    length = float(norm(np.diff(first.numbers[:: max(1, len(first.times) // 300)], axis=0)).sum())
    names = (", ".join(heading[a] for a in AXES), ", ".join(other[a].heading for a in AXES))
    return Clocks(*names, later, error, length / float(first.times[-1] - first.times[0]))


def _other_position(sheet: Sheet, mapping: LogMapping) -> dict[str, Column]:
    """Return the columns of a second position, by usual names."""
    wanted = setpoint_columns(sheet, mapping).values()
    used = {x.heading for x in wanted if isinstance(x, Column)}
    pairs = zip(sheet.names, sheet.headings, strict=True)
    rest = [heading for name, heading in pairs if name not in AXES and heading not in used]
    columns = usual_columns(rest, ())
    return {a: columns[a] for a in AXES} if {*AXES} <= {*columns} else {}


def _position(text: str, name: str, mapping: LogMapping) -> Series | None:
    G = largest_group(text, name, "csv", mapping)
    log = read_log(text, name, "csv", G, mapping, of_commands=False)
    return motions_of(log).get("position")
