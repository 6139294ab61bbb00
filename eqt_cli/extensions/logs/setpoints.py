"""The setpoints that stand in the same table as the measurement, as a table of their own."""

import csv
import io
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eqt_cli.base.errors import suggestion
from eqt_cli.components.pose_tables import EULER, QUATERNION, LogMapping, MappingError
from eqt_cli.extensions.logs.log_table import Sheet, is_eqt_name, open_sheet
from eqt_cli.extensions.logs.tables import with_columns
from eqt_cli.extensions.logs.usual_names import Column, usual_setpoints

QUANTITIES: dict[str, list[tuple[str, ...]]] = {
    "position": [("x", "y", "z")],
    "attitude": [QUATERNION, EULER],
    "velocity": [("vx", "vy", "vz")],
    "rates": [("wx", "wy", "wz")],
}
"""The columns of each quantity that has errors, in each of their forms."""


def setpoint_columns(sheet: Sheet, mapping: LogMapping) -> dict[str, Column | float]:
    """Return the columns of the setpoints by eqt's names; a number is the same in all rows.

    Raises
    ------
    MappingError
        If the mapping names a column that the file does not have, or a part of a quantity only.
    """
    if not mapping.setpoint:
        usual = usual_setpoints(sheet.headings, is_eqt_name, mapping.quaternion or "")
        whole = {x for names in _whole(usual) for x in names}
        return {name: column for name, column in usual.items() if name in whole}
    columns = dict[str, Column | float]()
    headings = [x for x in mapping.setpoint.values() if isinstance(x, str)]
    for name, source in mapping.setpoint.items():
        if not isinstance(source, str):
            columns[name] = source
        elif headings.count(source) > 1:
            raise MappingError(("setpoint", name), f"'{source}' is given for two columns")
        elif source in sheet.headings:
            columns[name] = Column(source)
        else:
            hint = suggestion(source, sheet.headings) or "; write a heading, without a unit"
            place = ("setpoint", name)
            raise MappingError(place, f"{sheet.header_place}: no column '{source}'{hint}")
    whole = {x for names in _whole(columns) for x in names}
    if rest := [name for name in columns if name not in whole]:
        forms = "; ".join(", ".join(names) for forms in QUANTITIES.values() for names in forms)
        raise MappingError(("setpoint", rest[0]), f"a quantity has all of its columns: {forms}")
    return columns


def _quantities_of(columns: dict[str, Column | float]) -> dict[str, str]:
    words, whole = dict[str, str](), [*_whole(columns)]
    for quantity, forms in QUANTITIES.items():
        for form in (form for form in forms if form in whole):
            some = (columns[name] for name in form)
            words[quantity] = ", ".join(
                x.heading if isinstance(x, Column) else f"{x:g}" for x in some
            )
    return words


def _whole(names: dict[str, Column | float] | dict[str, Column]) -> Iterator[tuple[str, ...]]:
    for forms in QUANTITIES.values():
        yield from (form for form in forms if {*form} <= {*names})


class Setpoints(NamedTuple):
    """The setpoints in a table.

    Attributes
    ----------
    text, mapping
        A table of its own, with a row for each of the file, and its mapping.
    quantities
        The headings of each quantity of `QUANTITIES` that it holds, in words.
    """

    text: str
    mapping: LogMapping
    quantities: dict[str, str]


def setpoints_of(text: str, name: str, mapping: LogMapping) -> Setpoints:
    """Return the setpoints in a table.

    A column without a unit has that of the measurement, and a blank cell what was before it.
    """
    sheet = open_sheet(text, name, "csv", mapping)
    columns = setpoint_columns(sheet, mapping)
    by_heading = {x.heading: (eqt, x) for eqt, x in columns.items() if isinstance(x, Column)}
    measured, head, places = sheet.units | mapping.units, list[str](), list[int]()
    for k, (eqt, heading) in enumerate(zip(sheet.names, sheet.headings, strict=True)):
        if heading in by_heading:
            places.append(k)
            eqt, column = by_heading[heading]
            unit = mapping.units.get(heading) or sheet.units.get(heading) or column.unit
            unit = unit or measured.get(eqt, "")
        elif eqt == "t":
            unit = measured.get("t", "")
        else:
            eqt, unit = f"column {k + 1}", ""
        head.append(f"{eqt} ({unit})" if unit else eqt)
    before = text.removeprefix("\ufeff").splitlines()
    rows = [_written(head), *_filled(before[sheet.head :], places)]
    table = "\n".join([*rows, ""])
    if same := {eqt: x for eqt, x in columns.items() if not isinstance(x, Column)}:
        cells = np.tile([*same.values()], (len(rows) - 1, 1))
        table = with_columns(table, ",".join(same), cells)
    scale = {key: factor for key, factor in mapping.scale.items() if key in columns}
    plain = replace(mapping, columns={}, units={}, scale=scale, setpoint={}, sensor=None)
    plain = replace(plain, command={})
    plain = replace(plain, quaternion=None, drop=[*dict.fromkeys([*mapping.drop, "invalid"])])
    return Setpoints("\n" * (sheet.head - 1) + table, plain, _quantities_of(columns))


def _written(cells: list[str]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="").writerow(cells)
    return stream.getvalue()


def _filled(rows: list[str], places: list[int]) -> Iterator[str]:
    """Yield rows in which a blank cell of some columns has the number of an earlier row."""
    last = dict.fromkeys(places, "")
    for row in rows:
        if not row.strip():
            yield row
            continue
        cells = next(csv.reader([row])) if '"' in row else row.split(",")
        blank = [k for k in places if k < len(cells) and cells[k].strip().lower() in ("", "nan")]
        for k in blank:
            cells[k] = last[k]
        last |= {k: cells[k] for k in places if k < len(cells)}
        yield _written(cells) if blank else row
