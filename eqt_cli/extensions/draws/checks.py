"""What no part may have, by the numbers that each run draws, before the first run."""

import dataclasses
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, KeyPath, Problems, parse_key
from eqt_cli.base.option_types import plain_data, shown
from eqt_cli.base.registry import Keys
from eqt_cli.components.forces import follows_mass, mass_of
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.pose_notation import square
from eqt_cli.components.vehicle import FORCES, INERTIA
from eqt_cli.components.vehicle_parts import (
    ConstantInertia,
    NamedFormula,
    RelativeInertia,
    Uniform,
    VehiclePart,
    check_declared,
    drawn,
    is_drawn,
    redraws,
)
from eqt_cli.config.experiment import Experiment
from eqt_cli.numbers.leaves import with_fields


@dataclass(frozen=True)
class _Drawing:
    """A part whose numbers runs draw; all that its checks depend on is in the key."""

    key: Hashable
    part: VehiclePart = field(compare=False)
    G: MatrixLieGroup = field(compare=False)
    random_of: Callable[[int], np.random.Generator] = field(compare=False)
    runs: int


@purposes.checks_of_an_experiment
def check_draws(experiment: Experiment, problems: Problems) -> None:
    """Note what a run would draw and no part may have, with the run and the value.

    Numbers that a run draws again until they are possible are possible.
    """
    vehicle, ensemble, G = experiment.loop.vehicle, experiment.config.ensemble, experiment.group
    configured = vehicle.configured or vehicle
    until = experiment.config.time.duration
    for place, part in configured.parts.items():
        if not draws_numbers(part):
            continue
        key = (type(part), repr(part), G.name, place, ensemble.seed, until)
        random_of = partial(_random, ensemble.seed, place)
        drawing = _Drawing(key, part, G, random_of, ensemble.runs)
        here = problems.at(*key_of(experiment, place))
        for path, text in _impossible(drawing, until):
            here.at(*path).add(text)
        is_weighed = any(map(follows_mass, configured.forces))
        if place == INERTIA and isinstance(part, ConstantInertia) and is_weighed and not problems:
            _check_masses(drawing, here)


def draws_numbers(part: Any) -> bool:
    """Return whether runs draw numbers of a part of a vehicle."""
    return isinstance(part, VehiclePart) and any(map(is_drawn, vars(part).values()))


def _random(seed: int, place: str, run: int) -> np.random.Generator:
    return generator_at(seed, Stream.VEHICLE, run, place)


def key_of(experiment: Experiment, place: str) -> KeyPath:
    """Return the key of a part of the vehicle by its place."""
    plant = experiment.config.plant
    if place.startswith(FORCES) and (plant is None or plant.forces is None):
        place = f"model{place.removeprefix('plant')}"
    return parse_key(place)


@lru_cache(maxsize=256)
def _impossible(drawing: _Drawing, until: float) -> list[tuple[KeyPath, str]]:
    """Return the problems of the first run that has any, each with its place in the part."""
    part, G = drawing.part, drawing.G
    relative = part.relative if isinstance(part, RelativeInertia) else None
    if isinstance(relative, Uniform) and (least := relative.uniform[0]) <= -1:
        return [(("relative", "uniform", 0), f"expected more than -1, got {least:g}")]
    mean = part.of_run(G, None) if _moves(part) else None
    for run in range(drawing.runs):
        problems, random, values = Problems(), drawing.random_of(run), dict[str, Any]()
        for name in option_names_of(part):
            if not is_drawn(value := getattr(part, name)):
                continue
            with problems.catching(name):  # bounds of names may follow from others
                values[name] = number = drawn(value, random, name in part.positive)
                if not np.isfinite(flat(number)).all():
                    raise InputError(f"expected a finite number, got {shown(plain_data(number))}")
        if not problems:
            _check(part, values, G, problems)
        if mean is not None and not problems:
            now, usual = (one.instants(G, until) for one in (part.of_run(G, random), mean))
            if not np.array_equal(now, usual):
                problems.add(
                    f"changes its piece at {shown(now.tolist())} s, and at {shown(usual.tolist())} "
                    "s with the means; let drawn numbers move no step, but `since` and `until`"
                )
        if problems:
            return [
                (path, f"in run {run}: {text}{_of(values, path)}")
                for path, text in _listed(problems)
            ]
    return []


def option_names_of(part: VehiclePart) -> list[str]:
    """Return the names of the fields that a configuration writes."""
    return [one.name for one in dataclasses.fields(part) if one.init]


def _moves(part: VehiclePart) -> bool:
    """Whether a formula of a part has names and t."""
    entries = (getattr(part, name) for name in part.in_time)
    return any(
        isinstance(entry, NamedFormula) and entry.moves
        for entries_ in entries
        for entry in entries_ or ()
    )


def flat(value: Any) -> Array:
    """Return the numbers of a drawn value, in a row; 0 for what is none."""
    if isinstance(value, Keys):
        value = list(vars(value).values())
    if isinstance(value, list):
        return np.concatenate([np.empty(0), *map(flat, value)])
    return np.ravel(value if isinstance(value, float | int | np.ndarray) else 0.0)


def _listed(problems: Problems) -> list[tuple[KeyPath, str]]:
    return [(parse_key(one.path) if one.path else (), one.message) for one in problems]


def _of(values: dict[str, Any], path: KeyPath) -> str:
    """Return the drawn value that a problem is about, in words."""
    value = values.get(str(path[0])) if path else None
    return "" if value is None else f" (it draws {shown(plain_data(value))})"


def _check(
    part: VehiclePart, values: dict[str, Any], G: MatrixLieGroup, problems: Problems
) -> None:
    """Note what is wrong with a part of a run, as if its numbers were written."""
    if isinstance(part, RelativeInertia):
        if values["relative"] <= -1 and not redraws(part.relative):
            problems.at("relative").add(f"expected more than -1, got {values['relative']:g}")
    elif isinstance(part, ConstantInertia):
        matrix = square(values["matrix"], G.dimension, G)
        if not redraws(part.matrix) and np.linalg.eigvalsh(matrix)[0] <= 0:
            problems.add(
                "expected a positive definite matrix, got the eigenvalue "
                f"{np.linalg.eigvalsh(matrix)[0]:.4g}"
            )
    else:
        one = with_fields(part, **values)
        check_declared(one, problems)
        if not problems:
            one.check(G, problems)


def _check_masses(drawing: _Drawing, problems: Problems) -> None:
    """Note a drawn inertia whose masses differ by axis, beside a weight of one mass."""
    for run in range(drawing.runs):
        one: Any = drawing.part.of_run(drawing.G, drawing.random_of(run))
        if mass_of(drawing.G, Inertia(one.matrix, one.inverse)) is None:
            problems.add(
                f"in run {run}: the masses differ by axis, and `gravity` needs one; draw it by a "
                "name: draws: {mass: …}, and write the name in each entry"
            )
            return
