"""The numbers that were drawn for the vehicle of each run, by their keys in the configuration.

Runs of a study draw them again from the seed where they need them. What is stored is drawn once
more in the same way, so that it costs nothing while runs are computed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from typing import Any, get_type_hints

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import parse_key
from eqt_cli.base.option_types import POSE, VELOCITY, UnitPlace
from eqt_cli.base.registry import Keys, option_of_field
from eqt_cli.base.store_writer import Variable
from eqt_cli.base.stored import POINT
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.vehicle import ESTIMATOR, FORCES, RandomOf, Vehicle
from eqt_cli.components.vehicle_parts import (
    ConstantInertia,
    Distribution,
    NamedFormula,
    TrueInertia,
    VehiclePart,
    is_drawn,
)
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.marks import VEHICLE
from eqt_cli.config.schema import marks_of
from eqt_cli.config.study import Study

PREFIX, SUFFIX = "drawn.", ", drawn"
"""Variables of drawn numbers are called by the one and their key, as swept coordinates are,
``drawn.plant.forces.0.weight``; their long names are key and the other."""

START = "initial_error"
"""The number of an estimator that is drawn where it has `initial_pose_std` alone."""


@dataclasses.dataclass(frozen=True)
class DrawnNumber:
    """A number of the configuration that each run draws.

    Attributes
    ----------
    place
        The part of the vehicle, as `Vehicle.parts` names it.
    name
        The field of the part.
    entry
        The entry of a list or a matrix, or the option of one; empty for one number.
    key
        The key in the configuration.
    unit
        Its SI unit; "1" for a pure number.
    """

    place: str
    name: str
    entry: tuple[int | str, ...]
    key: str
    unit: str

    def of(self, parts: dict[str, Any]) -> float:
        """Return its value in the parts of a run."""
        if any(isinstance(step, str) for step in self.entry):
            inside = getattr(parts[self.place], self.name)
            for step in self.entry:
                inside = getattr(inside, step) if isinstance(step, str) else inside[step]
            return float(np.ravel(inside)[0])  # of a run, a number is an array
        # Entries that are not drawn may be expressions.
        value = np.asarray(getattr(parts[self.place], self.name), dtype=object)
        if not self.entry:
            return float(value.flat[0])
        # The diagonal of a matrix may have been a list.
        entry = self.entry * value.ndim if len(self.entry) < value.ndim else self.entry
        return float(value[tuple(map(int, entry))])


def drawn_numbers(experiment: Experiment) -> list[DrawnNumber]:
    """Return all numbers that runs of an experiment draw, in the order of its sections."""
    vehicle, G = experiment.loop.vehicle, experiment.group
    vehicle = vehicle.configured or vehicle
    plant = experiment.config.plant
    own_forces = plant is not None and plant.forces is not None
    numbers = []
    for place, part in vehicle.parts.items():
        if not isinstance(part, VehiclePart):
            continue
        where = place if own_forces or not place.startswith(FORCES) else f"model{place[5:]}"
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            key = f"{where}.{option_of_field(field.name)}"
            if isinstance(part, ConstantInertia):
                key = where
            entries = list(_entries(value))
            if place == ESTIMATOR and field.name == START and _draws_its_start(part):
                entries = [(k,) for k in range(G.dimension)]
            for entry in entries:
                unit = _unit(part, field.name, entry, place, G)
                index = "".join(f".{k}" if isinstance(k, str) else f"[{k}]" for k in entry)
                numbers.append(DrawnNumber(place, field.name, entry, key + index, unit))
    return numbers


def _draws_its_start(filter_: Any) -> bool:
    """Whether a filter starts with an error by its own deviations."""
    return filter_.initial_error is None and getattr(filter_, "initial_pose_std", None) is not None


def _entries(value: Any) -> Iterator[tuple[int | str, ...]]:
    """Yield the places of distributions in a value."""
    if isinstance(value, Keys) and not isinstance(value, Distribution):
        for name, inside in vars(value).items():
            yield from ((name, *inner) for inner in _entries(inside))
        return
    if isinstance(value, list):
        for k, inside in enumerate(value):
            yield from ((k, *inner) for inner in _entries(inside))
    elif is_drawn(value) and not isinstance(value, NamedFormula):  # its names are stored
        yield ()


def _unit(part: Any, name: str, entry: tuple[int | str, ...], place: str, G: MatrixLieGroup) -> str:
    """Return the unit of an entry of a field; "mixed" where one number is for unlike axes."""
    for k, step in enumerate(entry):
        if isinstance(step, str):
            inside = getattr(part, name)
            for before in entry[:k]:
                inside = inside[before]
            return _unit(inside, step, entry[k + 1 :], place, G)
    if isinstance(part, TrueInertia):
        return "kg m^2" if isinstance(part, ConstantInertia) and G.translation is None else "1"
    hint = get_type_hints(type(part), include_extras=True).get(name)
    unit = next((x.unit for x in getattr(hint, "__metadata__", ()) if hasattr(x, "unit")), "")
    measured = VELOCITY if "velocity" in place else POSE
    try:
        by_part = UnitPlace(G, measured, getattr(part, "of", None) or "").units(unit)
    except KeyError:  # it does not depend on the group
        return unit or "1"
    if entry and len(by_part) > 1:
        return next(
            (u for u, axes in by_part.values() if entry[-1] in range(G.dimension)[axes]), "1"
        )
    units = {u for u, _ in by_part.values()}
    return units.pop() if len(units) == 1 else "mixed"


def drawn_in(vehicle: Vehicle, G: MatrixLieGroup, random_of: RandomOf) -> dict[str, Any]:
    """Return the parts of a vehicle with the numbers that a run draws, by their places."""
    configured, parts = vehicle.configured or vehicle, dict[str, Any]()
    for place, part in configured.parts.items():
        if not isinstance(part, VehiclePart) or not part.varies:
            continue
        if isinstance(part, TrueInertia):  # draws again what no body has
            parts[place] = part.of_run(G, random_of(place))
        elif place == ESTIMATOR:
            completed = part.completed(G, configured.deviations(G))  # type: ignore[attr-defined]
            parts[place] = completed.of_run(G, random_of(place))
        else:
            parts[place] = part.drawn(random_of(place))
    return parts


def values_of(experiment: Experiment, numbers: list[DrawnNumber]) -> Array:
    """Return the drawn numbers of all runs, ``(numbers, runs)``."""
    vehicle, G, seed = experiment.loop.vehicle, experiment.group, experiment.config.ensemble.seed
    values = np.empty((len(numbers), experiment.config.ensemble.runs))
    for run in range(values.shape[1]):
        parts = drawn_in(vehicle, G, partial(generator_at, seed, Stream.VEHICLE, run))
        values[:, run] = [number.of(parts) for number in numbers]
    return values


@purposes.variables_of_a_result
def variables(study: Study) -> dict[str, Variable]:
    """Return the drawn numbers of a study as variables of its result.

    They have the dimension `run`, and `point` where points draw differently.
    """
    numbers = drawn_numbers(study.base)
    if not numbers:
        return {}
    swept = study.sweep.sets if study.sweep else ()
    by_point = any(VEHICLE in marks_of(key) or parse_key(key)[0] == "ensemble" for key in swept)
    if by_point:
        points = [study.experiment(point) for point in range(len(study))]
        values = np.full((len(numbers), len(points), study.plan.runs), np.nan)
        for point, experiment in enumerate(points):
            there = {number.key: k for k, number in enumerate(drawn_numbers(experiment))}
            rows = [k for k, number in enumerate(numbers) if number.key in there]
            values[rows, point] = values_of(experiment, [numbers[k] for k in rows])
    else:
        values = values_of(study.base, numbers)
    dims = (POINT, "run") if by_point else ("run",)
    return {
        PREFIX + number.key.replace("[", ".").replace("]", ""): Variable(
            dims, x, {"units": number.unit, "long_name": number.key + SUFFIX}
        )
        for number, x in zip(numbers, values, strict=True)
    }
