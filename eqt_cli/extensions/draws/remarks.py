"""Remarks on the values of runs, where they are not those of the means.

- Of every run: directions and limits of actuators, forces, levers, sensors, the rigid body.
- Of the runs with the least or the greatest value of each drawn number: what extensions say.
- Of those, too, and in `eqt config check` of every run: how fast small errors grow and decay. What
  is said of it is said of the run where they grow or decay most.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtWarning, KeyPath, dotted
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import reporter
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.forces import Force
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle import ACTUATORS, DEPTH, FELT, FLUX, FORCES, POSE, VELOCITY, Vehicle
from eqt_cli.components.vehicle_parts import TrueInertia, is_drawn
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.remarks import (
    ORDINARY,
    along_reference,
    limits_below_reference,
    numerical_remarks,
    small_loops,
    value_remarks,
)
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.draws.checks import draws_numbers, flat, key_of, option_names_of
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.linearised import rates_of_runs
from eqt_cli.numbers.leaves import leaves, with_fields

MOST_LINEARISED = 200
"""Number of runs up to which `eqt config check` linearises the loops of all; 2 to 10 ms each."""

SAME_WORDS = 30
"""Letters by which two remarks on one key, without their numbers, are the same."""

Placed = Iterator[tuple[KeyPath, str]]


def _draws(experiment: Experiment) -> bool:
    """Whether runs draw numbers of their vehicle, and not only phases and errors."""
    vehicle = experiment.loop.vehicle
    return any(map(draws_numbers, (vehicle.configured or vehicle).parts.values()))


def of_run(experiment: Experiment, run: int) -> Experiment:
    """Return the experiment with the vehicle of a run, and its numbers where they are written."""
    G, config, shared = experiment.group, experiment.config, experiment.loop.vehicle
    random_of = partial(generator_at, config.ensemble.seed, Stream.VEHICLE, run)
    written = dict[str, Any]()
    for place, part in (shared.configured or shared).parts.items():
        if isinstance(part, Actuator | Force | Sensor) and draws_numbers(part):
            numbers = part.drawn(random_of(place))
            options = {name: getattr(numbers, name) for name in option_names_of(part)}
            written[place] = with_fields(part, **options)

    def listed(place: str, parts: Iterable[Any]) -> list[Any]:
        return [written.get(f"{place}[{k}]", part) for k, part in enumerate(parts)]

    def flown(vehicle: Vehicle) -> Vehicle:
        more = zip((FLUX, FELT, DEPTH), vehicle.more_sensors, strict=True)
        return replace(
            vehicle.of_run(G, random_of),
            pose_sensors=tuple(listed(POSE, vehicle.pose_sensors)),
            velocity_sensors=tuple(listed(VELOCITY, vehicle.velocity_sensors)),
            more_sensors=tuple(tuple(listed(place, parts)) for place, parts in more),
            configured=None,  # nothing is drawn any more
        )

    changed: dict[str, Any] = {}
    if config.actuators:
        changed[ACTUATORS] = listed(ACTUATORS, config.actuators)
    if config.plant and config.plant.forces:
        forces = listed(FORCES, config.plant.forces)
        changed["plant"] = config.plant.model_copy(update={"forces": forces})
    loops = {
        label: replace(loop, vehicle=flown(loop.vehicle))
        for label, loop in experiment.loops.items()
    }
    return replace(experiment, config=config.model_copy(update=changed), loops=loops)


def ends(experiment: Experiment) -> dict[int, dict[str, str]]:
    """Return the runs with the least and the greatest value of each drawn number.

    Each has the keys of these numbers, with `the least` or `the greatest`.
    """
    G, ensemble, vehicle = experiment.group, experiment.config.ensemble, experiment.loop.vehicle
    values = dict[str, list[Array]]()
    for place, part in (vehicle.configured or vehicle).parts.items():
        if not draws_numbers(part):
            continue
        names = [name for name in option_names_of(part) if is_drawn(getattr(part, name))]
        for run in range(ensemble.runs):
            random = generator_at(ensemble.seed, Stream.VEHICLE, run, place)
            # A true inertia is drawn again until it is that of a body.
            is_true = isinstance(part, TrueInertia)
            one: Any = part.of_run(G, random) if is_true else part.drawn(random)
            for name in names:
                key = dotted((*key_of(experiment, place), name))
                values.setdefault(key, []).append(flat(getattr(one, name)))
    chosen = dict[int, dict[str, str]]()
    for key, rows in values.items():
        of_key = np.array(rows)
        for column in of_key[:, np.ptp(of_key, axis=0) > 0].T:
            chosen.setdefault(int(column.argmin()), {})[key] = f"the least {key}"
            chosen.setdefault(int(column.argmax()), {})[key] = f"the greatest {key}"
    return chosen


def _kind(key: KeyPath, text: str) -> tuple[KeyPath, str]:
    """Return what remarks on other values of one thing have in common."""
    return key, re.sub(r"[-−+\d.,]*\d(e[-+]?\d+)?", "", text)[:SAME_WORDS]


def _of_values(experiment: Experiment, shown: Horizon | None, horizon: Horizon | None) -> Placed:
    """Yield the remarks on values, and on limits below the reference along a horizon."""
    yield from value_remarks(experiment, shown)
    if horizon is not None:
        yield from limits_below_reference(experiment, horizon)


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Horizon | None) -> Placed:
    """Yield what is remarked on the values of some run alone, and names that nothing reads."""
    yield from _unused(experiment)
    if not _draws(experiment):
        return
    yield from _of_every_run(experiment, shown)
    there = ends(experiment)
    yield from _at_ends(experiment, shown, there)
    yield from _on_small_errors(experiment, shown, there)


def _unused(experiment: Experiment) -> Placed:
    """Yield a remark on each name that no formula reads."""
    if experiment.config.draws is not None:
        from eqt_cli.extensions.draws.formulas import unused

        yield from unused(experiment)


def _at_ends(
    experiment: Experiment, shown: Horizon | None, there: dict[int, dict[str, str]]
) -> Placed:
    """Yield what extensions remark on the runs at the ends of drawn numbers alone."""
    more = [x for x in functions_for(purposes.remarks_on_an_experiment) if x is not remarks]
    of_means = {_kind(*placed) for function in more for placed in function(experiment, shown)}
    seen = dict[Any, tuple[bool, KeyPath, str]]()
    for run, numbers in there.items():
        one = of_run(experiment, run)
        for key, text in (placed for function in more for placed in function(one, shown)):
            kind, place = _kind(key, text), dotted(key)
            end = next((numbers[x] for x in numbers if x.startswith(place)), "")
            is_better = kind not in seen or (end and not seen[kind][0])
            if kind not in of_means and is_better:
                draws = f", which draws {end}" if end else ""
                seen[kind] = bool(end), key, f"in run {run}{draws}: {text}"
    yield from ((key, text) for _, key, text in seen.values())


def _of_every_run(experiment: Experiment, shown: Horizon | None) -> Placed:
    """Yield the remarks on values of some run that are none on the means."""
    horizon = shown
    if horizon is None and experiment.vehicle.limits:
        horizon = experiment.reference_over_horizon()
    of_means = {_kind(*placed) for placed in _of_values(experiment, shown, horizon)}
    seen = dict[KeyPath, list[Any]]()
    runs = experiment.config.ensemble.runs
    for run in range(runs):
        of_one = dict(_of_values(of_run(experiment, run), shown, horizon))
        for key, text in of_one.items():
            if _kind(key, text) not in of_means:
                seen.setdefault(key, [run, text, 0])[2] += 1
    for key, (run, text, count) in seen.items():
        yield key, f"in {count} of {runs} runs, such as run {run}: {text}"


def _on_small_errors(experiment: Experiment, shown: Horizon | None, there: Iterable[int]) -> Placed:
    """Yield the remarks on the runs whose small errors grow most, decay least, or decay fastest."""
    ensemble, horizon = experiment.config.ensemble, experiment.config.time.duration
    is_whole = shown is not None and ensemble.runs <= MOST_LINEARISED
    runs = list(range(ensemble.runs) if is_whole else there)
    start = along_reference(experiment, None)
    said = dict[int, str]()
    for label, loop in small_loops(experiment, start).items():
        numbers = numbers_of_runs(experiment, loop, runs)
        if not numbers:
            continue
        with np.errstate(all="ignore"):
            growth, rates = rates_of_runs(loop, numbers, *(x[0] for x in start))
        if np.isnan(growth).any():
            continue
        if growth.max() * horizon > -np.log(2.0):
            said.setdefault(runs[int(growth.argmax())], f"decay least under '{label}'")
        fastest = int(np.abs(rates).max(axis=-1).argmax())
        if experiment.engine.work_for_stability(rates[fastest, None], horizon).amount > ORDINARY:
            said.setdefault(runs[fastest], f"decay fastest under '{label}'")
    of_means = (
        {_kind(*placed) for placed in numerical_remarks(experiment, shown)} if said else set()
    )
    for run, words in said.items():
        for key, text in numerical_remarks(of_run(experiment, run), shown):
            if (kind := _kind(key, text)) not in of_means:
                of_means.add(kind)
                yield key, f"in run {run}, whose small errors {words}: {text}"


def numbers_of_runs(
    experiment: Experiment, loop: ClosedLoop, runs: Sequence[int]
) -> dict[str, Array]:
    """Return the leaves of a loop that differ between some runs, ``(runs, …)`` each, by path."""
    seed, rows = experiment.config.ensemble.seed, list[dict[str, Array]]()
    for run in runs:
        random_of = partial(generator_at, seed, Stream.VEHICLE, run)
        rows.append(leaves(loop.vehicle.of_run(loop.group, random_of)))
    first = rows[0] if rows else {}
    return {
        f"vehicle.{path}": np.stack([row[path] for row in rows])
        for path in first
        if any(not np.array_equal(row[path], first[path]) for row in rows)
    }


@purposes.remarks_on_other_values
def remark_elsewhere(base: Experiment, others: Iterable[tuple[str, Experiment]]) -> tuple[str, ...]:
    """Tell and return what is remarked on values at points of a sweep, or at ends of ranges, alone.

    Parameters
    ----------
    others
        Experiments, each with where it is, in words.
    """
    keys = {key for key, _ in [*value_remarks(base, None), *remarks(base, None)]}
    noted, tried = list[Any](), {_drawn_of(base)}
    for where, experiment in others:
        placed = [*value_remarks(experiment, None), *_unused(experiment)]
        if _draws(experiment) and (drawn := _drawn_of(experiment)) not in tried:
            tried.add(drawn)
            placed += _of_every_run(experiment, None)
        for key, text in placed:
            if key not in keys:
                keys.add(key)
                noted.append(experiment.document.problem(key, f"{where}: {text}"))
                reporter().remark(EqtWarning(str(noted[-1])))
    return tuple(f"{problem.path}: {problem.message}" for problem in noted)


def _drawn_of(experiment: Experiment) -> str:
    """Return all that the values of runs, and what is remarked on them, depend on."""
    vehicle, ensemble = experiment.loop.vehicle, experiment.config.ensemble
    shared = (vehicle.configured or vehicle).parts
    return repr((shared, experiment.loop.inertia, ensemble, experiment.config.reference))
