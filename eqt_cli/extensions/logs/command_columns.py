"""The commands that stand in the same table as the measurement, with their units."""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, suggestion
from eqt_cli.base.units import factor
from eqt_cli.components.pose_tables import EULER, QUATERNION, LogMapping, MappingError
from eqt_cli.extensions.logs.log_table import NORMALISED, Sheet, units_of
from eqt_cli.extensions.logs.usual_names import Column, usual_commands

THRUST = "thrust"
"""The command of a force along z of the body."""

HOVER = "hover"
"""The thrust that carries the weight, in the unit of the thrust."""

GRAM = 9.80665e-3
"""Force of a gram, N, as data sheets of rotors state thrusts."""

RANGE = re.compile(r"(?i)(?:pwm *)?(-?\d+(?:\.\d+)?) *(?:to|-|–|\.\.) *(-?\d+(?:\.\d+)?)")
"""A range of numbers that stands for none to all of a command: ``0 to 65535``."""

KINDS = {"N m": "torque", "N": "force"}
"""The key of `units` that states the unit of all commands of a kind, by eqt's unit."""

UNITS = {
    THRUST: "N, g (the force of a gram), m/s^2, normalised, % or a range such as 0 to 65535",
    "torque": "N m, mN m, normalised, % or a range such as -1000 to 1000",
    "n": "rad/s, rpm, or, of PWM, a range such as 0 to 65535 or 1000 to 2000",
}
UNITS["force"] = UNITS[THRUST]
"""What messages offer."""


class Command(NamedTuple):
    """A column of commands, or a number that is the same in all rows.

    Attributes
    ----------
    source
        The heading, or the number.
    unit
        The unit in the file, empty if it is not stated, and eqt's unit.
    """

    source: str | float
    unit: str


def eqt_unit(name: str) -> str:
    """Return eqt's unit of a command; empty for a quaternion."""
    if name in (THRUST, HOVER):
        return "N"
    if name in QUATERNION:
        return ""
    units = units_of(name)
    return next((unit for unit in ("rad/s", "m/s^2") if unit in units), next(iter(units), ""))


def _is_command(name: str) -> bool:
    is_pose = name in (*QUATERNION, *EULER, "wx", "wy", "wz", "ax", "ay", "az")
    return name in (THRUST, HOVER) or is_pose or eqt_unit(name) in ("N m", "N") or _is_speed(name)


def _is_speed(name: str) -> bool:
    return bool(re.fullmatch(r"n[1-9]\d*", name))


def kind_of(name: str) -> str:
    """Return the kind of a command: thrust, torque, force, n, or empty."""
    if _is_speed(name):
        return "n"
    return THRUST if name in (THRUST, HOVER) else KINDS.get(eqt_unit(name), "")


def own_commands(sheet: Sheet, mapping: LogMapping) -> dict[str, Command]:
    """Return columns with eqt's own names whose unit only commands have, such as a range."""
    special = dict[str, Command]()
    for name, heading in zip(sheet.names, sheet.headings, strict=True):
        unit = mapping.units.get(name) or sheet.units.get(name, "")
        if kind_of(name) and unit != NORMALISED and _share(unit, name):
            special[name] = Command(heading, unit)
    return special


def commands_of(sheet: Sheet, mapping: LogMapping) -> dict[str, Command]:
    """Return the commands in a table by eqt's names: of the mapping, or by usual headings.

    Raises
    ------
    MappingError
        If the mapping names a column that the file does not have, or no command of eqt's.
    """
    columns: Mapping[str, Column | float] = dict(_stated(sheet, mapping))
    if not mapping.command:
        columns = usual_commands(sheet.headings, {*sheet.names} - {THRUST})
    commands = dict[str, Command]()
    for name, column in columns.items():
        if not isinstance(column, Column):
            commands[name] = Command(column, "")
            continue
        heading = column.heading
        keys = (heading, name, kind_of(name)) if kind_of(name) else (heading,)
        stated = next((mapping.units[key] for key in keys if key in mapping.units), "")
        at = sheet.headings.index(heading)
        commands[name] = Command(heading, stated or sheet.units.get(sheet.names[at]) or column.unit)
    return commands


def _stated(sheet: Sheet, mapping: LogMapping) -> Iterator[tuple[str, Column | float]]:
    headings = [x for x in mapping.command.values() if isinstance(x, str)]
    for name, source in mapping.command.items():
        place = ("command", name)
        if not _is_command(name):
            expected = "thrust, tx, ty, tz, fx, fy, fz, n1, n2, …, qw, qx, qy, qz, yaw, pitch, roll"
            hint = (
                suggestion(name, (THRUST, *QUATERNION, *EULER))
                or f"; expected {expected}, wx or ax"
            )
            raise MappingError(place, f"eqt has no command of this name{hint}")
        if isinstance(source, str) and headings.count(source) > 1:
            raise MappingError(place, f"'{source}' is given for two commands")
        if isinstance(source, str) and source not in sheet.headings:
            hint = suggestion(source, sheet.headings) or "; write a heading, without a unit"
            raise MappingError(place, f"{sheet.header_place}: no column '{source}'{hint}")
        yield name, Column(source) if isinstance(source, str) else source


class _Scale(NamedTuple):
    """How numbers become eqt's: (x − offset) · factor, of which the largest is 1 for a share."""

    offset: float
    factor: float
    unit: str


def _share(unit: str, name: str) -> _Scale | None:
    """Return the scale of a unit that only commands have; None for others."""
    kind = kind_of(name)
    if ends := RANGE.fullmatch(unit.strip()):
        low, high = float(ends[1]), float(ends[2])
        if low < high:
            low = 0.0 if low == -high else low  # to both sides
            return _Scale(low, 1 / (high - low), NORMALISED)
    if unit in (NORMALISED, "%"):
        return _Scale(0.0, 0.01 if unit == "%" else 1.0, NORMALISED)
    if kind in (THRUST, "force") and factor(unit, "kg"):
        return _Scale(0.0, (factor(unit, "g") or 1.0) * GRAM, "N")
    if kind in (THRUST, "force") and (ratio := factor(unit, "m/s^2")):
        return _Scale(0.0, ratio, NORMALISED)
    return None


def scale_of(name: str, command: Command, place: str) -> _Scale:
    """Return how the numbers of a command become eqt's.

    Raises
    ------
    InputError
        For a unit that such a command cannot have, or for none where it must be stated.
    """
    unit, default = command.unit, eqt_unit(name)
    if not unit and kind_of(name) in (THRUST, "n"):
        raise InputError(f"{place}: {unclear(name, command)}")
    if not unit or (ratio := factor(unit, default)) == 1.0:
        return _Scale(0.0, 1.0, default)
    if ratio:
        return _Scale(0.0, ratio, default)
    if kind_of(name) and (share := _share(unit, name)):
        return share
    expected = UNITS.get(kind_of(name)) or default or "no unit"
    what = f"command {name}, column {command.source}"
    raise InputError(f"{place}: {what}: expected {expected}, got '{unit}'")


def unclear(name: str, command: Command) -> str:
    """Return what a mapping must state, for a message."""
    kind = kind_of(name)
    return (
        f"{command.source} may be the command {name}; state its unit, "
        f"`units: {{{kind if kind == 'n' else command.source}: …}}`: {UNITS[kind]}"
    )


def numbers_of(sheet: Sheet, commands: Mapping[str, Command]) -> tuple[Array, dict[str, str]]:
    """Return commands in eqt's units, ``(rows, n)``, and these units; a blank cell holds.

    Raises
    ------
    InputError
        For a wrong unit, text, or a number outside a range.
    """
    rows, units = np.empty((len(sheet.lines), len(commands))), dict[str, str]()
    for k, (name, command) in enumerate(commands.items()):
        if not isinstance(command.source, str):
            rows[:, k], units[name] = command.source, eqt_unit(name)
            continue
        scale = scale_of(name, command, sheet.header_place)
        heading = sheet.names[sheet.headings.index(command.source)]
        numbers = _held((sheet.numbers_of([heading])[:, 0] - scale.offset) * scale.factor)
        least = -1.0 if scale.offset == 0 and command.unit.strip().startswith("-") else 0.0
        outside = (numbers < least - SLACK) | (numbers > 1 + SLACK)
        if RANGE.fullmatch(command.unit.strip()) and outside.any():
            row = int(np.flatnonzero(outside)[0])
            got = f"{numbers[row] / scale.factor + scale.offset:.7g}"
            what = f"expected {command.unit} in column {command.source}, got {got}"
            raise InputError(f"{sheet.name}:{sheet.numbers[row]}: {what}; state another range")
        rows[:, k], units[name] = numbers, scale.unit
    return rows, units


SLACK = 0.02
"""Share of a range by which numbers may be outside."""


def _held(numbers: Array) -> Array:
    """Return numbers in which one that is missing is the last one before."""
    last = np.maximum.accumulate(np.where(np.isfinite(numbers), np.arange(len(numbers)), 0))
    return numbers[last]


def with_commands(
    sheet: Sheet, mapping: LogMapping, wrench: Collection[str], needs_numbers: bool
) -> Sheet:
    """Return a sheet in which commanded wrenches and rotor speeds are columns of eqt.

    A thrust is a force along z of the body. By usual headings, only what the file has not under
    eqt's own names is read: a whole wrench, else speeds of rotors.

    Parameters
    ----------
    wrench
        eqt's names of the wrench of the group.
    needs_numbers
        Whether numbers are of use; without, no unit of a command is looked at.
    """
    special, usual, hint = own_commands(sheet, mapping), commands_of(sheet, mapping), ""
    has_wrench = {*wrench} <= {*sheet.names} or any(map(_is_speed, sheet.names))
    chosen = special | usual if mapping.command else special
    if not mapping.command and not has_wrench and wrench:
        forces = {*"fx fy fz".split()} if THRUST in usual else set()
        some = {name: x for name, x in usual.items() if name in wrench or name == THRUST}
        is_whole = {*wrench} <= {*some, *forces, *sheet.names}
        some = some if is_whole else {n: x for n, x in usual.items() if _is_speed(n)}
        lacks = [n for n, x in some.items() if not x.unit and kind_of(n) in (THRUST, "n")]
        hint = unclear(lacks[0], some[lacks[0]]) if lacks else ""
        if THRUST in usual and not some:
            hint = f"{usual[THRUST].source} is a thrust without torques: commanded rates and "
            hint += "attitudes are no wrench, but setpoints of an inner loop"
        chosen |= some if not lacks else {}
    chosen = {name: x for name, x in chosen.items() if kind_of(name) and name != HOVER}
    mine = {*special, *mapping.command}
    names = [f"{name} (file)" if name in mine else name for name in sheet.names]
    whose = {x.source: (name, x.unit or eqt_unit(name)) for name, x in chosen.items()}
    used = zip(names, sheet.headings, strict=True)
    words = {name: whose[heading] for name, heading in used if heading in whose}
    sheet = replace(sheet, names=names, unclear=hint, commands=words)
    if not needs_numbers or not chosen:
        return sheet
    rows, units = numbers_of(sheet, chosen)
    columns = dict(zip(units, rows.T, strict=True))
    if THRUST in columns:
        if mapping.force == "spatial":
            raise MappingError(("command", THRUST), "acts along the body; use `force: body`")
        down = -1.0 if mapping.body == "FRD to FLU" else 1.0
        thrust, unit = down * columns.pop(THRUST), units.pop(THRUST)
        for name, numbers in (("fx", 0.0 * thrust), ("fy", 0.0 * thrust), ("fz", thrust)):
            if name in columns:
                raise MappingError(("command", name), "and a thrust are given; remove one")
            if name in wrench:
                columns[name], units[name] = numbers, unit
    if len({units[n] == NORMALISED for n in units if n in ("fx", "fy", "fz")}) > 1:
        units |= {n: NORMALISED for n in ("fx", "fy", "fz") if np.all(columns[n] == 0)}
    units = {name: "rad/s" if _is_speed(name) else unit for name, unit in units.items()}
    return sheet.with_numbers(units, np.stack([*columns.values()], axis=-1))
