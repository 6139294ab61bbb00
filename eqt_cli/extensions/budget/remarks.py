"""Remarks before a run: numbers of a data sheet that stand without their unit."""

from collections.abc import Iterator
from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.option_types import DENSITY, MEASURED, WALK, UnitPlace
from eqt_cli.base.units import factor
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.config.experiment import Experiment

KEYS = {"density": DENSITY, "walk": WALK, "instability": MEASURED}
"""Keys whose unit nobody guesses, and that unit."""

LARGEST = {
    "rad/sqrt(s)": (1e-3, "deg/sqrt(h)"),  # 3.4 deg/sqrt(h)
    "rad/s/sqrt(s)": (1e-2, "deg/h/sqrt(h)"),
    "rad/s": (1e-3, "deg/h"),  # 206 deg/h
    "rad sqrt(s)": (1e-2, "arcsec/sqrt(Hz)"),
    "m/s/sqrt(s)": (1e-2, "m/s/sqrt(h)"),
    "m/s^2/sqrt(s)": (1e-1, "ug/sqrt(h)"),
    "m/s^2": (1e-1, "ug"),
    "T sqrt(s)": (1e-5, "nT/sqrt(Hz)"),
    "T": (1e-5, "nT"),
}
"""What no usual sensor exceeds, by unit, and the unit of data sheets."""


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: object) -> Iterator[tuple[Any, str]]:
    """Yield numbers without a unit that are larger than those of sensors."""
    for place, sensors in (experiment.document.data.get("sensors") or {}).items():
        for index, sensor in enumerate(sensors if isinstance(sensors, list) else ()):
            for key in KEYS:
                if isinstance(sensor, dict) and key in sensor:
                    for text in _too_large(sensor, key, place, experiment.group):
                        yield ("sensors", place, index, key), text


def _too_large(
    sensor: dict[str, Any], key: str, place: str, group: MatrixLieGroup
) -> Iterator[str]:
    """Yield what is wrong with the largest plain number of each part, in the unit of that part."""
    by_part = UnitPlace(group, place, str(sensor.get("of", ""))).units(KEYS[key])
    written, stop = sensor[key], max(axes.stop for _, axes in by_part.values())
    is_of_all = len(by_part) > 1 and isinstance(written, list) and len(written) == stop
    for of_part, axes in by_part.values():
        most = max(_plain(written[axes] if is_of_all else written), default=0.0)
        for unit, (largest, of_sheets) in LARGEST.items():
            if most > largest and factor(of_part, unit):
                yield (
                    f"{most:g} without a unit is {most:g} {unit}, or "
                    f"{most * (factor(unit, of_sheets) or 1.0):.3g} {of_sheets}; write the unit, "
                    f"such as '{most:g} {of_sheets}'"
                )


def _plain(written: Any) -> Iterator[float]:
    """Yield the absolute numbers in a value, also in lists and distributions."""
    if isinstance(written, int | float):
        yield abs(written)
    elif isinstance(written, list | dict):
        for entry in written.values() if isinstance(written, dict) else written:
            yield from _plain(entry)
