"""The sections inertia, gains and reference: their values become arrays and a trajectory."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, Problems, parse_key
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.option_types import (
    VELOCITY,
    Kind,
    Real,
    Unit,
    as_section,
    option_names,
    validated,
)
from eqt_cli.components import mechanics
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.inertia import (
    OTHER_SIGN,
    FactoredInertia,
    Inertia,
    InertiaLaw,
    PrescribedInertia,
    matrices_at,
    with_other_products,
)
from eqt_cli.components.mechanics import Gains
from eqt_cli.components.motions import GivenOverTime
from eqt_cli.components.pose_notation import pose_from, square, vector
from eqt_cli.components.references import ConstantReference, Reference, references
from eqt_cli.config.schema import (
    AddedInertiaSection,
    FactoredInertiaSection,
    PrescribedInertiaSection,
    TargetSection,
)
from eqt_cli.config.source import ConfigSource, with_data

# The sections `gains` and `inertia`: checked matrices, and tensors that may vary in time ----------


def gains_from(section: dict[str, Any], G: MatrixLieGroup, problems: Problems) -> Gains | None:
    """Return the gains of a section, or None after noting its problems.

    Parameters
    ----------
    section
        The keys `kp` and `kd` that are present and have the right type.
    """
    K = K_d = None
    if "kp" in section:
        with problems.catching("kp"):
            K = _weight(section["kp"], G)
            require_symmetric(K)
            require_minimum(K, G)
    if "kd" in section:
        with problems.catching("kd"):
            K_d = square(section["kd"], G.dimension, G)
            require_definite(K_d)
    return None if K is None or K_d is None else Gains(K, K_d)


def _weight(value: Any, G: MatrixLieGroup) -> Array:
    """Return the d×d weight, from one matrix or from one for each factor."""
    if not isinstance(G, ProductGroup) or not isinstance(value, list):
        return square(value, G.size, G)
    if len(value) == G.size and len(value) != len(G.factors):
        return square(value, G.size, G)
    if len(value) != len(G.factors):
        expected = f"expected {len(G.factors)} entries, one per factor of {G.name}"
        raise InputError(f"{expected}, got {len(value)}")
    blocks = []
    for index, (entry, factor) in enumerate(zip(value, G.factors, strict=True)):
        try:
            blocks.append(square(entry, factor.size, factor))
        except InputError as error:
            raise InputError(f"entry {index}: {error}") from error
    from scipy.linalg import block_diag  # slow to import, and readers of results do not need it

    return block_diag(*blocks)


SYMMETRY_TOLERANCE = 1e-12
"""Largest asymmetry relative to the largest entry, due to decimal rounding."""


LARGEST = 1e100
"""Bound of the largest entry; its inverse is the lower bound. So products do not overflow."""


def require_symmetric(matrix: Array) -> None:
    """Raise an `InputError` with the entries in which a matrix is not symmetric."""
    difference = np.abs(matrix - matrix.T)
    if difference.max() > SYMMETRY_TOLERANCE * np.abs(matrix).max():
        i, j = np.unravel_index(difference.argmax(), matrix.shape)
        raise InputError(
            f"expected a symmetric matrix, got [{i}][{j}] = {matrix[i, j]:g} "
            f"but [{j}][{i}] = {matrix[j, i]:g}"
        )


def require_definite(matrix: Array) -> None:
    """Raise an `InputError` if the symmetric part of a matrix is not positive definite."""
    eigenvalues = _eigenvalues((matrix + matrix.T) / 2)
    if not _positive(eigenvalues):
        got = f"got eigenvalues {_listed(eigenvalues)}"
        raise InputError(f"expected a positive definite matrix, {got}")


def require_semidefinite(matrix: Array) -> None:
    """Raise an `InputError` if the symmetric part of a matrix has a negative eigenvalue."""
    eigenvalues = _eigenvalues((matrix + matrix.T) / 2)
    if eigenvalues.min() < -_rounding(eigenvalues):
        got = f"got eigenvalues {_listed(eigenvalues)}"
        raise InputError(f"expected a positive semidefinite matrix, {got}")


def require_minimum(K: Array, group: MatrixLieGroup) -> None:
    """Raise an `InputError` if Υ has no non-degenerate minimum at I."""
    eigenvalues = _eigenvalues(mechanics.hessian_at_identity(group, K))
    if not _positive(eigenvalues):
        raise InputError(
            f"must be positive, so that small errors on {group.name} have a positive stiffness (on "
            f"SO3: every sum of two eigenvalues); got the stiffness {_listed(eigenvalues)}"
        )


def _eigenvalues(matrix: Array) -> Array:
    """Return the eigenvalues of a symmetric matrix after checking its size.

    Raises
    ------
    InputError
        If squares of its entries, or of the entries of its inverse, may overflow.
    """
    size = float(np.abs(matrix).max())
    if size and not 1 / LARGEST <= size <= LARGEST:
        raise InputError(
            f"expected the largest entry to be from {1 / LARGEST:g} to {LARGEST:g}, got {size:g}; "
            "choose other units"
        )
    return np.linalg.eigvalsh(matrix)


def _positive(eigenvalues: Array) -> bool:
    """Whether all are greater than 0 by more than rounding, so that an inverse exists."""
    return bool(eigenvalues.min() > max(_rounding(eigenvalues), np.finfo(float).tiny))


def _listed(eigenvalues: Array) -> str:
    """List the eigenvalues, with 0 for those within rounding."""
    clean = np.where(np.abs(eigenvalues) <= _rounding(eigenvalues), 0.0, eigenvalues)
    return ", ".join(f"{value:.4g}" for value in clean)


def _rounding(eigenvalues: Array) -> float:
    """Return the rounding error of computed eigenvalues."""
    return float(len(eigenvalues) * np.finfo(float).eps * np.abs(eigenvalues).max())


INSTANTS = 1001
"""Number of instants of the horizon at which a time-varying inertia is checked."""

SUSPECT = 0.1
"""Ratio of smallest to largest eigenvalue below which the search also looks between instants."""

DIP = 0.9
"""Largest ratio of a minimum to a neighbour; ripples due to rounding exceed it."""

SINGULAR = 1e-12
"""Ratio to nearby eigenvalues below which an eigenvalue counts as 0; rounding is smaller."""

OFFSETS, REFINEMENTS = np.linspace(-1.0, 1.0, 41), 8
"""Offsets of a finer grid, and number of refinements, each 20 times as fine: down to 4e-11."""

IDENTITY_TOLERANCE = 1e-12
"""Largest deviation of S(0) from the identity: rounding of the expressions."""

Constant = float | list[float] | list[list[float]]


def inertia_from(
    section: Constant | AddedInertiaSection | FactoredInertiaSection | PrescribedInertiaSection,
    G: MatrixLieGroup,
    horizon: float,
    problems: Problems,
) -> InertiaLaw | None:
    """Return the inertia of a section, or None after noting its problems."""
    if isinstance(section, PrescribedInertiaSection):
        rows = _expressions(section.matrix, G, problems.at("matrix"))
        law: InertiaLaw | None = PrescribedInertia(rows) if rows else None
    elif isinstance(section, FactoredInertiaSection):
        law = _factored(section, G, problems)
    elif isinstance(section, AddedInertiaSection):
        rigid = _constant(section.rigid, G, problems.at("rigid"))
        with problems.catching("added"):
            added = square(section.added, G.dimension, G)
            require_symmetric(added)
            require_semidefinite(added)
            if rigid is not None:
                return Inertia(rigid + added, np.linalg.inv(rigid + added), added=added)
        return None
    else:
        matrix = _constant(section, G, problems)
        return None if matrix is None else Inertia(matrix, np.linalg.inv(matrix))
    if law is not None:
        with problems.catching():
            _require_definite(law, np.linspace(0.0, horizon, INSTANTS))
    return law


def _factored(
    section: FactoredInertiaSection, G: MatrixLieGroup, problems: Problems
) -> FactoredInertia | None:
    initial = _constant(section.initial, G, problems.at("initial"))
    rows = _expressions(section.factor, G, problems.at("factor"))
    if initial is None or not rows:
        return None
    law = FactoredInertia(initial, rows)
    with problems.catching("factor"):
        _require_identity(law)
        return law
    return None


def _constant(value: Constant, G: MatrixLieGroup, problems: Problems) -> Array | None:
    with problems.catching():
        matrix = square(value, G.dimension, G)
        require_symmetric(matrix)
        try:
            require_definite(matrix)
        except InputError as error:
            is_other = np.linalg.eigvalsh(with_other_products(G, matrix))[0] > 0
            raise InputError(f"{error}{OTHER_SIGN if is_other else ''}") from None
        return matrix
    return None


def _expressions(
    rows: Sequence[Sequence[str | float]], G: MatrixLieGroup, problems: Problems
) -> tuple[tuple[Expression, ...], ...] | None:
    with problems.catching():
        square([[0.0] * len(row) for row in rows], G.dimension, G)
    parsed: list[tuple[Expression, ...]] = []
    for i, row in enumerate(rows):
        entries = []
        for j, entry in enumerate(row):
            with problems.catching(i, j):
                entries.append(formula(entry))
        parsed.append(tuple(entries))
    return None if problems else tuple(parsed)


def _require_identity(law: FactoredInertia) -> None:
    """Raise an `InputError` if S(0) is not the identity."""
    with np.errstate(all="ignore"):
        start = law.factor_at(np.zeros(1)).reshape(law.initial.shape)
    deviation = np.abs(start - np.eye(len(start)))
    if not deviation.max() <= IDENTITY_TOLERANCE:
        i, j = np.unravel_index(deviation.argmax(), deviation.shape)
        raise InputError(f"expected the identity at t = 0, got [{i}][{j}] = {start[i, j]:g}")


def _require_definite(law: InertiaLaw, times: Array) -> None:
    """Raise an `InputError` with the time at which the inertia is not positive definite."""
    for t, matrix in zip(times, matrices_at(law, times), strict=True):
        try:
            if not np.isfinite(matrix).all():
                i, j = np.argwhere(~np.isfinite(matrix))[0]
                raise InputError(f"expected finite entries, got [{i}][{j}] = {matrix[i, j]:g}")
            require_symmetric(matrix)
            require_definite(matrix)
        except InputError as error:
            raise InputError(f"at t = {t:g} s: {error}") from error
    singular = _singular_between(law, times)
    if singular is not None:
        expected = "expected a positive definite matrix, got the eigenvalue 0"
        raise InputError(f"at t = {singular:.6g} s: {expected}")


def _singular_between(law: InertiaLaw, times: Array) -> float | None:
    """Return a time between the instants of a grid at which the inertia is singular, or None.

    S* 𝕀_0 S is never negative, and singular only when S is singular. So each local minimum of the
    smallest eigenvalue is searched on finer and finer grids.
    """
    eigenvalues = np.linalg.eigvalsh(matrices_at(law, times))
    smallest, largest = eigenvalues[:, 0], eigenvalues[:, -1]
    before, after = np.r_[smallest[1], smallest[:-1]], np.r_[smallest[1:], smallest[-2]]
    low = (smallest <= before) & (smallest <= after) & (smallest < SUSPECT * largest.max())
    low &= smallest < DIP * np.maximum(before, after)
    centre, reach = times[low], float(times[1] - times[0])
    scale = np.maximum(np.r_[0.0, largest[:-1]], np.r_[largest[1:], 0.0])[low]
    least = smallest[low]
    for _ in range(REFINEMENTS):
        finer = np.clip(centre[:, None] + reach * OFFSETS, times[0], times[-1])
        matrices = matrices_at(law, finer.ravel())
        finite = np.isfinite(matrices).all(axis=(1, 2), keepdims=True)
        values = np.linalg.eigvalsh(np.where(finite, matrices, 0.0))[:, 0].reshape(finer.shape)
        best = np.arange(len(finer)), values.argmin(axis=1)
        centre, least = finer[best], values[best]
        reach *= OFFSETS[1] - OFFSETS[0]
    singular = np.flatnonzero(least <= SINGULAR * scale)
    return float(centre[singular[0]]) if len(singular) else None


# The sections `reference` and `target`: the desired trajectory Q_d, V_d ---------------------------


DEFAULTS = {"pose": "identity", "velocity": 0.0}
"""Default Q_d(0) and V_d(0), for references that start from them."""


@dataclass(frozen=True)
class DesiredTrajectory:
    """The desired trajectory of the loop.

    Attributes
    ----------
    reference
        The reference.
    pose, velocity
        Q_d(0) and V_d(0).
    resolved
        The complete section of the configuration.
    files
        Contents of the files with data, by their names.
    """

    reference: Reference
    pose: Array
    velocity: Array
    resolved: dict[str, Any]
    files: dict[str, str] = field(default_factory=dict)


def desired_from(
    task: str | None,
    reference: dict[str, Any] | None,
    target: TargetSection | None,
    G: MatrixLieGroup | None,
    source: ConfigSource,
    problems: Problems,
) -> DesiredTrajectory | None:
    """Return the desired trajectory of a configuration, or None after noting its problems.

    Parameters
    ----------
    problems
        Problems of the whole configuration.
    """
    at_reference, at_target = problems.at("reference"), problems.at("target")
    if task == "stabilise":
        if reference is not None:
            at_reference.add("is a key of task: track; give a target for task: stabilise")
        return _rest(target or TargetSection(), G, at_target)
    if target is not None:
        at_target.add("is a key of task: stabilise; give a reference for task: track")
    if reference is None:
        if task == "track":
            at_reference.add("missing; task: track needs a reference to follow")
        return None
    return _tracked(reference, G, source, at_reference)


def _rest(
    target: TargetSection, G: MatrixLieGroup | None, problems: Problems
) -> DesiredTrajectory | None:
    """Return the target pose, at rest for all times."""
    if G is None or (pose := pose_from(target.pose, G, problems.at("pose"))) is None:
        return None
    section = {"target": {"pose": _as_floats(target.pose)}}
    return DesiredTrajectory(ConstantReference(target.pose), pose, np.zeros(G.dimension), section)


def _tracked(
    section: dict[str, Any], G: MatrixLieGroup | None, source: ConfigSource, problems: Problems
) -> DesiredTrajectory | None:
    name, kind = section.get("kind", "torque"), None
    with suppress(InputError):
        kind = references.get(name) if isinstance(name, str) else None
    takes = tuple(DEFAULTS) if kind is None else kind.starts_from
    option_keys = [] if kind is None else option_names(kind)
    for key in (key for key in DEFAULTS if key in section and key not in (*takes, *option_keys)):
        problems.at(key).add(f"a reference of kind {name} determines its {key}; remove this key")
        section = {name: value for name, value in section.items() if name != key}
    common = {key: section.get(key, DEFAULTS[key]) for key in takes}
    options = {"kind": "torque"} | {k: v for k, v in section.items() if k not in common}
    reference = Kind(references).read(options, problems, G, takes)
    if G is None:
        return None
    texts: dict[str, str] = {}
    if reference is not None:
        reference, texts = with_data(reference, source, problems)
        reference.check(G, problems)
    pose, velocity = G.identity, np.zeros(G.dimension)
    if "pose" in common:
        written_pose = pose_from(common["pose"], G, problems.at("pose"))
        pose = pose if written_pose is None else written_pose
    if "velocity" in common:
        coordinates: Any = Annotated[Real | list[Real], Unit(VELOCITY)]
        numbers = validated(coordinates, common["velocity"], problems.at("velocity"), group=G)
        if numbers is not None:
            with problems.catching("velocity"):
                velocity = vector(numbers, G.dimension, G)
    if reference is None or problems:
        return None
    described = as_section(reference) | common
    poses = {key: _as_floats(described[key]) for key in DEFAULTS if key in described}
    described = {"reference": described | poses}
    pose, velocity = reference.initial(G, pose, velocity)
    return DesiredTrajectory(reference, pose, velocity, described, texts)


def check_horizon(
    data: GivenOverTime, key: str, G: MatrixLieGroup, duration: float, problems: Problems
) -> None:
    """Note runs that start before the data of a key over time, outlast them, or meet a gap."""
    here, (first, last) = problems.at(*parse_key(key)), data.ends(G)
    if first > 0:
        here.add(f"begins at {first:g} s, but runs begin at 0 s; shift its times")
    if last < duration:
        what = key if key == "reference" else f"recording of {key}"
        problems.at("time", "duration").add(
            f"expected at most {last:g} s, the end of the {what}, got {duration:g}"
        )
    within = [gap for gap in data.gaps(G) if gap[0] < duration and sum(gap) > 0]
    for begin, length in within[:1]:
        here.add(
            f"has a gap of {length:.4g} s after t = {begin:.6g} s, within the run; end the run "
            f"there, `time: {{duration: {begin:.6g}}}`, or begin after it, `mapping: {{time: "
            "{begin: …, offset: first}}`"
        )


def _as_floats(value: Any) -> Any:
    """Convert integers to floats, so that 0 and 0.0 describe the same experiment."""
    if isinstance(value, dict):
        return {key: _as_floats(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_as_floats(entry) for entry in value]
    return float(value) if isinstance(value, int) else value
