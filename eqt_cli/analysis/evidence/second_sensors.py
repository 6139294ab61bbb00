"""Second, independent form of every measurement error, for one run."""

from collections.abc import Callable

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries, redrawn
from eqt_cli.core.arrays import Array
from eqt_cli.vehicle.sensors import Sensor

Form = Callable[[Options, int, int, float, np.random.Generator], Array]
"""Returns errors from options, numbers of coordinates and instants, period and generator."""


def deviation(given: Options, m: int, period: float) -> Array:
    """Return σ of one measurement; for a density, σ² times the period is constant."""
    if given["std"] is not None:
        return entries(given["std"], m)
    return np.sqrt(entries(given["density"], m) ** 2 / period)


def _noise(
    given: Options, m: int, instants: int, period: float, random: np.random.Generator
) -> Array:
    """Draw independent normal numbers."""
    return np.array(
        [deviation(given, m, period) * random.standard_normal(m) for _ in range(instants)]
    )


def _bias(
    given: Options, m: int, instants: int, period: float, random: np.random.Generator
) -> Array:
    """Add a normal step with the variance walk² period from each instant to the next."""
    step = np.sqrt(entries(given["walk"], m) ** 2 * period)
    now, found = np.array(entries(given["value"], m)), []
    random.standard_normal(m)  # drawn for the first instant, which has no step
    for _ in range(instants):
        found.append(now)
        now = now + step * random.standard_normal(m)
    return np.array(found)


FORMS: dict[str, Form] = {"noise": _noise, "bias": _bias}
"""By the registered name of the sensor."""


def second_errors(
    sensor: Sensor, m: int, instants: int, period: float, random: np.random.Generator
) -> Array | None:
    """Return the errors of one run; None if the sensor has no second form."""
    form = FORMS.get(sensor.name)
    if form is None:
        return None
    return form(redrawn(sensor, random), m, instants, period, random)


def configured_deviation(
    sensor: Sensor, m: int, period: float, random: np.random.Generator
) -> Array | None:
    """Return the configured σ of white noise in one run; None for any other sensor."""
    return deviation(redrawn(sensor, random), m, period) if sensor.name == "noise" else None
