"""Every error of measurement written a second time, for one run."""

from collections.abc import Callable

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries, redrawn
from eqt_cli.core.arrays import Array
from eqt_cli.vehicle.sensors import Sensor

Form = Callable[[Options, int, int, float, np.random.Generator], Array]
"""From options, the number of coordinates, of instants, the period and the generator to errors."""


def deviation(given: Options, m: int, period: float) -> Array:
    """σ of one measurement; of a density σ² period is the same at any period."""
    if given["std"] is not None:
        return entries(given["std"], m)
    return np.sqrt(entries(given["density"], m) ** 2 / period)


def _noise(
    given: Options, m: int, instants: int, period: float, random: np.random.Generator
) -> Array:
    """Independent normals."""
    return np.array(
        [deviation(given, m, period) * random.standard_normal(m) for _ in range(instants)]
    )


def _bias(
    given: Options, m: int, instants: int, period: float, random: np.random.Generator
) -> Array:
    """From one instant to the next by a normal whose variance is walk² period."""
    step = np.sqrt(entries(given["walk"], m) ** 2 * period)
    now, found = np.array(entries(given["value"], m)), []
    random.standard_normal(m)  # of the first instant, at which there is no step yet
    for _ in range(instants):
        found.append(now)
        now = now + step * random.standard_normal(m)
    return np.array(found)


FORMS: dict[str, Form] = {"noise": _noise, "bias": _bias}
"""By the registered name of the sensor."""


def second_errors(
    sensor: Sensor, m: int, instants: int, period: float, random: np.random.Generator
) -> Array | None:
    """The errors of one run; None where the sensor has no second form."""
    form = FORMS.get(sensor.name)
    if form is None:
        return None
    return form(redrawn(sensor, random), m, instants, period, random)


def configured_deviation(
    sensor: Sensor, m: int, period: float, random: np.random.Generator
) -> Array | None:
    """σ of white noise as the configuration has it, in one run; None of any other sensor."""
    return deviation(redrawn(sensor, random), m, period) if sensor.name == "noise" else None
