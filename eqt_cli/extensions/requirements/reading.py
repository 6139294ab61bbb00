"""What requirements of a configuration ask for, checked before anything runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems, suggestion
from eqt_cli.base.option_types import Written, number_of, shown, validated
from eqt_cli.base.stored import Better
from eqt_cli.base.units import base_of, factor, offered
from eqt_cli.config.experiment import Experiment
from eqt_cli.extensions.requirements.errors import samples_of
from eqt_cli.extensions.requirements.keys import NamedWindow, Requirement
from eqt_cli.loop.signals import existing
from eqt_cli.results.metrics import METRICS, own_quantity, peak
from eqt_cli.results.quantity import Measure, Window

MARGINS: dict[str, tuple[str, Better]] = {
    "delay_margin": ("s", "higher"),
    "gain_margin": ("1", "higher"),
    "gain_reduction": ("1", "lower"),
}
"""Numbers of the linear loop, their units and which is better: the largest added delay; the
largest and the smallest factor of all gains at which it stays stable."""

ANGLE = "attitude_angle"
"""The error that an exposure takes."""


class Meaning(NamedTuple):
    """What the metric of a requirement is.

    Attributes
    ----------
    unit
        Its unit.
    better
        Which values are.
    signal
        The signal over time of which it is the largest value, or which it is; "" of others.
    windowed
        Whether it can be taken over a window.
    stored
        Whether results hold it without samples.
    """

    unit: str
    better: Better
    signal: str = ""
    windowed: bool = True
    stored: bool = True


def is_peak(quantity: Measure) -> bool:
    """Return whether a metric is the largest value of a signal."""
    return quantity.of is peak and len(quantity.signals) == 1


def limit_of(requirement: Requirement, unit: str) -> float:
    """Return the bound of a requirement in a unit.

    Raises
    ------
    ValueError
        If it is no number, or of another unit.
    """
    value = requirement.min if requirement.max is None else requirement.max
    base = base_of(unit)
    if isinstance(value, str):
        number = number_of(Written(value, [base]))
        return float(number) * (factor(base, unit) or 1.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"expected {offered(base)}, got {shown(value)}")
    if base != unit:
        raise ValueError(f"give {shown(value)} a unit, as '{value:g} {unit}'")
    return float(value)


def window_of(requirement: Requirement, windows: Mapping[str, NamedWindow] | None) -> Window | None:
    """Return the window of a requirement, or None for the whole run; a `KeyError` without it."""
    named = requirement.window
    if named is None:
        return None
    if isinstance(named, str):
        named = (windows or {})[named]
    return Window(named.start, math.inf if named.stop is None else named.stop)


@purposes.checks_of_an_experiment
def check(experiment: Experiment, problems: Problems) -> None:
    """Note what is wrong with windows and requirements."""
    config = experiment.config
    duration = float(experiment.times[-1])
    windows: dict[str, NamedWindow] = getattr(config, "windows", None) or {}
    for name, window in windows.items():
        _check_window(window, duration, experiment, problems.at("windows", name))
    seen: list[Requirement] = []
    meanings = _meanings(experiment) if getattr(config, "require", None) else {}
    for index, requirement in enumerate(getattr(config, "require", None) or ()):
        here = problems.at("require", index)
        if requirement in seen:
            here.add(f"is entry {seen.index(requirement)} again; remove one")
        seen.append(requirement)
        for words in _wrong(requirement, meanings, windows, experiment):
            here.add(words)
        if isinstance(requirement.window, NamedWindow):
            _check_window(requirement.window, duration, experiment, here.at("window"))


def _check_window(
    window: NamedWindow, duration: float, experiment: Experiment, problems: Problems
) -> None:
    stop = duration if window.stop is None else window.stop
    if window.start < 0 or stop <= window.start:
        problems.add(f"expected 0 <= start < stop, got {window.start:g} s and {stop:g} s")
    elif window.start >= duration or stop > duration:
        problems.add(f"is after the end of the runs, which last {duration:g} s; end it there")
    elif np.count_nonzero(_inside(_stored_times(experiment), window.start, stop)) < 2:
        problems.add(
            f"holds fewer than two samples between {window.start:g} and {stop:g} s; raise "
            "time.samples, or lower store.decimate"
        )


def _wrong(
    requirement: Requirement,
    meanings: Mapping[str, Meaning],
    windows: Mapping[str, NamedWindow],
    experiment: Experiment,
) -> Iterator[str]:
    """Yield what is wrong with a requirement, but for the times of its window."""
    name = requirement.metric
    meaning = meanings.get(name)
    if meaning is None:
        hint = suggestion(name, meanings) or f"; expected one of {', '.join(meanings)}"
        yield f"metric: no '{name}' that all laws have{hint}"
        return
    yield from _wrong_bound(requirement, meaning)
    if isinstance(requirement.window, str) and requirement.window not in windows:
        listed = ", ".join(windows) or "none"
        hint = suggestion(requirement.window, windows) or f"; `windows` has {listed}"
        yield f"window: no window '{requirement.window}'{hint}"
    elif requirement.window and not meaning.windowed and name not in MARGINS:
        yield f"window: {name} is a number of whole runs; remove it"
    if name in MARGINS:
        keys = ("share", "of_runs", "window", "relative")
        over = [key for key in keys if getattr(requirement, key) is not None]
        over += ["of"] if requirement.of != "ensemble" else []
        if over:
            yield f"{name} is one number of a law; remove {', '.join(over)}"
        return
    yield from _wrong_share(requirement, meaning)
    yield from _wrong_exposure(requirement, experiment)
    is_over_time = requirement.of != "ensemble" or name == meaning.signal
    needs = requirement.window or requirement.relative or is_over_time or not meaning.stored
    if needs and experiment.config.store.trajectories != "all":
        yield "needs samples of all runs; set store.trajectories to all"


def _wrong_bound(requirement: Requirement, meaning: Meaning) -> Iterator[str]:
    if (requirement.max is None) == (requirement.min is None):
        yield "expected one of max and min"
        return
    key, other, better = ("max", "min", "higher")
    if requirement.max is None:
        key, other, better = ("min", "max", "lower")
    if meaning.better == better:
        yield f"{key}: {better} values of {requirement.metric} are better; it needs `{other}`"
    try:
        limit_of(requirement, meaning.unit)
    except ValueError as error:
        yield f"{key}: {error}"


def _wrong_share(requirement: Requirement, meaning: Meaning) -> Iterator[str]:
    if requirement.share is None:
        yield "share: is missing; expected the share of runs or of time, such as 0.997"
    if requirement.of != "ensemble" and not meaning.signal:
        yield (
            f"of: {requirement.of} is about an error over time, and {requirement.metric} is one "
            "number a run; take a signal such as attitude_angle, or `of: ensemble`"
        )
    if requirement.of == "temporal" and requirement.of_runs is None:
        yield (
            "of_runs: is missing; expected the share of the runs in which the share of the time "
            "must be reached, such as 0.95"
        )
    if requirement.of != "temporal" and requirement.of_runs is not None:
        yield "of_runs: belongs to `of: temporal`; remove it"


def _wrong_exposure(requirement: Requirement, experiment: Experiment) -> Iterator[str]:
    if requirement.relative is None:
        return
    if requirement.metric != ANGLE:
        yield f"relative: is about {ANGLE}, and metric is {requirement.metric}"
        return
    times = _stored_times(experiment)
    if requirement.relative < 2 * times[1] * (1 - 1e-9):
        yield f"relative: an exposure needs three samples, and they are {times[1]:g} s apart"
    named, windows = requirement.window, getattr(experiment.config, "windows", None) or {}
    over = windows.get(named) if isinstance(named, str) else named or experiment.config.measure
    inside = _inside(times, over.start, over.stop) if over else np.ones(len(times), bool)
    if np.count_nonzero(inside) < samples_of(requirement.relative, times) + 2:
        yield f"relative: no exposure of {requirement.relative:g} s lies in the window; shorten it"


def _stored_times(experiment: Experiment) -> Array:
    return experiment.times[:: experiment.config.store.decimate] - experiment.times[0]


def _inside(times: Array, start: float, stop: float | None) -> Array:
    return (times >= start - 1e-9) & (times <= (math.inf if stop is None else stop) + 1e-9)


def _meanings(experiment: Experiment) -> dict[str, Meaning]:
    """Return what all laws of an experiment have, by name."""
    by_law = [_of_loop(loop) for loop in experiment.loops.values()]
    of_user = [own_quantity(type(metric)) for metric in experiment.metrics]
    meanings = {
        name: meaning for name, meaning in by_law[0].items() if all(name in x for x in by_law)
    }
    meanings |= {row.name: Meaning(row.units, row.better, windowed=row.windowed) for row in of_user}
    return meanings | {name: Meaning(*about) for name, about in MARGINS.items()}


def _of_loop(loop: Any) -> dict[str, Meaning]:
    signals = existing(loop)
    units = {
        name: signal.unit_in(part) if part else signal.units(loop.group)
        for name, (signal, part) in signals.items()
        if signal.exists_for(loop)
    }
    held = {k for k, (signal, _) in signals.items() if signal.stored_of(loop.vehicle)}
    numbers = {k for k in held if not (signals[k][0].dims or signals[k][0].only_there)}
    meanings = {
        k: Meaning(u, "lower", k) for k, u in units.items() if k in numbers and u != "mixed"
    }
    for row in METRICS:
        parts = [part.name for part in loop.group.parts]
        for of in (row, *(row.part(name) for name in parts if row.parted)):
            stored = of.stored and of.stored_of(loop.vehicle)
            if of.signals and set(of.signals) <= set(units) and (stored or {*of.signals} <= held):
                unit = of.unit(units[of.signals[0]])
                signal = of.signals[0] if is_peak(of) else ""
                meanings[of.name] = Meaning(
                    unit, of.better, signal, of.windowed, stored or of.implied_by is not None
                )
    return meanings


def required(config: Mapping[str, Any]) -> tuple[list[Requirement], dict[str, NamedWindow]]:
    """Return the requirements in the configuration of a result, and its windows.

    Raises
    ------
    EqtError
        If they cannot be read.
    """
    problems = Problems(lambda path: ".".join(map(str, path)))
    of_windows, of_bounds = (problems.at(key) for key in ("windows", "require"))
    windows = validated(dict[str, NamedWindow], config.get("windows") or {}, of_windows)
    requirements = validated(list[Requirement], config.get("require") or [], of_bounds)
    problems.raise_if_any()
    return requirements, windows
