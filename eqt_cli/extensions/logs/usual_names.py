"""Finds columns by the names that other programs give them, which `usual_names.yaml` lists."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from eqt_cli.base import yaml_source
from eqt_cli.base.units import factor

AXES, QUATERNION = "xyz", "xyzw"
STEPS = (2e-4, 2.5)
"""Least and largest time between rows by which a column is taken for a time in s."""


class Column(NamedTuple):
    """A column of a file: its heading, and its unit where its name tells it."""

    heading: str
    unit: str = ""


@lru_cache(maxsize=1)
def _table() -> dict[str, Any]:
    path = Path(__file__).with_suffix(".yaml")
    return dict(yaml_source.load(path.read_text(encoding="utf-8"), path.name).data)


def _plain(heading: str) -> str:
    return re.sub(r"[\s._/\[\]]+", "_", heading).strip("_").lower()


def _rows() -> Iterator[tuple[dict[str, str], str]]:
    """Yield eqt's names by those of another program, and the unit that these tell."""
    for name, patterns, *unit in _table()["state"]:
        for pattern in patterns:
            axes = QUATERNION if name.startswith("q") else AXES
            yield (
                {
                    pattern.format(a=axis, A=axis, i=k).lower(): name.format(a=axis)
                    for k, axis in enumerate(axes)
                },
                "".join(unit),
            )


def usual_columns(headings: Sequence[str], taken: Collection[str]) -> dict[str, Column]:
    """Return columns of a pose and of velocities by eqt's names.

    Parameters
    ----------
    headings
        The headings of a file.
    taken
        Names of eqt that columns have already; a quantity with one of them is not looked for.
    """
    plain = {_plain(heading): heading for heading in reversed(headings)}
    columns = dict[str, Column]()
    for names, unit in _rows():
        if {*names} <= {*plain} and not {*names.values()} & {*taken, *columns}:
            columns |= {eqt: Column(plain[other], unit) for other, eqt in names.items()}
    return columns


def usual_time(
    headings: Sequence[str], units: Mapping[str, str], rows: Sequence[Sequence[str]]
) -> str:
    """Return the heading of a time, or an empty text.

    Parameters
    ----------
    headings, units
        The headings of a file, and their units.
    rows
        The entries of its first rows, which tell whether a time without a unit is in s.
    """
    for place, heading in enumerate(headings):
        if _plain(heading) not in _table()["time"]:
            continue
        if units.get(heading):
            return heading if factor(units[heading], "s") else ""
        with suppress(ValueError, IndexError):
            times = [float(row[place]) for row in rows]
            steps = sorted(b - a for a, b in pairwise(times))
            if steps and STEPS[0] <= steps[len(steps) // 2] <= STEPS[1]:
                return heading
    return ""


def usual_setpoints(
    headings: Sequence[str], is_known: Callable[[str], bool], order: str = ""
) -> dict[str, Column]:
    """Return the columns of setpoints by eqt's names: ``x_ref``, ``sp_ctrltarget_x``, ``p_d[0]``.

    Parameters
    ----------
    is_known
        Whether eqt has a column of a name.
    order
        The order of numbered quaternions, such as wxyz.
    """
    words, rest = {*_table()["words"]}, dict[str, Column]()
    for heading in headings:
        parts = _plain(heading).split("_")
        left = [part for part in parts if part not in words]
        if left and len(left) < len(parts):
            small = {*parts} & {*_table()["millimetres"]}
            speed = "_".join(left).startswith("v")
            unit = ("mm/s" if speed else "mm") if small else ""
            rest.setdefault("_".join(left), Column(heading, unit))
    columns = {name: column for name, column in rest.items() if is_known(name)}
    numbered = {f"q_{k}": f"q{axis}" for k, axis in enumerate(order)}
    if numbered and {*numbered} <= {*rest}:
        columns |= {eqt: rest[name] for name, eqt in numbered.items()}
    for names, unit in _rows():
        if {*names} <= {*rest} and not {*names.values()} & {*columns}:
            columns |= {
                eqt: rest[k]._replace(unit=unit or rest[k].unit) for k, eqt in names.items()
            }
    return columns


def usual_commands(headings: Sequence[str], taken: Collection[str]) -> dict[str, Column]:
    """Return the columns of commands by eqt's names; arguments as for `usual_columns`.

    Speeds of rotors are n1, n2 and so on, as many as there are; a thrust is *thrust*.
    """
    plain = {_plain(heading): heading for heading in reversed(headings)}
    columns = dict[str, Column]()
    for name, patterns, *unit in _table()["commands"]:
        for pattern in patterns:
            first = 0 if pattern.format(a="x", k=0) in plain and "{k}" in pattern else 1
            keys: Sequence[Any] = [*AXES] if "{a}" in pattern else range(first, MOST_ROTORS + first)
            pairs = ((pattern.format(a=x, k=x), x) for x in keys)
            some = {
                name.format(a=x, k=x + 1 - first if isinstance(x, int) else x): plain[key]
                for key, x in pairs
                if key in plain
            }
            is_whole = len(some) == len(AXES) if "{a}" in pattern else bool(some)
            if is_whole and not {*some} & {*taken, *columns}:
                columns |= {eqt: Column(heading, "".join(unit)) for eqt, heading in some.items()}
    return columns


MOST_ROTORS = 12
"""Largest number of rotors whose columns are looked for."""
