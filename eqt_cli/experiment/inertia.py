"""The sections `gains` and `inertia`: checked matrices, and tensors that may vary in time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eqt_cli.config.schema import FactoredInertiaSection, PrescribedInertiaSection
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Problems
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.mechanics import navigation
from eqt_cli.mechanics.inertia import (
    FactoredInertia,
    Inertia,
    InertiaLaw,
    PrescribedInertia,
    matrices_at,
)
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.notation.poses import square


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


def require_minimum(K: Array, group: MatrixLieGroup) -> None:
    """Raise an `InputError` if Υ has no non-degenerate minimum at I."""
    eigenvalues = _eigenvalues(navigation.hessian_at_identity(group, K))
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
    section: Constant | FactoredInertiaSection | PrescribedInertiaSection,
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
        require_definite(matrix)
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
