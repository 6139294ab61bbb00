"""Checks the entries of `sensors`: their parts and their timing."""

from collections.abc import Mapping
from typing import Any

from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.sensors import Sensor
from eqt_cli.vehicle.sensors.channels import TIMING

ROUNDING = 1e-9
"""Relative tolerance for a period that is a whole number of control periods."""


def check_sensors(
    sensors: Mapping[int, Sensor], G: MatrixLieGroup, period: float | None, problems: Problems
) -> None:
    """Note unknown parts, impossible timing, and entries that contradict each other.

    Parameters
    ----------
    sensors
        Sensors of the pose or of the velocity, by the numbers of their entries.
    period
        Control period, s; None if unknown.
    """
    known = [part.name for part in G.parts]
    for index, sensor in sensors.items():
        here = problems.at(index)
        if sensor.of is not None and sensor.of not in known:
            parts = ", ".join(known)
            here.at("of").add(f"{G.name} has no part '{sensor.of}'; choose one of {parts}")
        if sensor.dropout is not None and not 0 <= sensor.dropout < 1:
            here.at("dropout").add(
                f"expected a probability of at least 0 and less than 1, got {sensor.dropout:g}"
            )
        if sensor.period is not None and period is not None:
            _check_period(sensor.period, period, here.at("period"))
    for part in known:
        _check_agreement(sensors, part, problems)


def _check_period(own: float, control: float, problems: Problems) -> None:
    """Note a period that is not a whole number of control periods."""
    count = round(own / control)
    if count >= 1 and abs(own - count * control) <= ROUNDING * own:
        return
    below = max(1, int(own / control))
    near = f"{below * control:g} or {(below + 1) * control:g}"
    problems.add(
        f"expected a whole number of control periods of {control:g} s, such as {near}, got {own:g}"
    )


def _check_agreement(sensors: Mapping[int, Sensor], part: str, problems: Problems) -> None:
    """Note timing in which two entries of one part differ."""
    for name in TIMING:
        first: tuple[int, Any] | None = None
        for index, sensor in sensors.items():
            value = getattr(sensor, name)
            if value is None or sensor.of not in (None, part):
                continue
            if first is None:
                first = index, value
            elif first[1] != value:
                problems.at(index, name).add(
                    f"entries of one part share their {name}: {problems.at(first[0]).path} gives "
                    f"{first[1]:g} for the {part}, and this entry {value:g}; give it at one of them"
                )
