"""Remarks before a run: orbits that no satellite has, and two that contradict each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.components.vehicle import ACTUATORS
from eqt_cli.components.vehicle_parts import drawn
from eqt_cli.config.experiment import Experiment
from eqt_cli.extensions.spacecraft.gravity import GravityGradient
from eqt_cli.extensions.spacecraft.magnetic import GRAVITATION, RADIUS, Orbit

LOWEST = 100e3
"""Height below which no satellite completes an orbit, m."""

FASTEST = float(np.sqrt(GRAVITATION / RADIUS**3))
"""Rate of a circle at the ground of the Earth, 1/s. That of any planet is √(4/3 π G ρ), and none
is denser."""

ALIKE = {"rate": 0.02, "eccentricity": 1e-3, "anomaly": 0.02}
"""Differences that rounded numbers explain: of the rate, with two digits; of e; rad."""


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: object) -> Iterator[tuple[Any, str]]:
    """Yield heights and rates of no orbit, and orbits of forces that are not the field's."""
    config = experiment.config
    orbits: list[tuple[int, Orbit]] = []
    for index, part in enumerate(config.actuators or ()):
        if isinstance(orbit := getattr(part, "orbit", None), Orbit):
            orbits.append((index, orbit))
            if orbit.altitude < LOWEST:
                yield (
                    (ACTUATORS, index, "orbit", "altitude"),
                    f"is {orbit.altitude:g} m above the Earth, where no satellite stays; if "
                    f"kilometres were meant, write '{orbit.altitude:g} km'",
                )
    for section in ("plant", "model"):
        forces = getattr(getattr(config, section), "forces", None)
        for k, force in enumerate(forces if isinstance(forces, list | tuple) else ()):
            if isinstance(force, GravityGradient):
                key = (section, "forces", k)
                yield from ((key + end, text) for end, text in _of_force(force, orbits))


def _of_force(
    force: GravityGradient, orbits: list[tuple[int, Orbit]]
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield remarks on the orbit of a gravity gradient, with the ends of their keys."""
    rate, e = float(drawn(force.rate, None)), force.eccentricity
    fastest = FASTEST * (1 - e) ** 1.5
    if rate > fastest and not orbits:
        hint = f"; if degrees were meant, write '{rate:g} deg/s'"
        yield (
            ("rate",),
            f"is {rate:g} rad/s, and no orbit of the eccentricity {e:g} above a planet is faster "
            f"than {fastest:.3g}{hint if np.radians(rate) < fastest else ''}",
        )
    for index, orbit in orbits:
        field = f"actuators[{index}].orbit"
        n = float(
            np.sqrt(GRAVITATION / ((RADIUS + orbit.altitude) / (1 - orbit.eccentricity)) ** 3)
        )
        if abs(rate / n - 1) > ALIKE["rate"]:
            yield (
                ("rate",),
                f"is {rate:.4g} rad/s, but {field} has {n:.4g}, so that its torque is "
                f"{(rate / n) ** 2:.3g} times as large; give both one orbit",
            )
        if abs(e - orbit.eccentricity) > ALIKE["eccentricity"]:
            yield (
                ("eccentricity",),
                f"is {e:g}, but {field} has {orbit.eccentricity:g}; give both one orbit",
            )
        apart = np.angle(np.exp(1j * (force.anomaly - orbit.anomaly)))
        if max(e, orbit.eccentricity) > ALIKE["eccentricity"] and abs(apart) > ALIKE["anomaly"]:
            degrees = np.degrees([force.anomaly, orbit.anomaly])
            yield (
                ("anomaly",),
                f"is {degrees[0]:.4g} deg, but {field} has {degrees[1]:.4g} deg, so that "
                "the satellite is at two places; give both one",
            )
