"""The table of all quantities that a result holds or that follow from it, by name."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eqt_cli.closed_loop.signals import MIXED, SIGNALS, Signal, signal_of
from eqt_cli.config.schema import Config
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Status
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.results.metrics import CONSISTENCY, METRICS, by_thresholds_of_parts, energy_residual
from eqt_cli.results.quantity import Quantity, ValuePer
from eqt_cli.store.writer import Variable
from eqt_cli.vehicle import Vehicle

STATUS_MEANINGS = "; ".join(f"{status.value} {status.name.lower()}" for status in Status)

DESIRED = {"desired_pose": "pose", "desired_velocity": "velocity", "desired_torque": "torque"}
"""Stored quantities of the reference, and the signal that each corresponds to."""

_SIGNALS = {signal.name: signal for signal in SIGNALS}

_OVER_TIME = tuple(
    Quantity(
        signal.name,
        signal.long_name,
        ValuePer.TRAJECTORY,
        signals=(signal.name,),
        label="{}",
        dims=("time", *signal.dims),
        stored_of=signal.stored_of,
    )
    for signal in SIGNALS
)

_DESIRED = tuple(
    Quantity(
        name,
        name.replace("_", " ") + ", from a solve of its own",
        ValuePer.DESIRED,
        signals=(like,),
        own_symbol=_SIGNALS[like].symbol + "_d",
        label="{}",
        dims=("time", *_SIGNALS[like].dims),
    )
    for name, like in DESIRED.items()
)

_INITIAL = tuple(
    Quantity(f"initial_{like}", words, ValuePer.INITIAL, signals=(like,), dims=_SIGNALS[like].dims)
    for like, words in (
        ("pose", "pose at the start, same for all controllers"),
        ("velocity", "body velocity at the start"),
    )
)

_OF_THE_RUN = (
    Quantity(
        "steps", "work of the solver, as its engine counts it", units="1", dtype=np.dtype("i8")
    ),
    Quantity(
        "group_drift",
        "largest distance from the group",
        units="1",
        label="drift from the group",
        diagnostic=True,
    ),
    Quantity(
        "energy_residual",
        "largest |L + W - L(0)| / max(L(0), 1 J)",
        units="1",
        signals=("lyapunov", "energy_balance"),
        label="energy residual",
        of=energy_residual,
    ),
    Quantity(
        "unstable_distance",
        "smallest ||Q_E - Qc||_F, Qc critical points other than I",
        signals=("pose",),
        diagnostic=True,
    ),
    Quantity(
        "error_estimate",
        "largest max(||dQ||_F, ||dV||) against a tighter solve",
        units="mixed",
        label="error estimate",
    ),
    Quantity(
        "reference_residual",
        "distance of the run's own reference to desired_pose, desired_velocity",
        units="mixed",
        label="residual of the reference",
        diagnostic=True,
    ),
    Quantity(
        "status",
        "end of the run",
        units="1",
        dtype=np.dtype("i4"),
        notes={"meanings": STATUS_MEANINGS},
    ),
    Quantity("message", "why the run failed", units="", dtype=None),
)
"""Quality of the numbers, and outcome of the run; the run provides those without a formula."""


QUANTITIES = {
    quantity.name: quantity
    for quantity in (*_OVER_TIME, *_DESIRED, *_INITIAL, *METRICS, *CONSISTENCY, *_OF_THE_RUN)
}
"""All quantities by name; the stored ones are in the order of result files."""

MEASURED = tuple(q for q in QUANTITIES.values() if q.per is ValuePer.RUN and q.of and q.stored)
"""Stored quantities that are computed from the signals of a run."""


def with_keys_of(config: Config, quantity: Quantity) -> Quantity:
    """Return the row of the table for the keys of a configuration."""
    thresholds = config.settling_threshold
    if isinstance(thresholds, dict) and "settling_threshold" in quantity.settings.values():
        return by_thresholds_of_parts(quantity, thresholds)
    values = {name: getattr(config, key) for name, key in quantity.choices.items()}
    return quantity.with_choices(values)


def quantities(experiment: Experiment, vehicles: Sequence[Vehicle] = ()) -> list[Quantity]:
    """Return the variables of an experiment's result with their units, in the file's order.

    Parameters
    ----------
    vehicles
        Vehicles of all points of a sweep; a variable stored for one is stored for all. Default:
        the vehicle of the experiment.
    """
    quantities, group = [], experiment.group
    own = next(iter(experiment.loops.values())).vehicle
    vehicles = vehicles or [own]
    for quantity in QUANTITIES.values():
        # Points with and without thrusters or wheels have different shapes.
        of = [own] if own.members.keys() & set(quantity.dims) else vehicles
        if not (quantity.stored and any(map(quantity.stored_of, of)) and _exists(quantity, group)):
            continue
        quantity = with_keys_of(experiment.config, quantity)
        notes = {name: getattr(experiment.config, key) for name, key in quantity.settings.items()}
        signal = _SIGNALS.get(quantity.signals[0]) if quantity.signals else None
        laws = [loop.controller for loop in experiment.loops.values()]
        if signal and not any(map(signal.exists_for, laws)):
            continue
        units = quantity.unit(signal.units(group) if signal else "")
        quantities.append(replace(quantity, units=units, notes={**quantity.notes, **notes}))
        if signal and (quantity.per is ValuePer.TRAJECTORY or quantity.stored_by_part):
            quantities += [
                replace(quantity.part(part.name), units=quantity.unit(signal.unit_in(part)))
                for part in _parts_of_their_own(quantity, signal, group)
            ]
    return quantities


def _exists(quantity: Quantity, group: MatrixLieGroup) -> bool:
    """Return whether a group has the signals of a quantity."""
    return all(_SIGNALS[name].exists_on(group) for name in quantity.signals if name in _SIGNALS)


def _parts_of_their_own(
    quantity: Quantity, signal: Signal, group: MatrixLieGroup
) -> tuple[Part, ...]:
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
        for part in _parts_of_their_own(row, _SIGNALS[row.signals[0]], group)
    ]


def quantity_of(name: str, long_name: str = "") -> Quantity:
    """Return the row of a variable by its name in a result file.

    A part of a norm has the row of the norm with its own name. An unknown variable is a number per
    run without a formula.
    """
    if name in QUANTITIES:
        return QUANTITIES[name]
    for row in MEASURED:
        if row.stored_by_part and name.startswith(f"{row.name}_"):
            return row.part(name.removeprefix(f"{row.name}_"))
    if (signal := signal_of(name)) and signal.norm:
        return QUANTITIES[signal.name].part(name.removeprefix(f"{signal.name}_"))
    return Quantity(name, long_name or name, units="")


def coordinates(experiment: Experiment, kept: int) -> dict[str, Variable]:
    """Return the coordinates of all dimensions; `kept` runs have stored trajectories."""

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
    members = next(iter(experiment.loops.values())).vehicle.members.items()
    variables += [along(dim, np.array(of, dtype=object), dim) for dim, of in members if of and kept]
    if 0 < kept < runs:
        stored = np.arange(kept)
        variables.append(along("stored_run", stored, "run whose trajectory is stored", units="1"))
    return {variable.dims[0]: variable for variable in variables}
