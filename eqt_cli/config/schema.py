"""The shape of a configuration: its keys, their types and defaults; nothing about the group.

What depends on the group or on a component (shapes, options, definiteness) is checked by
`eqt_cli.experiment`. One JSON schema comes from these models and the registries.
"""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Tag, TypeAdapter

from eqt_cli.core.option_types import (
    Angle,
    Count,
    CountOrNone,
    Duration,
    Positive,
    Real,
    Runs,
    Samples,
)
from eqt_cli.core.validation import one_of
from eqt_cli.ensemble.axes import Drawn
from eqt_cli.groups.angles import distance_of_turn
from eqt_cli.vehicle.numbers import Matrix as DrawnMatrix
from eqt_cli.vehicle.numbers import Number


def _rank(value: Any) -> str | None:
    if not isinstance(value, list):
        number = isinstance(value, int | float | str) and not isinstance(value, bool)
        return "scalar" if number else None
    return "matrix" if any(isinstance(row, list) for row in value) else "list"


Row = list[Real]
_Constant = (
    Annotated[Real, Tag("scalar")]
    | Annotated[Row, Tag("list")]
    | Annotated[list[Row], Tag("matrix")]
)
Matrix = Annotated[_Constant, one_of(_rank, "a number, a list (the diagonal) or a list of rows")]
"""A number (times the identity), a list (a diagonal) or a list of rows."""


def _weight_kind(value: Any) -> str | None:
    if not isinstance(value, list):
        return _rank(value)
    kinds = {_rank(entry) for entry in value}
    return "factors" if "matrix" in kinds or len(kinds) > 1 else _rank(value)


Weight = Annotated[
    _Constant | Annotated[list[Matrix], Tag("factors")],
    one_of(_weight_kind, "a number, a list (the diagonal) or a list of rows"),
]
"""A matrix, or for a product of groups a list with one matrix per factor."""


def _distance_of_angle(value: Any) -> Any:
    """‖I − R‖_F of a rotation by an angle that is written in degrees."""
    if not (isinstance(value, str) and value.rstrip().endswith("deg")):
        return value
    angle: float = TypeAdapter(Angle).validate_python(value)
    return distance_of_turn(angle)


class Section(BaseModel):
    """A mapping with known keys only."""

    model_config = ConfigDict(extra="forbid", strict=True, use_attribute_docstrings=True)


class GainsSection(Section):
    """Gains of the control laws."""

    kp: Weight
    """Navigation weight K of Υ(Q) = ½ tr((Q − I) K (Q − I)ᵀ): scalar, diagonal or d×d matrix;
    for a product of groups also a list with one of these per factor."""
    kd: Matrix
    """Rayleigh tensor K_d, positive definite: scalar, diagonal or m×m matrix."""


class OwnGainsSection(Section):
    """Gains of one law, where it has others than the section `gains` says."""

    kp: Weight | None = None
    """Navigation weight of this law."""
    kd: Matrix | None = None
    """Rayleigh tensor of this law."""


class InitialSection(Section):
    """Distributions of the initial state, relative to the reference's."""

    pose: Any = "fixed"
    """Q(0) = Q_d(0) · draw; for a product of groups also a list with one entry per factor."""
    velocity: Any = "fixed"
    """V(0) = V_d(0) + draw."""
    file: str | None = None
    """Instead of both: a table of poses and velocities with a row for each run, or an earlier
    result, whose runs start there; relative to this file."""
    relative: bool = False
    """Whether the poses and velocities in the file are relative to the reference's."""


class EnsembleSection(Section):
    """How many runs, from which seed."""

    runs: Runs = 1
    """Runs per controller; as many as `initial.file` has rows, if there is one."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Root of all random streams."""


class TimeSection(Section):
    """The uniform grid of sample times, both ends included."""

    duration: Duration
    """Length of the horizon, s."""
    samples: Samples = 401
    """Number of sample times."""


class StoreSection(Section):
    """What goes into the result file."""

    trajectories: Literal["all", "none"] | Annotated[int, Field(ge=0)] = "all"
    """Trajectories of all runs, of none, or of the first N runs of each controller."""
    decimate: Count = 1
    """Keep every n-th sample of the trajectories; metrics use all."""
    compression: Literal["none", "gzip"] = "none"
    """gzip saves little on smooth signals and costs ten times the writing time."""


Formula = str | float
"""An expression in t, or a number."""


class FactoredInertiaSection(Section):
    """𝕀_t = S_tᵀ 𝕀_0 S_t, as in Theorem 3.2."""

    initial: Matrix
    """𝕀_0, symmetric positive definite."""
    factor: list[list[Formula]]
    """S_t, m×m expressions in t with S(0) = I."""


class PrescribedInertiaSection(Section):
    """𝕀_t as it is; the feedforward is then ½𝕀̇V."""

    matrix: list[list[Formula]]
    """𝕀_t, m×m expressions in t, symmetric positive definite at all times."""


def _inertia_kind(value: Any) -> str | None:
    if isinstance(value, dict):
        return "prescribed" if "matrix" in value else "factored"
    return _rank(value)


_Varying = (
    Annotated[FactoredInertiaSection, Tag("factored")]
    | Annotated[PrescribedInertiaSection, Tag("prescribed")]
)
_INERTIAS = "a number, a list (the diagonal), a list of rows or a mapping"
InertiaValue = Annotated[_Constant | _Varying, one_of(_inertia_kind, _INERTIAS)]
"""A constant tensor, or a mapping with expressions in t."""


class RelativeInertiaSection(Section):
    """(1 + r) 𝕀, of the 𝕀 that the laws believe."""

    relative: Number
    """r: 0.1 is 10 % more."""


def _plant_inertia_kind(value: Any) -> str | None:
    if isinstance(value, dict) and "relative" in value:
        return "relative"
    if isinstance(value, dict) and ("uniform" in value or "normal" in value):
        return "constant"
    kind = _inertia_kind(value)
    return "constant" if kind in ("scalar", "list", "matrix") else kind


PlantInertia = Annotated[
    Annotated[DrawnMatrix, Tag("constant")]
    | Annotated[RelativeInertiaSection, Tag("relative")]
    | _Varying,
    one_of(_plant_inertia_kind, _INERTIAS),
]
"""As `InertiaValue`, or relative to it; constant numbers may be drawn for each run."""


class PlantSection(Section):
    """What is there, of which the laws know nothing."""

    inertia: PlantInertia | None = None
    """The true inertia: as `inertia`, or {relative: 0.1} for 10 % more than the laws believe."""
    forces: list[Any] | None = None
    """Forces that act beside the actuators (`eqt list forces`)."""


class ControlSection(Section):
    """The clock of the laws; without it they act continuously."""

    period: Positive
    """The laws are evaluated at t = k·period, s, and their commands held in between."""
    delay: CountOrNone = 0
    """After how many whole periods a command arrives; until the first one does, 0 is held."""


class SensorsSection(Section):
    """Errors of what the laws are told; each is a list whose entries add up."""

    pose: list[Any] | None = None
    """Q_m = Q exp(n), with n in the coordinates of the algebra (`eqt list sensors`)."""
    velocity: list[Any] | None = None
    """V_m = V + b (`eqt list sensors`)."""


class LogRange(Section):
    """A range on a logarithmic scale, in short."""

    log: list[Positive]
    """Its ends."""


def _tuned_kind(value: Any) -> str | None:
    ends = value.get("log", [0, 0]) if isinstance(value, dict) else value
    if not (isinstance(ends, list) and len(ends) == 2):
        return None
    return "ends" if ends is value else "log" if "log" in value else "range"


TunedAxis = Annotated[
    Annotated[list[Real], Tag("ends")]
    | Annotated[LogRange, Tag("log")]
    | Annotated[Drawn, Tag("range")],
    one_of(_tuned_kind, "[low, high], {log: [low, high]} or {low: …, high: …, scale: …}"),
]
"""Between which values a number is tuned."""


class WorstRunSection(Section):
    """A bound that every run keeps, and not only their mean."""

    max: Real | None = None
    """No run may have more."""
    min: Real | None = None
    """No run may have less."""


Bound = Annotated[
    Annotated[Real, Tag("scalar")] | Annotated[WorstRunSection, Tag("each")],
    one_of(
        lambda value: "each" if isinstance(value, dict) else _rank(value),
        "a number (of the mean over runs) or {max: …} (of the worst run)",
    ),
]
"""What a metric must keep to."""


class ConfirmSection(Section):
    """The runs on which winners are judged; none of them takes part in the search."""

    runs: Count = 500
    """How many."""
    seed: int | None = Field(default=None, ge=0, lt=2**63)
    """Root of their random streams, another than `ensemble.seed`; default: one more than that."""


class TuneSection(Section):
    """What `eqt tune` chooses for each law, by what, and for how long it searches."""

    over: Annotated[dict[str, TunedAxis], Field(min_length=1)]
    """What is tuned, in `gains` and `controllers`, and between which values: `[low, high]`,
    `{log: [low, high]}`, or a range as of designs. Keys of an entry of `controllers` are that
    law's own; keys of `gains` are tuned for every law."""
    objective: str | None = None
    """The metric to be made best, in the mean over runs."""
    objectives: list[str] | None = None
    """Instead of it two metrics, of which the Pareto front is found."""
    subject_to: dict[str, Bound] = Field(default_factory=dict)
    """Bounds of metrics: a number bounds the mean over runs from the side that is worse,
    `{max: …}` or `{min: …}` the worst run."""
    budget: Count = 40
    """Generations; each law has the same number."""
    population: Annotated[int, Field(ge=5)] = 32
    """Points of a generation, each with `ensemble.runs` runs."""
    seed: CountOrNone = 0
    """Of the search."""
    confirm: ConfirmSection = Field(default_factory=ConfirmSection)
    """The held-out runs on which the winners and the starting gains are compared."""


class TargetSection(Section):
    """Where `task: stabilise` is to end."""

    pose: Any = "identity"
    """The target pose: identity, a matrix, or rotation and translations by name."""


class Config(Section):
    """An experiment: one mechanical system, one reference, several controllers, many runs."""

    name: str | None = Field(default=None, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    """Name of the experiment and of its folder under results/; default: the file's stem."""
    task: Literal["track", "stabilise"] = "track"
    """Follow a `reference`, or come to rest at a `target`."""
    group: str
    """The configuration space: SO3, SE3, … (`eqt list groups`)."""
    inertia: InertiaValue
    """Inertia tensor 𝕀: scalar, diagonal, m×m matrix, or varying in time."""
    rigid: bool | None = None
    """false: `inertia` is not a rigid body's (added mass, rotors, a mechanism), so that its
    principal moments may break the triangle inequality without a warning."""
    gains: GainsSection = Field(examples=["{kp: 1, kd: 1}"])
    """Gains of the control laws."""
    reference: dict[str, Any] | None = None
    """The desired trajectory: `kind` (default torque), its options, `pose` and `velocity`."""
    target: TargetSection | None = None
    """Where to come to rest, for `task: stabilise`."""
    controllers: list[Any] = Field(min_length=1)
    """Control laws to compare, from the same initial states (`eqt list controllers`)."""
    plant: PlantSection | None = None
    """Where what flies is not what the laws believe: `inertia`, and `forces`."""
    actuators: list[Any] | None = None
    """What a command passes on its way to the plant, in order (`eqt list actuators`)."""
    control: ControlSection | None = None
    """The clock of the laws: `period`, and `delay`."""
    sensors: SensorsSection | None = None
    """Errors of what the laws are told, at the instants of `control`."""
    initial: InitialSection = Field(default_factory=InitialSection)
    """Where the runs start."""
    ensemble: EnsembleSection = Field(default_factory=EnsembleSection)
    """How many runs."""
    time: TimeSection = Field(examples=["{duration: 20}"])
    """The horizon and its samples."""
    solver: dict[str, Any] = Field(default_factory=dict)
    """`engine` and its options (`eqt list engines`)."""
    store: StoreSection = Field(default_factory=StoreSection)
    """What to keep."""
    sweep: list[dict[str, Any]] | None = None
    """Blocks of `grid`, `zip`, `random`, `lhs`, `sobol` or `concat`, which multiply; for
    `eqt sweep`."""
    tune: TuneSection | None = None
    """What `eqt tune` searches for; every other command leaves it aside."""
    settling_threshold: Annotated[Positive, BeforeValidator(_distance_of_angle)] = 0.05
    """Pose error ‖I − Q_E‖_F below which a run counts as settled; also the angle of a rotation,
    such as 2 deg, which is the distance 2√2 sin(θ/2)."""
    early_window: Positive | None = None
    """How long the early part of a run is, for `early_torque`, s; default: 5, as in the paper."""
    closing_window: Annotated[float, Field(gt=0, le=1)] | None = None
    """The share of the time at its end over which `closing_pose_error` and `closing_torque` are
    taken; default: 0.25."""
    plugins: list[str] = Field(default_factory=list)
    """Python files with components of your own, relative to this file."""


DEFAULT_ENGINE = "solve_ivp"


@dataclass(frozen=True)
class Judgement:
    """The keys of `solver` that do not belong to an engine.

    Attributes
    ----------
    max_error
        Runs whose error estimate exceeds it count as failed.
    error_estimate
        Solve every run a second time at a tenth of the tolerance and compare. Default: where the
        engine makes that cheap.
    cross_check
        How many runs of each controller are redone by another engine and compared.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    max_error: Positive | None = None
    error_estimate: bool | None = None
    cross_check: CountOrNone = 3


FIXED = {
    "name": "names the experiment as a whole",
    "store": "decides what the common result file contains",
    "plugins": "is loaded once",
    "sweep": "cannot contain itself",
    "tune": "chooses its own points",
    "task": "decides which laws can be used",
}
"""Sections that all points share, and why."""
