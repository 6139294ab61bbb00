"""The `inertia` section: a tensor, constant or varying in time, checked over the horizon."""

from collections.abc import Sequence

import numpy as np

from eqt_cli.config.schema import FactoredInertiaSection, PrescribedInertiaSection
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Problems
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.experiment import matrices
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import FactoredInertia, Inertia, InertiaLaw, PrescribedInertia
from eqt_cli.notation.poses import square

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
        matrices.require_symmetric(matrix)
        matrices.require_definite(matrix)
        return matrix
    return None


def _expressions(
    rows: Sequence[Sequence[str | float]], G: MatrixLieGroup, problems: Problems
) -> tuple[tuple[Expression, ...], ...] | None:
    with problems.catching():
        square([[0.0] * len(row) for row in rows], G.dimension, G)
    parsed: list[tuple[Expression, ...]] = []
    for i, row in enumerate(rows):
        found = []
        for j, entry in enumerate(row):
            with problems.catching(i, j):
                found.append(formula(entry))
        parsed.append(tuple(found))
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
    for t, matrix in zip(times, _matrices(law, times), strict=True):
        try:
            if not np.isfinite(matrix).all():
                i, j = np.argwhere(~np.isfinite(matrix))[0]
                got = f"got [{i}][{j}] = {matrix[i, j]:g}"
                raise InputError(f"expected finite entries, {got}")
            matrices.require_symmetric(matrix)
            matrices.require_definite(matrix)
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
    eigenvalues = np.linalg.eigvalsh(_matrices(law, times))
    smallest, largest = eigenvalues[:, 0], eigenvalues[:, -1]
    before, after = np.r_[smallest[1], smallest[:-1]], np.r_[smallest[1:], smallest[-2]]
    low = (smallest <= before) & (smallest <= after) & (smallest < SUSPECT * largest.max())
    low &= smallest < DIP * np.maximum(before, after)
    centre, reach = times[low], float(times[1] - times[0])
    scale = np.maximum(np.r_[0.0, largest[:-1]], np.r_[largest[1:], 0.0])[low]
    found = smallest[low]
    for _ in range(REFINEMENTS):
        finer = np.clip(centre[:, None] + reach * OFFSETS, times[0], times[-1])
        matrices = _matrices(law, finer.ravel())
        finite = np.isfinite(matrices).all(axis=(1, 2), keepdims=True)
        values = np.linalg.eigvalsh(np.where(finite, matrices, 0.0))[:, 0].reshape(finer.shape)
        best = np.arange(len(finer)), values.argmin(axis=1)
        centre, found = finer[best], values[best]
        reach *= OFFSETS[1] - OFFSETS[0]
    singular = np.flatnonzero(found <= SINGULAR * scale)
    return float(centre[singular[0]]) if len(singular) else None


def _matrices(law: InertiaLaw, times: Array) -> Array:
    with np.errstate(all="ignore"):
        found = law.matrix_at(times)
    return np.broadcast_to(found, (len(times), *found.shape[-2:]))
