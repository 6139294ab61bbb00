"""Commanded quantities of a table over time."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eqt_cli.components.pose_tables import EULER, LogMapping
from eqt_cli.extensions.logs.command_columns import (
    HOVER,
    THRUST,
    Command,
    commands_of,
    kind_of,
    numbers_of,
    own_commands,
)
from eqt_cli.extensions.logs.log_table import NORMALISED, Sheet, with_units
from eqt_cli.extensions.logs.logs import Series

FORMS = {
    "torque": ("tx", "ty", "tz"),
    "force": ("fx", "fy", "fz"),
    "thrust": (THRUST,),
    "hover": (HOVER,),
    "acceleration": ("ax", "ay", "az"),
    "attitude": ("qw", "qx", "qy", "qz"),
    "rates": ("wx", "wy", "wz"),
}
"""The columns of commanded quantities."""


def series_of_commands(sheet: Sheet, mapping: LogMapping) -> Iterator[tuple[str, Series]]:
    """Yield the commanded quantities of a table over time; a thrust without a unit is a share."""
    from scipy.spatial.transform import Rotation  # slow to import

    commands = own_commands(sheet, mapping) | commands_of(sheet, mapping)
    for name, heading in zip(sheet.names, sheet.headings, strict=True):
        if kind_of(name) and name not in commands and name not in mapping.command:
            unit = mapping.units.get(name) or sheet.units.get(name, "")
            commands[name] = Command(heading, unit)
    for name in {THRUST, HOVER} & {*commands}:
        if not commands[name].unit:
            commands[name] = commands[name]._replace(unit=NORMALISED)
    plain = replace(mapping, units={"t": mapping.units["t"]} if "t" in mapping.units else {})
    table = with_units(sheet, plain, ["t"]).table(["t"])
    times = (table.columns["t"] + table.since) * mapping.time.scale
    times = times - times[0] if mapping.time.offset == "first" else times
    times = times + mapping.time.offset if isinstance(mapping.time.offset, float) else times
    flip = np.diag([1.0, -1.0, -1.0]) if mapping.body else np.eye(3)
    inside = np.isfinite(times) & (np.diff(times, prepend=-np.inf) > 0)
    angles = {*EULER} <= {*commands}
    for quantity, names in FORMS.items():
        of_angles = quantity == "attitude" and angles
        names = EULER if of_angles else names
        if not {*names} <= {*commands}:
            continue
        numbers, units = numbers_of(sheet, {name: commands[name] for name in names})
        if of_angles:
            turned = Rotation.from_euler(mapping.euler, numbers)
            numbers = turned.as_quat(scalar_first=True)
        if quantity in ("torque", "force", "rates"):
            numbers = numbers @ flip
        unit = next(iter(units.values()))
        yield quantity, Series(sheet.name, times[inside], numbers[inside], names, unit)
