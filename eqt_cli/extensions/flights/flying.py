"""Flies recorded flights with a model: each with its law, along its own setpoints, from its start.

The model is also flown with a plant that is wrong by a quarter, in the same solve.
"""

import csv
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import EqtError, InputError, KeyPath, parse_key
from eqt_cli.base.files import replace_file
from eqt_cli.components import pose_tables
from eqt_cli.components.groups import MatrixLieGroup, group_named
from eqt_cli.config.document import Document, changed_at, value_at
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import study
from eqt_cli.extensions.flights.agreement import Row
from eqt_cli.extensions.logs import logs
from eqt_cli.extensions.logs.flight_list import ListedFlight
from eqt_cli.extensions.logs.logs import Series, TrackingErrors, matrices
from eqt_cli.runs.batches import batches, differing

QUARTER = 0.25
"""By how much the numbers of a wrong plant are wrong."""

OWN = {"setting": "setting", "day": "day", "vehicle": "vehicle"}
"""Further columns of a list with a meaning of their own."""

PER_LAP, SAME_LAP, OTHER_PLACE = 2000, 0.05, 0.5
"""Instants at which laps are looked for; distance, as a share of the size, at which a motion is the
same one lap later, and at which it has left its first place."""

LONGEST_STEP = 0.1
"""Longest time between two waypoints, s: setpoints that come at 250 Hz are thinned to it."""

STANDS = 1e-9
"""Change of setpoints, m or entries of quaternions, below which they stand still."""

STILL_SPEED, STILL_TIME, CLIMB = 0.01, 0.3, 0.3
"""A vehicle stands on the ground where it is slower, m/s, for this time, s, and then climbs, m."""

SAMPLES = 100.0
"""Samples of a simulated flight in a second."""


class Flight(NamedTuple):
    """A recorded flight, and what of it is flown and compared.

    Attributes
    ----------
    listed
        Its row of the list.
    tracking
        Its errors from its begin to its end.
    quantity
        What is compared.
    lap
        Time of a lap, s; 0 where the setpoints do not repeat.
    window
        The times that are compared.
    keys
        Values of keys of the model in columns of the list.
    numbers
        Numbers by which a rule may order flights.
    """

    listed: ListedFlight
    tracking: TrackingErrors
    quantity: str
    lap: float
    window: tuple[float, float]
    keys: dict[str, Any]
    numbers: dict[str, float]

    @property
    def name(self) -> str:
        """The name of its file."""
        return self.listed.file.name

    @property
    def law(self) -> str:
        """Its law, as in the list."""
        return self.listed.law

    @property
    def setting(self) -> str:
        """Its law with its gains."""
        if name := self.listed.factors.get("setting"):
            return f"{self.law} {name}".strip()
        return " ".join([self.law, *(f"{key}={value}" for key, value in self.keys.items())]).strip()

    @property
    def errors(self) -> tuple[Array, Array]:
        """Times and errors of all axes in the window."""
        return within(self.tracking.curves[self.quantity], self.window)


def within(curve: tuple[Array, Array], window: tuple[float, float]) -> tuple[Array, Array]:
    """Return the rows of a curve that have a number, between two times."""
    t, rows = curve
    keep = (t >= window[0]) & (t <= window[1]) & np.isfinite(rows[:, 0])
    return t[keep], rows[keep]


def rms(rows: Array) -> float:
    """Return the root mean square of the errors of all axes together."""
    return float(np.sqrt(np.mean(rows[:, 0] ** 2))) if len(rows) else np.nan


def flight_of(
    listed: ListedFlight, tracking: TrackingErrors, quantity: str, lap: float | None
) -> Flight:
    """Return a flight with its window: all but the first lap.

    Raises
    ------
    InputError
        If it does not have the quantity, takes off in the window, or a column has no value.
    """
    if quantity not in tracking.curves:
        has = ", ".join(tracking.curves)
        raise InputError(f"no {quantity} is measured and wanted; it has {has}: choose by --metric")
    t = tracking.curves[quantity][0]
    goal = tracking.goals[quantity]
    of_lap = lap_of(goal, float(t[0]), float(t[-1])) if lap is None else lap
    window = float(t[0]) + of_lap, float(t[-1])
    if not window[0] < window[1]:
        raise InputError(f"it lasts {t[-1] - t[0]:.4g} s, no longer than a lap of {of_lap:g} s")
    _refuse_take_off(tracking, (float(t[0]), window[1]))
    keys, numbers = _columns(listed)
    start = abs(tracking.curves[quantity][1][0, 0])
    numbers |= {"start error": float(start)} if np.isfinite(start) else {}
    if quantity == "position":
        inside = (goal.times >= window[0]) & (goal.times <= window[1])
        path = norm(np.diff(goal.numbers[inside], axis=0)).sum()
        numbers["speed"] = float(path / (window[1] - window[0]))
    return Flight(listed, tracking, quantity, of_lap, window, keys, numbers)


def lap_of(goal: Series, begin: float, end: float) -> float:
    """Return the time after which setpoints repeat, s; 0 if they do not, twice or more."""
    t = np.linspace(begin, end, PER_LAP)
    places = goal.numbers if goal.numbers.shape[1] == 3 else matrices(goal.numbers).reshape(-1, 9)
    x = np.stack([np.interp(t, goal.times, column) for column in places.T], axis=-1)
    size = float(np.sqrt(x.var(axis=0).sum()))
    if size < 1e-3:
        return 0.0
    left = False
    for k in range(1, PER_LAP // 2):
        distance = float(np.sqrt(np.mean(np.sum((x[k:] - x[:-k]) ** 2, axis=1)))) / size
        left = left or distance > OTHER_PLACE
        if left and distance < SAME_LAP:
            return float(t[k] - t[0])
    return 0.0


def _refuse_take_off(tracking: TrackingErrors, span: tuple[float, float]) -> None:
    """Raise an error if the vehicle stands at its lowest height, and then climbs."""
    if (one := tracking.actual.get("position")) is None or len(one.times) < 3:
        return
    t, z = one.times, one.numbers[:, 2]
    keep = (t >= span[0]) & (t <= span[1]) & np.isfinite(one.numbers).all(axis=1)
    t, z, p = t[keep], z[keep], one.numbers[keep]
    if len(t) < 3:
        return
    first = t <= t[0] + STILL_TIME
    moved = norm(p[first] - p[0]).max()
    low = z[first].max() <= z.min() + STILL_SPEED
    if moved <= STILL_SPEED * STILL_TIME and low and z.max() >= z[0] + CLIMB:
        leaves = t[np.flatnonzero(z > z[0] + 2 * STILL_SPEED)[0]]
        raise InputError(
            f"it stands at its lowest height until {leaves:.4g} s and then climbs {np.ptp(z):.2g} "
            "m: a take-off within the window; give a later begin, when it follows its setpoints"
        )


def _columns(listed: ListedFlight) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the keys of the model and the numbers that a row of the list gives."""
    keys, numbers = dict[str, Any](), dict[str, float]()
    for name, text in listed.factors.items():
        if name in OWN or not text:
            continue
        is_key = "." in name or "[" in name
        value: Any = text
        with suppress(EqtError, ValueError):
            value = yaml_source.load(f"value: {text}", name).data["value"]
        if is_key:
            parse_key(name)
            keys[name] = value
        for k, entry in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(entry, int | float) and not isinstance(entry, bool):
                numbers[f"{name}[{k}]" if isinstance(value, list) else name] = float(entry)
    return keys, numbers


# The model of a flight ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Simulated:
    """A flight as the model flies it.

    Attributes
    ----------
    flight
        The recorded one.
    curve
        Times and errors of all axes, in the window.
    variants
        The same of wrong models, by what is wrong.
    late
        The delay of the simulated motion at which it is nearest to the flown one, s.
    """

    flight: Flight
    curve: tuple[Array, Array]
    variants: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    late: float = 0.0

    def row(self) -> Row:
        """Return the numbers of the flight, for the statistics."""
        flight = self.flight
        texts = flight.name, flight.law, flight.setting, flight.listed.condition
        sizes = {name: rms(rows) for name, (_, rows) in self.variants.items()}
        return Row(
            *texts,
            flight.listed.factors.get("day", ""),
            rms(flight.errors[1]),
            rms(self.curve[1]),
            flight.numbers,
            sizes,
        )


def label_of(entry: Any) -> str:
    """Return how an entry of `controllers` is called."""
    return f"{entry.get('label') or entry.get('kind')}" if isinstance(entry, dict) else f"{entry}"


def laws_of(document: Document) -> dict[str, int]:
    """Return the entries of `controllers` by their labels."""
    entries = document.data.get("controllers") or []
    entries = entries if isinstance(entries, list) else [entries]
    return {label_of(entry): k for k, entry in enumerate(entries)}


def law_of(document: Document, flight: ListedFlight) -> str:
    """Return the label of the law of a flight.

    Raises
    ------
    InputError
        If the model does not have it.
    """
    laws = laws_of(document)
    if flight.law in laws:
        return flight.law
    if len(laws) == 1 and not flight.law:
        return next(iter(laws))
    names = ", ".join(laws) or "none"
    raise InputError(f"law: the model has {names}, got '{flight.law}'; add it to controllers")


def file_of_reference(reference: Any, path: KeyPath = ("reference",)) -> KeyPath | None:
    """Return the key of the file that a reference reads; None if it reads none."""
    if not isinstance(reference, dict):
        return None
    if "file" in reference:
        return (*path, "file")
    places = (file_of_reference(value, (*path, key)) for key, value in reference.items())
    return next((place for place in places if place), None)


def group_of(document: Document) -> MatrixLieGroup:
    """Return the group of a model."""
    name = document.data.get("group")
    if not isinstance(name, str):
        raise InputError("group: expected the group of the model, SO3 or SE3")
    return group_named(name)


@contextmanager
def folder_of_flights() -> Iterator[Path]:
    """Yield a folder for setpoints and starts, which is removed."""
    with tempfile.TemporaryDirectory(prefix="eqt-validate-") as folder:
        yield Path(folder)


def model_of(document: Document, flight: Flight, G: MatrixLieGroup, folder: Path) -> Document:
    """Return the model with the keys, the setpoints and the start of a flight."""
    for key, value in flight.keys.items():
        path = parse_key(key)
        if value_at(document.data, path[:1]) is None:
            raise InputError(f"{key}: the model has no {path[0]}; name a column by a key of it")
        document = changed_at(document, path, value, f"column {key}")
    t0, end = float(flight.tracking.curves[flight.quantity][0][0]), flight.window[1]
    if place := file_of_reference(document.data.get("reference")):
        file = folder / "setpoints.csv"
        replace_file(file, _setpoints(flight, G, t0, end).encode())
        document = changed_at(document, place, str(file), "setpoints of the flight")
    start = folder / "start.csv"
    replace_file(start, _start(flight, G, t0).encode())
    document = changed_at(document, ("initial",), {"file": str(start)}, "start of the flight")
    span = {"duration": float(end - t0), "samples": int((end - t0) * SAMPLES) + 2}
    document = changed_at(document, ("time",), span, "time of the flight")
    return changed_at(document, ("ensemble",), {"runs": 1}, "one flight")


def _table(names: Sequence[str], rows: Array) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([[f"{x:.10g}" for x in row] for row in rows])
    return stream.getvalue()


def _setpoints(flight: Flight, G: MatrixLieGroup, begin: float, end: float) -> str:
    """Return the setpoints of a flight as a table of poses, from its begin on."""
    goals = flight.tracking.goals
    lead = goals[flight.quantity]
    t = lead.times[(lead.times >= begin) & (lead.times <= end)]
    step = max(int(LONGEST_STEP / np.median(np.diff(t))), 1)
    t = np.append(t[:-1:step], t[-1])
    poses = _poses(goals, t, G)
    if np.ptp(poses, axis=0).max() < STANDS:
        t, poses = t[[0, -1]], poses[[0, -1]]
    return _table(["t", *_pose_names(G)], np.c_[t - begin, poses])


def _pose_names(G: MatrixLieGroup) -> list[str]:
    return [*pose_tables.pose_columns(G)]


def _poses(series: Mapping[str, Series], t: Array, G: MatrixLieGroup) -> Array:
    """Return poses at some times as rows of the columns of the group; the identity if unknown."""
    columns = list[Array]()
    names = _pose_names(G)
    if {"x", "y", "z"} <= {*names}:
        if "position" not in series:
            raise InputError(f"{G.name} needs positions, and none are recorded")
        columns += [*series["position"].at(t).T]
    if "qw" in names:
        x = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
        if "attitude" in series:
            x = series["attitude"].at(t)
            x = np.where(np.isfinite(x).all(axis=1, keepdims=True), x, [1.0, 0.0, 0.0, 0.0])
        columns += [*x[:, [1, 2, 3, 0]].T]
    order = [*(["x", "y", "z"] if "x" in names else []), *pose_tables.QUATERNION]
    if {*order} != {*names}:
        raise InputError(f"flights are validated on SO3 and SE3, not on {G.name}")
    where = [order.index(name) for name in names]
    return np.stack(columns, axis=-1)[:, where]


def _start(flight: Flight, G: MatrixLieGroup, begin: float) -> str:
    """Return the first pose and velocity of a flight as a table of one row."""
    actual = flight.tracking.actual
    lead = actual[flight.quantity]
    t = lead.times[np.searchsorted(lead.times, begin - 1e-9)][None]
    pose = _poses(actual, t, G)
    names, row = _pose_names(G), pose[0].tolist()
    q = np.array([[row[names.index(k)] for k in ("qw", "qx", "qy", "qz")]])
    R = matrices(q)[0]
    if "rates" in actual:
        w = actual["rates"].at(t)[0]
    elif "attitude" in actual and flight.quantity == "attitude":
        w = _turning(actual["attitude"], float(t[0]))
    else:
        w = np.zeros(3)
    w = np.where(np.isfinite(w), w, 0.0)
    names, row = [*names, "wx", "wy", "wz"], [*row, *w.tolist()]
    if "x" in names:
        v = actual["velocity"].at(t)[0] if "velocity" in actual else _slope(actual["position"], t)
        v = R.T @ np.where(np.isfinite(v), v, 0.0)
        names, row = [*names, "vx", "vy", "vz"], [*row, *v.tolist()]
    return _table(names, np.array([row]))


def _slope(series: Series, t: Array) -> Array:
    """Return the velocity of positions after a time, by a straight line through a few rows."""
    rows = slice(k := int(np.searchsorted(series.times, t[0] - 1e-9)), k + 5)
    x, y = series.times[rows], series.numbers[rows]
    return np.polyfit(x - x[0], y, 1)[0] if len(x) > 1 else np.zeros(3)


def _turning(series: Series, t: float) -> Array:
    """Return the angular velocity in the body from a row of attitudes to the next one."""
    k = int(np.searchsorted(series.times, t - 1e-9))
    if k + 1 >= len(series.times):
        return np.zeros(3)
    from scipy.spatial.transform import Rotation  # slow to import

    one, other = (Rotation.from_quat(series.numbers[j][[1, 2, 3, 0]]) for j in (k, k + 1))
    rate: Array = (one.inv() * other).as_rotvec() / (series.times[k + 1] - series.times[k])
    return rate


# Wrong plants -------------------------------------------------------------------------------------


Plants = dict[str, "Plant"]
"""Wrong plants by the text of the plant that they differ from."""


class Plant(NamedTuple):
    """Wrong plants of a model, as numbers of one compiled structure.

    Attributes
    ----------
    names
        What is wrong with each; the first, the model itself, has an empty name.
    numbers
        The leaves of a loop in which they differ, a row for each.
    right
        The sections of the model that say the same of the right plant.
    """

    names: list[str]
    numbers: dict[str, Array]
    right: dict[str, Any]


def _plants(document: Document, base: Experiment) -> dict[str, Document]:
    """Return the model with inertia, mass and thrust, or torque, that are wrong by a quarter.

    The laws keep the numbers that they believe. Every plant has a `scale`, so that all of them are
    one structure.
    """
    G, believed = base.group, base.loop.inertia.at(0.0)
    true = base.vehicle.inertia.at(believed, 0.0) if base.vehicle.inertia else believed
    M, ones = np.asarray(true.matrix).reshape(G.dimension, G.dimension), np.ones(G.dimension)
    turns = np.zeros(G.dimension, dtype=bool)
    for part in G.parts:
        turns[part.axes] = part.turns

    def scaled(axes: Array, factor: float) -> Array:
        root = np.sqrt(np.where(axes, factor, 1.0))
        return np.outer(root, root) * M

    plants = {"": (M, ones, 1.0)}
    for sign, factor in (("−", 1 - QUARTER), ("+", 1 + QUARTER)):
        by = f"{sign}{100 * QUARTER:.0f} %"
        plants[f"inertia {by}"] = scaled(turns, factor), ones, 1.0
        if not turns.all():
            plants[f"mass {by}"] = scaled(~turns, factor), ones, factor
        plants[f"{'torque' if turns.all() else 'thrust'} {by}"] = M, factor * ones, 1.0
    return {name: _with_plant(document, name, *plant) for name, plant in plants.items()}


def _with_plant(
    document: Document, name: str, inertia: Array, scale: Array, weight: float
) -> Document:
    actuators = document.data.get("actuators") or []
    actuators = actuators if isinstance(actuators, list) else [actuators]
    more = [*actuators, {"kind": "scale", "factor": scale.tolist()}]
    document = changed_at(document, ("actuators",), more, name)
    document = changed_at(document, ("plant", "inertia"), inertia.tolist(), name)
    return _heavier(document, weight, name)


def _heavier(document: Document, factor: float, place: str) -> Document:
    """Return the model whose plant, not its laws, has another weight."""
    forces = value_at(document.data, ("plant", "forces"))
    if forces is None:
        forces = value_at(document.data, ("model", "forces"))
    heavier = []
    for force in forces or []:
        if isinstance(force, dict) and "weight" in force:
            force = force | {"weight": _times(force["weight"], factor)}
        heavier.append(force)
    return changed_at(document, ("plant", "forces"), heavier, place) if heavier else document


def _times(value: Any, factor: float) -> Any:
    return value * factor if isinstance(value, int | float) else f"({value})*{factor:g}"


def _kinds(value: Any, name: str) -> Any:
    """Return a part of a model; of laws, only what they are."""
    return [label_of(entry) for entry in value] if name == "controllers" else value


# The flight ---------------------------------------------------------------------------------------


def simulated(document: Document, flight: Flight, wrong: Plants) -> Simulated:
    """Fly a flight with the model, and with wrong plants, of which `wrong` has those of others.

    Raises
    ------
    EqtError
        If the model does not fit the flight, or its run fails.
    """
    label = law_of(document, flight.listed)
    with folder_of_flights() as folder:
        model = model_of(document, flight, group_of(document), folder)
        parts = ("group", "inertia", "model", "plant", "actuators", "controllers")
        which = repr([_kinds(model.data.get(name), name) for name in parts])
        if which not in wrong:
            documents = _plants(model, study(model).base)
            loops = [study(one).base.loops[label] for one in documents.values()]
            rows = np.arange(1, len(loops) + 1)
            right_plant = documents[""].data
            right = {key: right_plant.get(key) for key in ("actuators", "plant")}
            wrong[which] = Plant([*documents], differing([loops[0], *loops], rows), right)
        names, numbers, right = wrong[which]
        [batch] = batches(study(replace(model, data=model.data | right)), label, np.array([0]))
        problem, count = batch.problem, len(names)
        varying = {name: np.repeat(x, count, axis=0) for name, x in problem.varying.items()}
        states = np.repeat(problem.states, count, axis=0)
        draws = None if problem.errors is None else np.zeros(count, dtype=int)
        problem = replace(problem, states=states, varying=varying | numbers, draws=draws)
        solution = batch.engine.solve(problem)
        s = problem.batched_loop(1).tracking(problem.times, solution.states)
        poses = np.asarray(s.Q)
    t0 = float(flight.tracking.curves[flight.quantity][0][0])
    curves = dict[str, tuple[Array, Array]]()
    late = 0.0
    for k, name in enumerate(names):
        if solution.status[k] or not np.isfinite(poses[k]).all():
            if not name:
                raise EqtError(
                    f"{flight.listed.file}: the run of {label} fails with the model; check its "
                    "gains, inertia and limits by eqt config check"
                )
            continue
        motion = _series(poses[k], t0 + problem.times, flight.quantity)
        # At the instants of the recording, so that both errors are of one set of samples
        at = flight.tracking.actual[flight.quantity].times
        at = at[(at >= motion.times[0]) & (at <= motion.times[-1])]
        one = {flight.quantity: Series("simulated", at, motion.at(at))}
        goal = {flight.quantity: flight.tracking.goals[flight.quantity]}
        tracking = logs.tracking_errors(
            f"{flight.listed.file}", one, goal, window=flight.window, delays=False
        )
        curves[name] = within(tracking.curves[flight.quantity], flight.window)
        if not name:
            late = _late(flight, motion)
    return Simulated(flight, curves.pop(""), curves, late)


def _series(poses: Array, t: Array, quantity: str) -> Series:
    """Return a simulated motion as a recording has it."""
    if quantity == "position":
        return Series("simulated", t, poses[:, :3, 3])
    from scipy.spatial.transform import Rotation  # slow to import

    return Series("simulated", t, Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]])


def _late(flight: Flight, motion: Series) -> float:
    """Return by how much later the flown positions are than the simulated ones, s."""
    if flight.quantity != "position":
        return 0.0
    flown = flight.tracking.actual["position"]
    t = flown.times[(flown.times >= flight.window[0]) & (flown.times <= flight.window[1])]
    x, velocity = motion.at(t), np.gradient(motion.numbers, motion.times, axis=0)
    v = Series("", motion.times, velocity).at(t)
    apart = flown.at(t) - x
    keep = np.isfinite(apart).all(axis=1) & np.isfinite(v).all(axis=1)
    squares = float((v[keep] ** 2).sum())
    return -float((v[keep] * apart[keep]).sum()) / squares if squares > 0 else 0.0
