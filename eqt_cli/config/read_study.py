"""Reads a study from a configuration, and names its laws."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import ConfigError, EqtError, InputError, InputProblem, Problems, parse_key
from eqt_cli.base.option_types import Kind, option_names, shown
from eqt_cli.base.reporting import reporter, step
from eqt_cli.base.yaml_source import parse_value
from eqt_cli.components.laws import Controller, controllers
from eqt_cli.config.build import OF_EVERY_LAW, build
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.schema import Config, not_swept
from eqt_cli.config.source import ConfigSource, with_value
from eqt_cli.config.study import Study, at_point, section_of, sweep_of, without_sweep
from eqt_cli.config.sweep import EXPECTED
from eqt_cli.numbers.leaves import leaves

# Finds registered laws among the points of a sweep over the options of laws -----------------------


STATES = 4
"""Number of random states at which torques are compared; one suffices for smooth laws."""

ROUNDING = 1e-12
"""Tolerance relative to the largest torque, for sums of some tens of products in another order."""


def law_names(study: Study) -> Array | None:
    """Return the names by point and controller; "" if a controller equals no law without options.

    None if no swept key changes the controllers. Laws are equal if their structures and their
    parameters are equal, or, if nothing else is swept, if they give the same torque. For example,
    the frame of the damping makes no difference if K_d is the same in every frame. Only the laws of
    each point are built, which takes little time.
    """
    sweep = study.sweep
    keys = [key for key in sweep.sets if section_of(key) == "controllers"] if sweep else []
    if sweep is None or not keys:
        return None
    known: dict[Hashable, str] = {}
    for kind in controllers.all():
        if not option_names(kind):
            known.setdefault(_identity(kind()), kind.name)
    G, laws = study.base.group, [loop.controller for loop in study.base.loops.values()]
    comparable = all(law.gains_group(G) is G for law in laws) and len(keys) == len(sweep.sets)
    alike = _Torques(study) if comparable else None
    names = np.full((len(study), len(study.base.loops)), "", dtype=object)
    for point in range(len(study)):
        values = sweep.settings(point)
        data: Any = {"controllers": study.source.data["controllers"]}
        for key in filter(values.__contains__, keys):
            data = with_value(data, parse_key(key), values[key])
        for index, entry in enumerate(data["controllers"]):
            law = _law(entry)
            identity = _identity(law)
            if identity not in known:
                known[identity] = alike.name(law) if alike and law.code is None else ""
            names[point, index] = known[identity]
    return names


class _Torques:
    """The torques of the registered laws without options at some states of an experiment."""

    def __init__(self, study: Study) -> None:
        base, random = study.base, np.random.default_rng(0)
        loop, G = next(iter(base.loops.values())), base.group
        Q, Qd = G.exp(random.standard_normal((2, STATES, G.dimension)))
        V, Vd = random.standard_normal((2, STATES, G.dimension))
        self.loop, self.start = loop, (Q, V, Qd, Vd)
        fitting = (kind for kind in controllers.all() if base.config.task in kind.tasks)
        laws = [kind() for kind in fitting if not option_names(kind)]
        self.known = [(law.name, self._of(law)) for law in laws if law.fits(G)]

    def name(self, law: Controller) -> str:
        """Return the first law with the same torques, up to rounding; "" if there is none."""
        expected = self._of(law)
        bound = ROUNDING * np.abs(expected).max()
        equal = (name for name, torque in self.known if np.abs(torque - expected).max() <= bound)
        return next(equal, "")

    def _of(self, law: Controller) -> Array:
        loop = replace(self.loop, controller=law)
        return law.torque(loop.tracking(0.0, loop.initial_state(*self.start)))


def _law(entry: Any) -> Controller:
    """Build the law of a valid entry of the configuration."""
    if isinstance(entry, dict):
        entry = {key: value for key, value in entry.items() if key not in OF_EVERY_LAW}
    law: Controller | None = Kind(controllers).read(entry, Problems())
    assert law is not None
    return law


def _identity(law: Controller) -> Hashable:
    """Return a key that is equal for laws of equal structure and parameters."""
    numbers = {name: (value + 0.0).tobytes() for name, value in leaves(law).items()}
    return law.structure, tuple(sorted(numbers.items()))  # + 0.0 turns -0.0 into 0.0


# Reads the sweep of a configuration, and checks every point of it ---------------------------------


MOST_PROBLEMS = 20
"""Largest number of reported problems of a sweep; a mistake often affects thousands of points."""

MOST_GROUPS = 1000
"""Largest number of points that differ in shape. Opening the group of each takes milliseconds."""

RUNS = (
    "ensemble.runs cannot be swept: run k starts from the same state however many runs there are, "
    "so the first 50 of 200 runs are the ensemble of 50; set the largest number, and use the first "
    "runs of it"
)


def add_grids(source: ConfigSource, grids: Mapping[str, str]) -> None:
    """Append texts such as ``gains.kd=0.25,0.5,1``, by their places, to the sweep as blocks.

    Raises
    ------
    ConfigError
        For a text that does not parse.
    """
    section = source.data.get("sweep")
    if section is not None and not isinstance(section, list):
        message = f"{EXPECTED}, got {shown(section)}"
        raise ConfigError([InputProblem("sweep", message, source.place(("sweep",)))])
    blocks = list(section or [])
    for place, grid in grids.items():
        key, equals, text = grid.partition("=")
        if not equals or not key.strip() or not text.strip():
            message = f"expected KEY=VALUE,VALUE,…, got '{grid}'"
            raise ConfigError([InputProblem("", message, place)])
        source.overrides[("sweep", len(blocks))] = place
        blocks.append({"grid": {key.strip(): parse_value(f"[{text}]", place)}})
    if blocks:
        source.data = source.data | {"sweep": blocks}


def study(
    source: ConfigSource, *, trust_plugins: bool = False, most_checked: int | None = None
) -> Study:
    """Check a configuration and the points of its sweep.

    Parameters
    ----------
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.
    most_checked
        Largest number of points to check, spread over all; None checks all.

    Raises
    ------
    ConfigError
        With all problems; problems of a swept value are at its place.
    """
    section = source.data.get("sweep")
    bare = without_sweep(source)
    if section is None or section == []:
        return Study(None, build(bare, trust_plugins=trust_plugins))
    sweep = sweep_of(source)
    problems = Problems(source.place)
    for key in sweep.sets:
        with problems.catching("sweep", *sweep.first_place(key)):
            require_sweepable(key)
    problems.raise_if_any()
    common = at_point(bare, sweep, 0, sweep.always)
    base = build(at_point(common, sweep, 0), trust_plugins=trust_plugins)
    plugins = base.source.stored_plugins  # other processes execute the same sources
    checked = Study(sweep, base, replace(common, stored_plugins=plugins))
    _check_common(checked)
    if checked.is_ragged and len(checked) > MOST_GROUPS:
        raise EqtError(
            f"{source.place(('sweep',))}: {len(checked):,} points that differ in group, times or "
            f"parts are too many for one file; sweep at most {MOST_GROUPS:,}, or split the sweep"
        )
    with step("points checked", len(checked)):
        _check_points(checked, spread(len(checked), most_checked))
    return checked


def _check_common(checked: Study) -> None:
    """Check the configuration without the settings that only some points change.

    Raises
    ------
    ConfigError
        With all problems.
    """
    try:
        checked.resolved  # noqa: B018  # builds and caches it
    except ConfigError as error:
        where = "without what only some of the cases change"
        problems = [replace(each, message=f"{where}: {each.message}") for each in error.problems]
        raise ConfigError(problems) from None


def spread(count: int, most: int | None) -> Sequence[int]:
    """Return at most `most` of the points, spread from the first to the last."""
    if most is None or count <= most:
        return range(count)
    return [k * (count - 1) // (most - 1) for k in range(most)]


def require_sweepable(key: str) -> None:
    """Raise an `InputError` if a key cannot be swept."""
    name = section_of(key)
    if why := not_swept(key):
        raise InputError(f"{name} cannot be swept: it {why}; run one experiment for each value")
    if key == "time":
        raise InputError(
            "time cannot be swept as a whole; sweep time.duration and time.samples with zip"
        )
    if key == "ensemble.runs":
        raise InputError(RUNS)
    if name not in Config.model_fields:
        known = [field for field in Config.model_fields if not not_swept(field)]
        raise InputError(f"unknown key '{key}'; keys are in: {', '.join(known)}")


def _check_points(checked: Study, points: Sequence[int]) -> None:
    """Build points; a value that is wrong at many points is reported once."""
    problems: dict[InputProblem, None] = {}
    first_of = {each: alike[0] for alike in checked.shapes[1:] for each in alike}
    for point in points:
        reporter().advance(len(checked) / len(points))
        try:
            experiment = checked.experiment(point)
        except ConfigError as error:
            problems |= dict.fromkeys(error.problems)
            if len(problems) >= MOST_PROBLEMS:
                break
            continue
        wrong = _unlike(experiment, checked.base) or _unlike_states(
            checked, point, first_of.get(point, 0)
        )
        if wrong:
            place = checked.source.place(("sweep",))
            problems[InputProblem("sweep", f"point {point}: {wrong}", place)] = None
            break
    if problems:
        raise ConfigError(problems)


def _unlike(experiment: Experiment, base: Experiment) -> str | None:
    """Return the reason why the results of two points do not fit into one array, or None."""
    if list(experiment.loops) != list(base.loops):
        labels, first = (", ".join(one.loops) for one in (experiment, base))
        return (
            f"the controllers are {labels}, but {first} at point 0; "
            "give each a `label` that is the same at all points"
        )
    runs, base_runs = experiment.config.ensemble.runs, base.config.ensemble.runs
    if runs != base_runs:
        return f"ensemble.runs is {runs}, but {base_runs} at point 0; {RUNS}"
    return None


def _unlike_states(checked: Study, point: int, first: int) -> str | None:
    """Return the reason why a point cannot be solved with the first one of its shape, or None."""
    loops = checked.experiment(point).loops
    for label, loop in checked.experiment(first).loops.items():
        length, expected = loops[label].state_length, loop.state_length
        if length != expected:
            return (
                f"the loop of controller '{label}' has {length} states, but {expected} at point "
                f"{first}; run laws with different numbers of states, and references that are "
                "integrated differently, as separate experiments"
            )
    return None
