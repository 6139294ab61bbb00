"""Checks of the values of parts with the numbers that each run draws, before the first run."""

import dataclasses
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtWarning, InputError, KeyPath, Problems, parse_key
from eqt_cli.base.option_types import plain_data, shown
from eqt_cli.base.reporting import reporter
from eqt_cli.components.forces import follows_mass, mass_of
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, not_rigid
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.pose_notation import square
from eqt_cli.components.vehicle import FORCES, INERTIA, Vehicle
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
from eqt_cli.config.remarks import body_of, force_remarks, limits_below_reference
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.draws.formulas import unused
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
        if not isinstance(part, VehiclePart) or not any(map(is_drawn, vars(part).values())):
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
        for name in _options(part):
            if not is_drawn(value := getattr(part, name)):
                continue
            with problems.catching(name):  # bounds of names may follow from others
                values[name] = number = drawn(value, random, name in part.positive)
                if not np.isfinite(_numbers(number)).all():
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


def _options(part: VehiclePart) -> list[str]:
    return [one.name for one in dataclasses.fields(part) if one.init]


def _moves(part: VehiclePart) -> bool:
    """Whether a formula of a part has names and t."""
    entries = (getattr(part, name) for name in part.in_time)
    return any(
        isinstance(entry, NamedFormula) and entry.moves
        for entries_ in entries
        for entry in entries_ or ()
    )


def _numbers(value: Any) -> Any:
    """Return the numbers of a drawn value."""
    if isinstance(value, list):
        return np.concatenate([np.ravel(_numbers(entry)) for entry in value])
    return value if isinstance(value, float | int) else 0.0


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


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Any) -> Iterator[tuple[KeyPath, str]]:
    """Yield what is remarked on the values of some run alone, and names that nothing reads."""
    yield from unused(experiment)
    of_means = dict(_of_run(experiment, experiment.loop.vehicle, shown))
    seen = dict[KeyPath, list[Any]]()
    for run, vehicle in vehicles(experiment):
        for key, text in _of_run(experiment, vehicle, shown):
            if key not in of_means:
                seen.setdefault(key, [run, text, 0])[2] += 1
    for key, (run, text, count) in seen.items():
        many = f"in {count} of {experiment.config.ensemble.runs} runs"
        yield key, f"{many}, such as run {run}: {text}"


def _of_run(
    experiment: Experiment, vehicle: Vehicle, shown: Horizon | None
) -> Iterator[tuple[KeyPath, str]]:
    """Yield remarks on values of a run: with the reference, also on limits below it."""
    yield from _of_values(experiment, vehicle)
    if shown is not None and vehicle.limits:
        loops = {"": replace(experiment.loop, vehicle=vehicle)}
        yield from limits_below_reference(replace(experiment, loops=loops), shown)


def vehicles(experiment: Experiment) -> Iterator[tuple[int, Vehicle]]:
    """Yield each run with its vehicle, if runs draw an inertia, a force or an actuator."""
    loop, ensemble = experiment.loop, experiment.config.ensemble
    configured = loop.vehicle.configured or loop.vehicle
    if any(
        part.varies
        for part in (configured.inertia, *configured.forces, *configured.actuators)
        if part
    ):
        for run in range(ensemble.runs):
            random_of = partial(generator_at, ensemble.seed, Stream.VEHICLE, run)
            yield run, loop.vehicle.of_run(loop.group, random_of)


def _of_values(experiment: Experiment, vehicle: Vehicle) -> Iterator[tuple[KeyPath, str]]:
    """Yield remarks on the inertia and the forces of a vehicle of a run."""
    plant, loop = experiment.config.plant, experiment.loop
    section, body = "plant" if plant and plant.forces else "model", loop.inertia.at(0.0)
    body = body_of(body, vehicle)
    yield from force_remarks(loop.group, vehicle.forces, body, section)
    true = (vehicle.configured or vehicle).inertia
    is_rigid = isinstance(true, ConstantInertia) and experiment.config.rigid is not False
    if is_rigid and (broken := not_rigid(loop.group, body, 0.0)):
        yield ("plant", "inertia"), f"not of a rigid body: its {broken}"


@purposes.remarks_on_other_values
def remark_elsewhere(base: Experiment, others: Iterable[tuple[str, Experiment]]) -> tuple[str, ...]:
    """Tell and return what is remarked on values at points of a sweep, or at ends of ranges, alone.

    Parameters
    ----------
    others
        Experiments, each with where it is, in words.
    """
    keys = {key for key, _ in [*_of_values(base, base.loop.vehicle), *remarks(base, None)]}
    noted = []
    for where, experiment in others:
        of_means = _of_values(experiment, experiment.loop.vehicle)
        for key, text in [*of_means, *remarks(experiment, None)]:
            if key not in keys:
                keys.add(key)
                noted.append(experiment.document.problem(key, f"{where}: {text}"))
                reporter().remark(EqtWarning(str(noted[-1])))
    return tuple(f"{problem.path}: {problem.message}" for problem in noted)
