"""The keys of a configuration: their types, defaults and meanings, as one tree.

A file is validated once, with its group as context, which decides units and options. What needs
several sections, or files, is checked by `eqt_cli.config.experiment`. The JSON schema, `eqt config
keys` and the reference pages come from the same tree.
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    Tag,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    create_model,
    field_validator,
)
from pydantic_core import core_schema

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import ComponentError, EqtWarning, InputError, Problems, parse_key
from eqt_cli.base.extensions import Extension, imported, usable
from eqt_cli.base.option_types import (
    DAMPING,
    INERTIA,
    POSE,
    STIFFNESS,
    VELOCITY,
    Angle,
    AsText,
    Constant,
    Count,
    CountOrTime,
    Duration,
    Kind,
    Matrix,
    Name,
    Offset,
    Positive,
    Real,
    Row,
    RunCount,
    Samples,
    Scale,
    Unit,
    as_section,
    has_unit,
    one_of,
    option_names,
    rank,
    seconds,
    shown,
    validated,
)
from eqt_cli.base.reporting import reporter
from eqt_cli.components.actuators import Actuator, actuators
from eqt_cli.components.estimators import Estimator, estimators
from eqt_cli.components.forces import Force, forces
from eqt_cli.components.initial_states import (
    PoseDistribution,
    PoseKind,
    VelocityDistribution,
    pose_distributions,
    velocity_distributions,
)
from eqt_cli.components.laws import Controller, controllers, gains_group
from eqt_cli.components.matrix_groups import distance_of_turn
from eqt_cli.components.mechanics import SETPOINTS, Setpoint
from eqt_cli.components.pose_notation import pose_from, vector
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.components.references import Reference, references
from eqt_cli.components.sensors import Sensor, sensors
from eqt_cli.components.tasks import Point
from eqt_cli.components.vehicle import INNER
from eqt_cli.components.vehicle_parts import Matrix as DrawnMatrix
from eqt_cli.components.vehicle_parts import Number, PartKind, periods_in
from eqt_cli.config.marks import (
    DESIRED,
    ON_GROUP,
    PLANT,
    SEARCH,
    SHAPES,
    STARTS,
    VEHICLE,
    WORDS,
    Mark,
    NotSwept,
    Section,
)
from eqt_cli.engines.choice import SolverKind
from eqt_cli.engines.engine import engines
from eqt_cli.loop.signals import Metric, metrics


def _weight_kind(value: Any) -> str | None:
    if not isinstance(value, list):
        return rank(value)
    kinds = {rank(entry) for entry in value}
    return "factors" if "matrix" in kinds or len(kinds) > 1 else rank(value)


Weight = Annotated[
    Constant | Annotated[list[Matrix], Tag("factors")],
    one_of(_weight_kind, "a number, a list (the diagonal) or a list of rows"),
]
"""A matrix, or for a product of groups a list with one matrix per factor."""


def _distance_of_angle(value: Any) -> Any:
    """‖I − R‖_F of a rotation by an angle that is written with its unit."""
    if not has_unit(value):
        return value
    angle: float = TypeAdapter(Angle).validate_python(value)
    return distance_of_turn(angle)


SettlingThreshold = Annotated[
    Annotated[Annotated[Positive, BeforeValidator(_distance_of_angle)], Tag("scalar")]
    | Annotated[dict[str, Positive], Unit(POSE), Field(min_length=1), Tag("parts")],
    one_of(
        lambda value: "parts" if isinstance(value, dict) else rank(value),
        "a number, an angle such as 2 deg, or {part: threshold, …}",
    ),
]
"""Bound of the pose error, or of its parts by name: angles of rotations, and distances."""


AnyForce = Annotated[Force, PartKind(forces)]
KnownForce = Annotated[AnyForce, WithJsonSchema({})]  # its keys are those of `plant.forces`
AnyActuator = Annotated[Actuator, PartKind(actuators)]


class _InnerKind(PartKind):
    """Marks a block that belongs to one law, as its firmware does: all runs have the same."""

    def checked(self, value: Any, problems: Problems, group: Any = None) -> Any:
        """Return the block; hardware, which all laws share, and numbers that are drawn are none."""
        block = super().checked(value, problems, group)
        if block is None or problems:
            return block
        if block.members or block.takes not in ("torque", "rates"):
            problems.add(f"{block.name} is hardware, which all laws share; move it to `actuators`")
        elif block.varies:
            problems.add(
                f"{block.name} has numbers that runs draw, and a law computes with the same ones "
                "in all runs; give its mean here, and draw numbers of parts in `actuators`"
            )
        return block


InnerBlock = Annotated[Actuator, _InnerKind(actuators)]


class _FeltKind(PartKind):
    """Marks an error of an accelerometer or of a depth, which is of the position alone."""

    def checked(self, value: Any, problems: Problems, group: Any = None) -> Any:
        """Return the sensor of the position, or of its last coordinate."""
        if getattr(group, "translation", None) and isinstance(value, dict):
            is_depth = self.measured == "depth"
            value = {"of": "depth" if is_depth else group.translation.name, **value}
        return super().checked(value, problems, group)


PoseSensor = Annotated[Sensor, PartKind(sensors)]
VelocitySensor = Annotated[Sensor, PartKind(sensors, VELOCITY)]
AnyEstimator = Annotated[Estimator | None, PartKind(estimators)]
AnyMetric = Annotated[Metric, Kind(metrics)]
StartPose = Annotated[PoseDistribution, PoseKind(pose_distributions)]
StartVelocity = Annotated[VelocityDistribution, Kind(velocity_distributions)]


@dataclass(frozen=True)
class LawEntry:
    """An entry of `controllers`.

    Attributes
    ----------
    law
        The law, checked unless it has files.
    label
        Its label, if it has one.
    gains
        Its own gains, if it has any.
    known_forces
        Whether it takes the forces of `model` into account.
    setpoint
        What it knows of the reference, of `SETPOINTS`.
    inner
        The blocks that its command passes before the actuators that all laws share.
    written
        The names of the options that are written.
    """

    law: Controller
    label: Any
    gains: "GainsSection | None"
    known_forces: bool
    setpoint: str
    inner: tuple[Actuator, ...]
    written: tuple[str, ...]


class LawKind(Kind):
    """An entry of `controllers`: a law, and what an entry says of it besides its options."""

    of_every_entry: ClassVar = ("label", "gains", "known_forces", "setpoint", INNER)
    """The keys that no law has for itself."""

    def checked(self, value: Any, problems: Problems, group: Any = None) -> LawEntry | None:
        """Return the entry; what needs files or other sections is checked later."""
        options = dict(value) if isinstance(value, dict) else {}
        label, gains = options.pop("label", None), options.pop("gains", None)
        known_forces = validated(
            bool, options.pop("known_forces", True), problems.at("known_forces")
        )
        setpoint = validated(Setpoint, options.pop("setpoint", "full"), problems.at("setpoint"))
        inner = validated(
            list[InnerBlock], options.pop(INNER, None) or [], problems.at(INNER), group=group
        )
        named = options if isinstance(value, dict) else value
        law: Controller | None = self.read(named, problems, group, self.of_every_entry)
        if law is not None and group is not None and not law.files:
            law.check(group, problems)
        if gains is not None:
            of = None if law is None or group is None else gains_group(law, group)
            gains = validated(GainsSection, gains, problems.at("gains"), group=of)
        if law is None:
            return None
        blocks = tuple(inner or ())
        return LawEntry(law, label, gains, known_forces, setpoint, blocks, tuple(options))

    def section(self, entry: LawEntry) -> dict[str, Any]:
        """Return the law with every option."""
        return as_section(entry.law)

    def mapping(self, component: Any, handler: Any, **more: Any) -> dict[str, Any]:
        """Return the JSON schema of a law with its options."""
        label = "The name of the law in tables and figures; its kind."
        gains = "Gains of this law, where they differ from the section `gains`."
        text = "Whether the law counteracts the forces of `model`; default: true."
        parts = "What it knows of the reference: pose, velocity, too, or all; default: full."
        inner = "Blocks of this law alone that its command passes before `actuators`, in order."
        section: Any = {**TypeAdapter(GainsSection).core_schema, "ref": GainsSection.__name__}
        shared = handler(core_schema.list_schema(section))["items"]  # of all laws, by its reference
        more = {
            "label": {"type": "string", "description": label},
            "gains": shared | {"description": gains},
            "known_forces": {"type": "boolean", "description": text},
            "setpoint": {"enum": list(SETPOINTS), "description": parts},
            INNER: {"description": inner},
        }
        return super().mapping(component, handler, **more)


DEFAULTS = {"pose": "identity", "velocity": 0.0}
"""Default Q_d(0) and V_d(0), for references that start from them."""


@dataclass(frozen=True)
class ReferenceEntry:
    """The section `reference`.

    Attributes
    ----------
    reference
        The reference, checked unless it has files.
    starts
        Q_d(0) and V_d(0) as they are written, of a reference that starts from them.
    pose, velocity
        The same as arrays.
    """

    reference: Reference
    starts: dict[str, Any]
    pose: Any
    velocity: Any


USUAL_REFERENCE = "torque"
"""The kind of a reference that has none; its only option has the same name."""


class ReferenceKind(Kind):
    """The section `reference`, whose kind is `USUAL_REFERENCE` by default."""

    def checked(self, value: Any, problems: Problems, group: Any = None) -> ReferenceEntry | None:
        """Return the reference and where it starts; its files are read later."""
        if not isinstance(value, dict):
            problems.add(f"expected a mapping, got {shown(value)}")
            return None
        if value and not value.keys() & {"kind", USUAL_REFERENCE}:
            fitting = (x for x in self.registry.all() if value.keys() <= {*option_names(x)})
            if meant := next(fitting, None):
                problems.at("kind").add(f"missing; these keys are those of kind: {meant.name}")
                return None
        name, kind = value.get("kind", USUAL_REFERENCE), None
        with suppress(InputError):
            kind = self.registry.get(self.registry.written(name)) if isinstance(name, str) else None
        takes = tuple(DEFAULTS) if kind is None else kind.starts_from
        has = (*takes, *(option_names(kind) if kind else ()))
        for key in (key for key in DEFAULTS if key in value and key not in has):
            problems.at(key).add(
                f"a reference of kind {name} determines its {key}; remove this key"
            )
            value = {name: entry for name, entry in value.items() if name != key}
        starts = {key: value.get(key, DEFAULTS[key]) for key in takes}
        options = {"kind": USUAL_REFERENCE} | {k: v for k, v in value.items() if k not in starts}
        reference = self.read(options, problems, group, takes)
        if group is None:
            return None
        if reference is not None and not reference.files:
            reference.check(group, problems)
        pose: Array | None = group.identity
        velocity: Array | None = np.zeros(group.dimension)
        if "pose" in starts:
            pose = pose_from(starts["pose"], group, problems.at("pose"))
        if "velocity" in starts:
            coordinates: Any = Annotated[Real | list[Real], Unit(VELOCITY)]
            here = problems.at("velocity")
            numbers = validated(coordinates, starts["velocity"], here, group=group)
            with here.catching():
                velocity = None if numbers is None else vector(numbers, group.dimension, group)
        return ReferenceEntry(reference, starts, pose, velocity)

    def section(self, entry: ReferenceEntry) -> dict[str, Any]:
        """Return the reference with every option."""
        return as_section(entry.reference)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        kinds = [self.mapping(kind, handler) for kind in self.registry.all()]
        for kind in kinds:
            if kind["properties"]["kind"]["const"] == USUAL_REFERENCE:
                kind["required"].remove("kind")
        return {"anyOf": kinds}

    def mapping(self, component: Any, handler: Any, **more: Any) -> dict[str, Any]:
        """Return the JSON schema of a reference with its options, and where it starts from."""
        common = {
            "pose": "Q_d(0): identity, a matrix, or rotation and translations by name.",
            "velocity": "V_d(0): a list in the body frame, or parts by name.",
        }
        start = {key: {"description": common[key]} for key in component.starts_from}
        return super().mapping(component, handler, **start)


AnyLaw = Annotated[Any, LawKind(controllers)]  # `LawEntry`
ReferenceSection = Annotated[Any | None, ReferenceKind(references)]  # `ReferenceEntry`
SolverSection = Annotated[Any, SolverKind(engines)]  # `Solver`


def _task_kind(value: Any) -> str | None:
    if isinstance(value, dict | Point):
        return "point"
    return "word" if value in ("track", "stabilise") else None


AnyTask = Annotated[
    Annotated[Literal["track", "stabilise"], Tag("word")] | Annotated[Point, Tag("point")],
    one_of(_task_kind, "track, stabilise or {kind: point, axis: [0, 0, 1], at: [1, 0, 0]}"),
]


KP, KD = Scale("k_p", STIFFNESS, is_symbol=True), Scale("k_d", DAMPING, is_symbol=True)


def _one_stiffness(value: Any) -> Any:
    """Refuse a k_R for each axis, and say which `kp` gives these stiffnesses."""
    if not isinstance(value, list):
        return value
    instead = "[κ_1, κ_2, κ_3]"
    if len(value) == 3 and all(isinstance(k, int | float) for k in value):
        a, b, c = value
        instead = str([round(k / 2, 12) for k in (b + c - a, c + a - b, a + b - c)])
    raise ValueError(
        f"expected a number, got {value}; where they differ, κ_1 = (k_R2 + k_R3 − k_R1)/2 and so "
        f"on: write kp: {instead}"
    )


class GainsSection(Section):
    """Gains of the control laws, or of one law, where it has others than the section `gains` says.

    Attributes
    ----------
    kp
        Navigation weight K of Υ(Q) = ½ tr((Q − I) K (Q − I)ᵀ): scalar, diagonal or d×d matrix; for
        a product of groups also a list with one of these per factor.
    kd
        Rayleigh tensor K_d, positive definite: scalar, diagonal or m×m matrix.
    k_R
        Instead of `kp`, for attitudes, the stiffness of Lee, Leok and McClamroch (2010): K = k_R/2
        times I.
    k_Omega
        Instead of `kd`, for attitudes, their damping: K_d = k_Omega times I.
    """

    kp: Annotated[Weight | None, KP] = None
    kd: Annotated[Matrix | None, KD] = None
    k_R: Annotated[
        Positive | None, Scale("k_R", STIFFNESS, is_symbol=True), BeforeValidator(_one_stiffness)
    ] = None
    k_Omega: Annotated[Positive | None, Scale("k_\\Omega", DAMPING, is_symbol=True)] = None


class InitialSection(Section):
    """Distributions of the initial state, relative to the reference's.

    Attributes
    ----------
    pose
        Q(0) = Q_d(0) · draw; for a product of groups also a list with one entry per factor.
    velocity
        V(0) = V_d(0) + draw.
    file
        Instead of both: a table of poses and velocities with a row for each run, or an earlier
        result, whose runs start there; relative to this file.
    relative
        Whether the poses and velocities in the file are relative to the reference's.
    mapping
        What the file does not say of itself, as `reference.mapping`: columns, units, order of
        quaternions, axes.
    """

    pose: StartPose = Field(default="fixed", validate_default=True)
    velocity: StartVelocity = Field(default="fixed", validate_default=True)
    file: str | None = None
    relative: bool = False
    mapping: LogMapping | None = None


class EnsembleSection(Section):
    """How many runs, from which seed.

    Attributes
    ----------
    runs
        Runs per law; as many as `initial.file` has rows, if there is one.
    seed
        Root of all random streams.
    """

    runs: RunCount = 1
    seed: Annotated[int, Scale("seed")] = Field(default=0, ge=0, lt=2**63)


class TimeSection(Section):
    """The uniform grid of sample times, both ends included.

    Attributes
    ----------
    duration
        Length of the horizon, s.
    samples
        Number of sample times.
    """

    duration: Annotated[Duration, Scale("horizon", "s")]
    samples: Samples = 401


class StoreSection(Section):
    """What goes into the result file.

    Attributes
    ----------
    trajectories
        Trajectories of all runs, of none, or of the first N runs per law.
    decimate
        Keep every n-th sample of the trajectories; metrics use all.
    compression
        gzip saves little on smooth signals and costs ten times the writing time.
    memory
        The memory and other numbers of the laws over time; `auto`: where they are at most 32.
    """

    trajectories: Literal["all", "none"] | Annotated[int, Field(ge=0)] = "all"
    decimate: Count = 1
    compression: Literal["none", "gzip"] = "none"
    memory: Literal["auto"] | bool = "auto"


class MeasureSection(Section):
    """The window of time over which metrics are taken.

    Settling, the early torque and the energy balance are of whole runs.

    Attributes
    ----------
    start
        Where it begins, s after the start of the runs; earlier samples do not count.
    stop
        Where it ends; default: at the end of the runs.
    """

    start: Offset = 0.0
    stop: Annotated[Positive | None, Unit("s")] = None


Formula = str | float
"""An expression in t, or a number."""


class FactoredInertiaSection(Section):
    """𝕀_t = S_tᵀ 𝕀_0 S_t, as in Theorem 3.2.

    Attributes
    ----------
    initial
        𝕀_0, symmetric positive definite.
    factor
        S_t, m×m expressions in t with S(0) = I.
    leaves
        As below.
    """

    initial: Annotated[Matrix, Unit(INERTIA)]
    factor: list[list[Formula]]
    leaves: bool | None = None


class PrescribedInertiaSection(Section):
    """𝕀_t as it is; the feedforward is then ½𝕀̇V.

    Attributes
    ----------
    matrix
        𝕀_t, m×m expressions in t, symmetric positive definite at all times.
    leaves
        Needed where a mass varies. true: mass leaves or joins at the velocity of the body, so that
        m v̇ = F, as in a rocket. false: it joins from rest, so that d(m v)/dt = F.
    """

    matrix: list[list[Formula]]
    leaves: bool | None = None


class AddedInertiaSection(Section):
    """The inertia of a body in a medium, in the two parts of which 𝕀 is the sum.

    Attributes
    ----------
    rigid
        Inertia of the body alone, symmetric positive definite.
    added
        The added mass, symmetric positive semidefinite; it moves with a `current`.
    """

    rigid: Annotated[Matrix, Unit(INERTIA)]
    added: Annotated[Matrix, Unit(INERTIA)]


def _one_mass(value: Any, info: ValidationInfo) -> Any:
    """Refuse a mass that runs draw, and write the inertia for which they can."""
    if not isinstance(value, dict | AsText):
        return value
    name = "mass" if isinstance(value, dict) else str(value)
    u = [f"{number:g}" for number in [*info.data.get("urdf", ()), *[0.0] * 6]]
    rows = [[u[k] for k in row] + ["0"] * 3 for row in ((0, 1, 2), (1, 3, 4), (2, 4, 5))]
    rows += [["0"] * axis + [name] + ["0"] * (5 - axis) for axis in (3, 4, 5)]
    is_diagonal = {u[1], u[2], u[4]} == {"0"}
    instead: list[Any] = [rows[k][k] for k in range(6)] if is_diagonal else rows
    draws = f"draws: {{mass: {shown(value)}}} and " if isinstance(value, dict) else ""
    raise ValueError(
        f"expected one number for all runs, got {shown(value) if draws else repr(name)}; write "
        f"{draws}plant.inertia: {instead}".replace("'", "")
    )


class UrdfInertiaSection(Section):
    """The inertia of a body in space as URDF and SDF write it, with the origin at its centre.

    Attributes
    ----------
    urdf
        ixx, ixy, ixz, iyy, iyz, izz; off the diagonal −∫xy dm, as in the matrix.
    mass
        The mass, on SE3.
    """

    urdf: Annotated[Row, Unit("kg m^2")]
    mass: Annotated[Positive | None, Unit("kg"), BeforeValidator(_one_mass)] = None


def _inertia_kind(value: Any) -> str | None:
    if isinstance(value, dict):
        if "urdf" in value:
            return "of urdf"
        if {"rigid", "added"} & set(value):
            return "of added"  # a tag that is no key, as steps of places are tags or keys
        if "matrix" in value:
            return "prescribed"
        return "factored" if {"initial", "factor"} & set(value) else None
    return rank(value)


_WithKeys = (
    Annotated[AddedInertiaSection, Tag("of added")]
    | Annotated[FactoredInertiaSection, Tag("factored")]
    | Annotated[PrescribedInertiaSection, Tag("prescribed")]
    | Annotated[UrdfInertiaSection, Tag("of urdf")]
)
_INERTIAS = (
    "a number, a list (the diagonal), a list of rows, or a mapping with `urdf`, with `rigid` and "
    "`added`, with `initial` and `factor`, or with `matrix`"
)
InertiaValue = Annotated[
    Annotated[Real, Unit(INERTIA), Tag("scalar")]
    | Annotated[Row, Unit(INERTIA), Tag("list")]
    | Annotated[list[Row], Unit(INERTIA), Tag("matrix")]
    | _WithKeys,
    one_of(_inertia_kind, _INERTIAS),
]
"""A constant tensor, or a mapping with expressions in t."""


class RelativeInertiaSection(Section):
    """(1 + r) 𝕀, of the 𝕀 that the laws believe.

    Attributes
    ----------
    relative
        r: 0.1 is 10 % more.
    """

    relative: Annotated[Number, Scale("relative error of the inertia")]


def _plant_inertia_kind(value: Any) -> str | None:
    if isinstance(value, dict) and "relative" in value:
        return "relative"
    if isinstance(value, dict) and ("uniform" in value or "normal" in value):
        return "constant"
    kind = _inertia_kind(value)
    return "constant" if kind in ("scalar", "list", "matrix") else kind


PlantInertia = Annotated[
    Annotated[DrawnMatrix, Unit(INERTIA), Tag("constant")]
    | Annotated[RelativeInertiaSection, Tag("relative")]
    | _WithKeys,
    one_of(_plant_inertia_kind, _INERTIAS),
]
"""As `InertiaValue`, or relative to it; constant numbers may be drawn for each run."""


def _known_kind(value: Any) -> str | None:
    return "list" if isinstance(value, list) else "text" if value == "plant" else None


KnownForces = Annotated[
    Annotated[Literal["plant"], Tag("text")] | Annotated[list[KnownForce], Tag("list")],
    one_of(_known_kind, "'plant' or a list"),
]


class ModelSection(Section):
    """What laws know of the plant, besides `inertia`.

    Attributes
    ----------
    forces
        Forces that they know (`eqt list forces`), or `plant` for those of `plant.forces`. Without
        `plant.forces`, these act. A law commands its torque less these forces, as they act on the
        body at rest; `known_forces: false` in its entry leaves them out.
    """

    forces: KnownForces | None = None


class PlantSection(Section):
    """The plant, where it differs from what the laws know.

    Attributes
    ----------
    inertia
        The true inertia: as `inertia`, or {relative: 0.1} for 10 % more than the laws believe.
    forces
        Forces in addition to the actuators (`eqt list forces`); default: those of `model`.
    """

    inertia: PlantInertia | None = None
    forces: list[AnyForce] | None = None


class ControlSection(Section):
    """The clock of the laws; without it they act continuously.

    The times of all clocks, of `sensors` and `actuators` too, are whole numbers of ticks.

    Attributes
    ----------
    period
        The laws are evaluated at t = offset + k·period, s, and their commands held in between.
    delay
        After how many whole periods a command arrives, or after which time, such as 20 ms; until
        the first one does, 0 is held.
    offset
        Time of the first evaluation, s.
    tick
        Time between two instants at which anything may act, s; default: the greatest common
        divisor of all periods, offsets and delays.
    """

    period: Annotated[Positive, Scale("control period", "s")]
    delay: Annotated[CountOrTime, Scale("delay of the command in periods")] = 0
    offset: Offset = 0.0
    tick: Annotated[Positive, Unit("s")] | None = None

    @field_validator("delay")
    @classmethod
    def _in_periods(cls, value: int | str, info: ValidationInfo) -> int | str:
        """Count whole periods; another time stays as it is written."""
        if isinstance(value, str) and "period" in info.data:
            with suppress(ValueError):
                return periods_in(seconds(value), info.data["period"])
        return value


class SensorsSection(Section):
    """Errors of the measured pose and velocity; each is a list whose entries add up.

    An entry with `of` is of one part. Entries of one part share `period`, `offset`, `delay` and
    `dropout`, given at one of them. Parts that no entry names are known exactly at every instant of
    the law.

    Attributes
    ----------
    pose
        Q_m = Q exp(n), with n in the coordinates of the algebra (`eqt list sensors`).
    velocity
        V_m = V + b (`eqt list sensors`).
    magnetometer
        B_m = B + b, likewise, in T: of the field of `magnetorquers` in the body.
    accelerometer
        a_m = a + b, likewise, in m/s²: of the acceleration less gravity, which a law may read.
    depth
        z_m = z + b, in m: of the last coordinate of the position, which `navigation` reads.
    """

    pose: list[PoseSensor] | None = None
    velocity: list[VelocitySensor] | None = None
    magnetometer: list[Annotated[Sensor, PartKind(sensors, "magnetometer")]] | None = None
    accelerometer: list[Annotated[Sensor, _FeltKind(sensors, "accelerometer")]] | None = None
    depth: list[Annotated[Sensor, _FeltKind(sensors, "depth")]] | None = None


class TargetSection(Section):
    """Pose at which `task: stabilise` ends.

    Attributes
    ----------
    pose
        The target pose: identity, a matrix, or rotation and translations by name.
    """

    pose: Any = "identity"


class Config(Section):
    """An experiment: one mechanical system, one reference, several controllers, many runs.

    Attributes
    ----------
    name
        Name of the experiment and of its folder under results/; default: the file's stem.
    task
        Follow a `reference`, come to rest at a `target`, or point an axis.
    group
        The configuration space: SO3, SE3, … (`eqt list groups`).
    inertia
        Inertia tensor 𝕀: scalar, diagonal, m×m matrix, a rigid and an added part, or varying in
        time.
    rigid
        false: `inertia` is not a rigid body's (added mass, rotors, a mechanism), so that its
        principal moments may break the triangle inequality without a warning.
    gains
        Gains of the control laws.
    reference
        The desired trajectory: `kind` (default torque), its options, `pose` and `velocity`.
    target
        Pose to come to rest at, for `task: stabilise`.
    model
        The forces that laws know, and counteract.
    controllers
        Control laws to compare, from the same initial states (`eqt list controllers`); each may
        have its own `label`, `gains`, `known_forces`, `setpoint` (`position`: it knows no
        derivatives of the reference; `velocity`: the first), and `inner`, the blocks of its
        firmware.
    plant
        The plant, where it differs from what the laws know: `inertia`, and `forces`.
    draws
        Numbers that each run draws, by names for the formulas of `plant`, `actuators`, `sensors`
        and `initial`: {W: {uniform: [2, 8]}, 'a, b': {normal: {mean: [0, 0], covariance: [[1, 0.5],
        [0.5, 1]]}}}, or {table: FILE}, a row for each run.
    actuators
        What a command passes on its way to the plant, in order (`eqt list actuators`).
    control
        The clock of the laws: `period`, `delay`, `offset`, and the `tick` of the loop.
    sensors
        Errors of the measured pose and velocity, at the instants of `control`.
    estimator
        The filter whose estimate the laws read (`eqt list estimators`).
    initial
        Initial states of the runs.
    ensemble
        How many runs.
    time
        The horizon and its samples.
    solver
        `engine` and its options (`eqt list engines`).
    store
        What to keep.
    sweep
        Blocks of `grid`, `zip`, `cases`, `random`, `lhs`, `sobol` or `concat`, which multiply; for
        `eqt sweep`. Further entries: `set` (keys that follow), `where` and `points` (which points
        count).
    settling_threshold
        Pose error ‖I − Q_E‖_F below which a run counts as settled; also the angle of a rotation,
        such as 2 deg, which is the distance 2√2 sin(θ/2). Or by the names of the group's parts, as
        {rotation: 5 deg, translation: 0.2}: the angle, and the distance ‖p − p_d‖; parts without a
        threshold do not count. Of the error of the angular velocity: {rate: 0.5 deg/s}.
    failed_when
        Where a run ends as failed: the largest size of errors, such as {position: 5 m, attitude: 90
        deg}. Also `pointing`, `heading`, `velocity`, `rate`, and any signal of one number by its
        name, `torque_norm_rotation`. A number without a unit is in m, rad, s, N, …
    measure
        The window of time over which metrics are taken, such as {start: 20 s}; default: whole runs.
    early_window
        How long the early part of a run is, for `early_torque`, s; default: 5, as in the paper.
    closing_window
        The share of the time at its end over which `closing_pose_error` and `closing_torque` are
        taken; default: 0.25.
    metrics
        Your own metrics, formulas of each run (`eqt list metrics`); default: all metrics that
        `plugins` define.
    plugins
        Python files with your own components, relative to this file.
    """

    name: Annotated[Name | None, NotSwept("names the experiment as a whole"), WORDS] = None
    task: Annotated[AnyTask, NotSwept("decides which laws can be used")] = "track"
    group: Annotated[str, SHAPES]
    inertia: Annotated[InertiaValue, ON_GROUP, PLANT, DESIRED]
    rigid: Annotated[bool | None, WORDS] = None
    gains: Annotated[GainsSection | None, ON_GROUP] = Field(
        default=None, examples=["{kp: 1, kd: 1}"]
    )
    reference: Annotated[ReferenceSection, ON_GROUP, STARTS, DESIRED] = None
    target: Annotated[TargetSection | None, ON_GROUP, STARTS, DESIRED] = None
    controllers: Annotated[list[AnyLaw], ON_GROUP] = Field(min_length=1)
    model: Annotated[ModelSection | None, ON_GROUP, VEHICLE] = None
    plant: Annotated[PlantSection | None, ON_GROUP, VEHICLE, PLANT] = None
    draws: Annotated[dict[str, Any] | None, ON_GROUP, VEHICLE, STARTS] = None
    actuators: Annotated[list[AnyActuator] | None, ON_GROUP, VEHICLE, PLANT] = None
    control: Annotated[ControlSection | None, ON_GROUP, VEHICLE] = None
    sensors: Annotated[SensorsSection | None, ON_GROUP, VEHICLE] = None
    estimator: Annotated[AnyEstimator, ON_GROUP, VEHICLE] = None
    initial: Annotated[InitialSection, ON_GROUP, STARTS] = Field(default_factory=InitialSection)
    ensemble: Annotated[EnsembleSection, STARTS] = Field(default_factory=EnsembleSection)
    time: Annotated[TimeSection, SHAPES] = Field(examples=["{duration: 20}"])
    solver: Annotated[SolverSection, DESIRED] = Field(default_factory=dict, validate_default=True)
    store: Annotated[StoreSection, NotSwept("decides what the common result file contains")] = (
        Field(default_factory=StoreSection.model_construct)
    )
    sweep: Annotated[list[dict[str, Any]] | None, NotSwept("cannot contain itself")] = None
    settling_threshold: Annotated[SettlingThreshold, ON_GROUP] = 0.05
    failed_when: Annotated[dict[str, Any] | None, ON_GROUP] = None
    measure: Annotated[MeasureSection | None, NotSwept("decides what a result contains")] = None
    early_window: Annotated[Positive | None, Unit("s")] = None
    closing_window: Annotated[float, Field(gt=0, le=1)] | None = None
    metrics: Annotated[list[AnyMetric] | None, NotSwept("decides what a result contains")] = None
    plugins: Annotated[list[str], NotSwept("is loaded once")] = Field(default=[])

    @property
    def known_forces(self) -> Any:
        """The forces of `model`, or `plant`; None where laws know none."""
        return None if self.model is None else self.model.forces


def with_keys_of(extensions: Iterable[Extension], core: type[Config] = Config) -> type[Config]:
    """Return the keys of the core, and those of extensions behind them.

    Of two extensions with one key, the second is left out with a remark, as is one of another
    distribution whose keys cannot be loaded.
    """
    owners, bases = dict.fromkeys(core.model_fields, "eqt"), [core]
    for extension in extensions:
        for place in extension.keys:
            try:
                keys = imported(place)
                for key in owners.keys() & keys.model_fields:
                    raise ComponentError(f"{owners[key]} has the key `{key}`, too")
            except Exception as error:
                name = extension.name
                message = (
                    f"extension '{name}': its keys are left out: {error}; change or uninstall it"
                )
                reporter().remark(EqtWarning(message))
            else:
                owners |= dict.fromkeys(keys.model_fields, f"extension '{extension.name}'")
                bases.append(keys)
    of_all: Any = create_model("Config", __base__=tuple(bases[::-1]), __module__=__name__)
    of_all.__doc__ = core.__doc__
    return of_all


if not TYPE_CHECKING:  # which knows the keys of eqt alone
    Config = with_keys_of(usable())


OF_EXTENSIONS = {"extends": "merging", "live": "live", "tune": "search", "worst": "search"}
OF_EXTENSIONS |= dict.fromkeys(("require", "windows"), "requirements") | {"validation": "flights"}
"""The extensions of eqt that have keys, by key."""


def without_absent(data: dict[str, Any], problems: Problems) -> dict[str, Any]:
    """Return a configuration without keys of extensions that are not installed; note these."""
    absent = [key for key in OF_EXTENSIONS if key in data and key not in Config.model_fields]
    for key in absent:
        problems.at(key).add(
            f"belongs to {OF_EXTENSIONS[key]}, which is not installed; install eqt again, or "
            "remove this key"
        )
    return {key: value for key, value in data.items() if key not in absent} if absent else data


def marked(mark: Mark) -> list[str]:
    """Return the keys of `Config` with a mark."""
    return [name for name, field in Config.model_fields.items() if mark in field.metadata]


def without_search(data: dict[str, Any]) -> dict[str, Any]:
    """Return a configuration without its sections for searches and sweeps."""
    return {key: value for key, value in data.items() if key not in (*marked(SEARCH), "sweep")}


def marks_of(key: str) -> list[Any]:
    """Return the marks of the section of a dotted key; none of an unknown one."""
    field = Config.model_fields.get(str(parse_key(key)[0]))
    return field.metadata if field else []


def not_swept(key: str) -> str:
    """Return why no sweep can change a key; empty where one can."""
    return next((mark.why for mark in marks_of(key) if isinstance(mark, NotSwept)), "")
