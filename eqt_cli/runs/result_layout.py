"""Lays out the result file of a study: its dimensions, variables and groups.

If all points of a sweep have the same shape, variables have a dimension `point`. Otherwise the root
holds only the numbers of each run, and a group for each point holds all of its variables.
"""

import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.files import LAW, point_group
from eqt_cli.base.store_writer import Assembly, Attribute, Blank, Variable, assemble
from eqt_cli.base.yaml_source import dump
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.read_study import law_names
from eqt_cli.config.schema import Config
from eqt_cli.config.source import description
from eqt_cli.config.study import Study, section_of
from eqt_cli.loop.signals import MIXED, Signal
from eqt_cli.results.metrics import ESTIMATE_SETTLING, MEASURED, QUANTITIES, SETTLING, SIGNAL
from eqt_cli.results.quantity import Quantity, ValuePer

TEXT_BYTES = 16
"""Size of a reference to a string in HDF5, bytes."""


# The rows of the table for a configuration -------------------------------------------------------


def by_thresholds_of_parts(quantity: Quantity, thresholds: Mapping[str, float]) -> Quantity:
    """Return a row that uses the settling threshold, for separate thresholds of the parts."""
    assert quantity.of is not None
    words = quantity.long_name.replace("||I - Q_E||_F", "the largest error of a part")
    words = words.replace("||I - Qhat^-1 Q||_F", "the largest error of a part of the estimate")
    return replace(
        quantity,
        long_name=words.replace("the settling threshold", "its settling threshold"),
        signals=(ESTIMATE_SETTLING if quantity.signals == ("estimate_error",) else SETTLING,),
        of=partial(quantity.of, threshold=1.0),
        settings={},
        notes={f"threshold_{name}": value for name, value in thresholds.items()},
    )


def with_keys_of(config: Config, quantity: Quantity) -> Quantity:
    """Return the row of the table for the keys of a configuration."""
    thresholds = config.settling_threshold
    if isinstance(thresholds, dict) and "settling_threshold" in quantity.settings.values():
        return by_thresholds_of_parts(quantity, thresholds)
    values = {name: getattr(config, key) for name, key in quantity.choices.items()}
    return quantity.with_choices(values)


def _vehicle(experiment: Experiment) -> Vehicle:
    """Return the vehicle, which all laws share."""
    return next(iter(experiment.loops.values())).vehicle


def quantities(experiment: Experiment, vehicles: Sequence[Vehicle] = ()) -> list[Quantity]:
    """Return the variables of an experiment's result with their units, in the file's order.

    Parameters
    ----------
    vehicles
        Vehicles of all points of a sweep; a variable stored for one is stored for all. Default:
        the vehicle of the experiment.
    """
    quantities, group = [], experiment.group
    vehicle = _vehicle(experiment)
    vehicles = vehicles or [vehicle]
    for quantity in QUANTITIES.values():
        # Points with and without thrusters or wheels have different shapes.
        of = [vehicle] if vehicle.members.keys() & set(quantity.dims) else vehicles
        if not (quantity.stored and any(map(quantity.stored_of, of)) and _exists(quantity, group)):
            continue
        quantity = with_keys_of(experiment.config, quantity)
        notes = {name: getattr(experiment.config, key) for name, key in quantity.settings.items()}
        signal = SIGNAL.get(quantity.signals[0]) if quantity.signals else None
        laws = [loop.controller for loop in experiment.loops.values()]
        if signal and not any(map(signal.exists_for, laws)):
            continue
        units = quantity.unit(signal.units(group) if signal else "")
        quantities.append(replace(quantity, units=units, notes={**quantity.notes, **notes}))
        if signal and (quantity.per is ValuePer.TRAJECTORY or quantity.stored_by_part):
            quantities += [
                replace(quantity.part(part.name), units=quantity.unit(signal.unit_in(part)))
                for part in _separate_parts(quantity, signal, group)
            ]
    return quantities


def _exists(quantity: Quantity, group: MatrixLieGroup) -> bool:
    """Return whether a group has the signals of a quantity."""
    return all(SIGNAL[name].exists_on(group) for name in quantity.signals if name in SIGNAL)


def _separate_parts(quantity: Quantity, signal: Signal, group: MatrixLieGroup) -> tuple[Part, ...]:
    """Return the parts stored besides a norm; for numbers per run, only if their units differ."""
    mixes = quantity.per is ValuePer.TRAJECTORY or signal.units(group) == MIXED
    return signal.parts(group) if mixes else ()


def measured_of(config: Config, group: MatrixLieGroup) -> list[Quantity]:
    """Return the quantities computed from signals on a group, including those of parts."""
    rows = [with_keys_of(config, quantity) for quantity in MEASURED if _exists(quantity, group)]
    return rows + [
        row.part(part.name)
        for row in rows
        if row.stored_by_part
        for part in _separate_parts(row, SIGNAL[row.signals[0]], group)
    ]


def coordinates(experiment: Experiment, most: int) -> dict[str, Variable]:
    """Return the coordinates of all dimensions; the first `most` runs have trajectories."""

    def along(dim: str, values: Array, long_name: str, **units: str) -> Variable:
        return Variable((dim,), values, {**units, "long_name": long_name})

    G, runs, labels = experiment.group, experiment.config.ensemble.runs, list(experiment.loops)
    times = experiment.times[:: experiment.config.store.decimate]
    variables = [
        along("controller", np.array(labels, dtype=object), "control law"),
        along("run", np.arange(runs), "run, with its own initial state", units="1"),
        along("time", times, "time", units="s"),
        along("row", np.arange(G.size), "row of a pose matrix", units="1"),
        along("col", np.arange(G.size), "column of a pose matrix", units="1"),
        along("axis", np.array(G.axis_names, dtype=object), "algebra coordinate"),
    ]
    members = _vehicle(experiment).members.items()
    variables += [along(dim, np.array(of, dtype=object), dim) for dim, of in members if of and most]
    if 0 < most < runs:
        stored = np.arange(most)
        variables.append(along("stored_run", stored, "run whose trajectory is stored", units="1"))
    return {variable.dims[0]: variable for variable in variables}


# The file ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class NewResultFile:
    """An unfinished result file with all its variables, still without values.

    Attributes
    ----------
    root
        The root of the file.
    groups
        The group of each point; empty if all points have the same shape.
    places
        Destination of each piece of the study.
    """

    root: Assembly
    groups: list[Assembly]
    places: "Sequence[Destination]"


class Layout:
    """The stored quantities of points of one shape, and their dimensions."""

    def __init__(self, study: Study) -> None:
        self.study = study
        every = quantities(study.base, study.vehicles)
        self.quantities = [entry for entry in every if self._is_stored(entry)]
        self.varies = {
            ValuePer.INITIAL: study.initial_varies,
            ValuePer.DESIRED: study.desired_varies,
        }

    def _is_stored(self, quantity: Quantity) -> bool:
        alone = quantity.per is ValuePer.DESIRED and self.study.desired_varies
        return self.study.trajectories > 0 or not (alone or quantity.per is ValuePer.TRAJECTORY)

    def of(self, per: ValuePer) -> Iterator[Quantity]:
        """Return the quantities of a kind."""
        return (entry for entry in self.quantities if entry.per is per)

    def by_point(self, quantity: Quantity) -> bool:
        """Whether a quantity has separate values for each point."""
        return self.study.sweep is not None and self.varies.get(quantity.per, True)

    def blanks(
        self, wanted: Iterable[Quantity] | None = None, *, single: bool = False
    ) -> dict[str, Blank]:
        """Return all or the wanted variables, for a `single` point or for all points."""
        blanks = {}
        for entry in self.quantities if wanted is None else wanted:
            point = ("point",) if self.by_point(entry) and not single else ()
            dims = (*point, *self._leading(entry.per), *entry.dims)
            blanks[entry.name] = Blank(dims, entry.dtype, entry.attributes)
        return blanks

    def _leading(self, per: ValuePer) -> tuple[str, ...]:
        stored = "run" if self.study.trajectories == self.study.plan.runs else "stored_run"
        return {
            ValuePer.TRAJECTORY: ("controller", stored),
            ValuePer.RUN: ("controller", "run"),
            ValuePer.INITIAL: ("run",),
            ValuePer.DESIRED: (),
        }[per]

    def size(self, blanks: Mapping[str, Blank]) -> int:
        """Return the size of some variables, bytes."""
        sizes = self.sizes
        return sum(
            prod(sizes[dim] for dim in blank.dims)
            * (blank.dtype.itemsize if blank.dtype else TEXT_BYTES)
            for blank in blanks.values()
        )

    @property
    def sizes(self) -> dict[str, int]:
        """The length of every dimension."""
        return {"point": len(self.study)} | _sizes(self.coordinates)

    @property
    def coordinates(self) -> dict[str, Variable]:
        """Coordinates along the dimensions of a point."""
        return coordinates(self.study.base, self.study.trajectories)


def in_root(study: Study) -> list[Quantity]:
    """Return the quantities in the root of a result: only metrics if points differ in shape."""
    first, *others = [Layout(study.piece(index)) for index in range(len(study.shapes))]
    return _shared(first, others) if study.is_ragged else first.quantities


def _shared(first: Layout, others: Sequence[Layout]) -> list[Quantity]:
    """Return the quantities per run that points of every shape have."""
    names = [{entry.name for entry in layout.of(ValuePer.RUN)} for layout in others]
    return [entry for entry in first.of(ValuePer.RUN) if all(entry.name in each for each in names)]


@contextmanager
def new_result_file(study: Study, path: Path) -> Iterator[NewResultFile]:
    """Open the result file of a study for writing; the file appears when the block ends."""
    layouts = [Layout(study.piece(index)) for index in range(len(study.shapes))]
    blanks, coords = _root(study, layouts)
    laws = law_names(study)
    if laws is not None:
        meaning = {"long_name": "registered law without options that the controller equals"}
        blanks[LAW] = Blank(("point", "controller"), None, meaning)
    sizes = {"point": len(study)} if study.sweep else {}
    gzip = study.base.config.store.compression == "gzip"
    with assemble(path, sizes | _sizes(coords), coords, blanks, "gzip" if gzip else None) as file:
        if laws is not None:
            file.put(LAW, laws)
        if not study.is_ragged:
            yield NewResultFile(file, [], [file])
            return
        of_point = {p: layouts[index] for index, points in enumerate(study.shapes) for p in points}
        groups = [_group(file, study, point, of_point[point]) for point in range(len(study))]
        places = []
        for points, layout in zip(study.shapes, layouts, strict=True):
            by_point = {entry.name for entry in layout.quantities if layout.by_point(entry)}
            places.append(_Spread(file, [groups[p] for p in points], points, by_point, blanks))
        yield NewResultFile(file, groups, places)


def _root(study: Study, layouts: list[Layout]) -> tuple[dict[str, Blank], dict[str, Variable]]:
    """Return the variables and coordinates of the root."""
    swept = swept_coordinates(study)
    if not study.is_ragged:
        return layouts[0].blanks(), layouts[0].coordinates | swept
    every = [layout.blanks(layout.of(ValuePer.RUN)) for layout in layouts]
    common = {
        name: replace(every[0][name], attributes=_agreed([one[name].attributes for one in every]))
        for name in (entry.name for entry in _shared(layouts[0], layouts[1:]))
    }
    shared = {name: layouts[0].coordinates[name] for name in ("controller", "run")}
    return common, shared | swept


def _agreed(attributes: list[Mapping[str, Attribute]]) -> dict[str, Attribute]:
    """Return the attributes that all have in common; different units become `MIXED`."""
    first, *rest = attributes
    same = {key: value for key, value in first.items() if all(o.get(key) == value for o in rest)}
    return same if "units" in same or "units" not in first else {"units": MIXED, **same}


def _group(file: Assembly, study: Study, point: int, layout: Layout) -> Assembly:
    """Create the group of a point, with the layout of the result of a single experiment."""
    coords = layout.coordinates
    group = file.group(point_group(point), _sizes(coords), coords, layout.blanks(single=True))
    experiment = study.experiment(point)
    config = dump(experiment.resolved | {"store": study.resolved["store"]})
    about = _experiment(experiment, experiment.resolved, set())
    group.describe({"config": config, "group": experiment.group.name, "experiment": about})
    return group


def _sizes(variables: Mapping[str, Variable]) -> dict[str, int]:
    return {name: len(one.data) for name, one in variables.items() if one.dims == (name,)}


@dataclass(frozen=True)
class _Spread:
    """Writes the variables of a piece to the groups of its points, and metrics also to the root.

    Attributes
    ----------
    by_point, in_root
        Names of the variables with separate values for each point, and of those in the root.
    """

    root: Assembly
    groups: list[Assembly]
    points: Sequence[int]
    by_point: Collection[str]
    in_root: Collection[str]

    def put(self, name: str, data: Array, positions: tuple[int | slice, ...] = ()) -> None:
        """Write part of a variable, at positions along (point,) and its further axes."""
        if name not in self.by_point:
            for group in self.groups:
                group.put(name, data, positions)
            return
        first, *rest = positions
        if isinstance(first, int):
            first, data = slice(first, first + 1), data[None]
        for inner, values in zip(range(first.start, first.stop), data, strict=True):
            self.groups[inner].put(name, values, tuple(rest))
            if name in self.in_root:
                self.root.put(name, values, (self.points[inner], *rest))


Destination = Assembly | _Spread
"""Receives the variables of a piece."""


def _experiment(experiment: Experiment, config: Mapping[str, Any], swept: Set[str]) -> str:
    """Return what readers show of an experiment, in JSON; a swept tolerance is none."""
    laws = {label: loop.controller for label, loop in experiment.loops.items()}
    about = description(config, _vehicle(experiment).departures) | {
        "titles": experiment.titles,
        "functions": {label: law.energy for label, law in laws.items()},
        "unclaimed": [k for k, loop in experiment.loops.items() if not loop.claims_decrease],
        "not_matched": [label for label, law in laws.items() if law.matched is False],
    }
    return json.dumps(about | ({"rtol": None} if "solver" in swept else {}), ensure_ascii=False)


def _scale_attributes(study: Study, key: str) -> dict[str, Attribute]:
    """Return the scale of a swept key, and its name on the axis of a figure with its unit."""
    from eqt_cli.config.json_schema import scale_of  # only sweeps need it

    attributes: dict[str, Attribute] = {}
    assert study.sweep is not None
    if key in log_keys(study.sweep.data):
        attributes["scale"] = "log"
    if scale := scale_of(study.resolved, key):
        letter = re.sub(r"(?<= )[gcnq]$", r"$\g<0>$", scale.label)  # of a weight
        attributes["label"] = f"${scale.label}$" if scale.is_symbol else letter
        attributes |= {"unit_of_key": scale.unit} if scale.unit else {}
    return attributes


def log_keys(section: Any) -> Iterator[str]:
    """Yield the keys of ranges with ``scale: log`` in the section of a sweep."""
    if isinstance(section, list):
        for entry in section:
            yield from log_keys(entry)
    elif isinstance(section, dict):
        for key, entry in section.items():
            if isinstance(entry, dict) and entry.get("scale") == "log":
                yield str(key)
            yield from log_keys(entry)


def swept_coordinates(study: Study) -> dict[str, Variable]:
    """Return a coordinate along `point` for each swept key: numbers, texts, or JSON texts."""
    if study.sweep is None:
        return {}
    swept = {}
    columns = list(zip(*map(study.sweep.values, range(len(study))), strict=True))
    for key, values in zip(study.sweep.keys, columns, strict=True):
        name = key.replace("[", ".").replace("]", "")
        attributes = {"long_name": f"{key}, swept", "key": key} | _scale_attributes(study, key)
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            swept[name] = Variable(("point",), np.array(values), attributes)
        else:
            plain = all(isinstance(value, str) for value in values)
            texts = values if plain else [json.dumps(v, ensure_ascii=False) for v in values]
            swept[name] = Variable(("point",), np.array(texts, dtype=object), attributes)
    return swept


def described(study: Study, provenance: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes that describe a result and allow running it again."""
    groups = {study.piece(index).base.group.name: None for index in range(len(study.shapes))}
    swept = set(map(section_of, study.sweep.sets)) if study.sweep else set[str]()
    return {
        "title": study.name,
        "config": dump(study.resolved),
        "plugins": dump(study.base.plugins),
        **({"files": json.dumps(study.files, ensure_ascii=False)} if study.files else {}),
        "digest": study.digest,
        "group": ", ".join(groups),
        "experiment": _experiment(study.base, study.resolved, swept),
        "provenance": json.dumps(provenance, ensure_ascii=False),
        "references": "Hampsey, van Goor, Banavar, Mahony (2025), arXiv 2511.18800",
    }
