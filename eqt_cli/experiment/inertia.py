"""The `inertia` section: a tensor, constant or varying in time, checked over the horizon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eqt_cli.config.problems import Path, Problems
from eqt_cli.config.schema import FactoredInertiaSection, PrescribedInertiaSection
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import Expression, parse
from eqt_cli.experiment import tensors
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import FactoredInertia, Inertia, InertiaLaw, PrescribedInertia

INSTANTS = 1001
"""How many instants of the horizon a time-varying inertia is checked at."""

SUSPECT = 0.1
"""Eigenvalues this small, over the largest, are looked at between the instants, too."""

DIP = 0.9
"""A minimum is this far below a neighbour; ripples of rounding are not."""

SINGULAR = 1e-12
"""An eigenvalue this small, over those nearby, is zero; rounding leaves less of a zero."""

OFFSETS, REFINEMENTS = np.linspace(-1.0, 1.0, 41), 8
"""A finer grid, and how often there is one, each 20 times as fine: at last 4e-11 of an interval."""

IDENTITY_TOLERANCE = 1e-12
"""Largest deviation of S(0) from the identity: rounding of the expressions."""

Constant = float | list[float] | list[list[float]]
Section = Constant | FactoredInertiaSection | PrescribedInertiaSection


def inertia_from(
    section: Section, G: MatrixLieGroup, horizon: float, problems: Problems
) -> InertiaLaw | None:
    """The inertia that a section describes, or None after noting what is wrong with it."""
    if isinstance(section, PrescribedInertiaSection):
        law: InertiaLaw | None = _prescribed(section, G, problems)
    elif isinstance(section, FactoredInertiaSection):
        law = _factored(section, G, problems)
    else:
        matrix = _constant(section, G, ("inertia",), problems)
        return None if matrix is None else Inertia(matrix, np.linalg.inv(matrix))
    return law if law and _definite(law, horizon, problems) else None


def _prescribed(
    section: PrescribedInertiaSection, G: MatrixLieGroup, problems: Problems
) -> PrescribedInertia | None:
    rows = _expressions(section.matrix, G, ("inertia", "matrix"), problems)
    return PrescribedInertia(rows) if rows else None


def _factored(
    section: FactoredInertiaSection, G: MatrixLieGroup, problems: Problems
) -> FactoredInertia | None:
    initial = _constant(section.initial, G, ("inertia", "initial"), problems)
    rows = _expressions(section.factor, G, ("inertia", "factor"), problems)
    if initial is None or not rows:
        return None
    law = FactoredInertia(initial, rows)
    return law if _starts_at_identity(law, problems) else None


def _constant(
    value: Constant,
    G: MatrixLieGroup,
    path: Path,
    problems: Problems,
) -> Array | None:
    matrix = tensors.square(value, G.dimension, G)
    if isinstance(matrix, str):
        problems.add(path, matrix)
        return None
    wrong = tensors.asymmetry(matrix) or tensors.indefiniteness(matrix)
    if wrong:
        problems.add(path, wrong)
        return None
    return matrix


def _expressions(
    rows: Sequence[Sequence[str | float]], G: MatrixLieGroup, path: Path, problems: Problems
) -> tuple[tuple[Expression, ...], ...] | None:
    before = len(problems)
    shape = tensors.square([[0.0] * len(row) for row in rows], G.dimension, G)
    if isinstance(shape, str):
        problems.add(path, shape)
    parsed = []
    for i, row in enumerate(rows):
        for j, text in enumerate(row):
            try:
                parsed.append(parse(str(text)))
            except ExpressionError as error:
                problems.add((*path, i, j), f"'{text}': {error}")
    if len(problems) > before:
        return None
    m = G.dimension
    return tuple(tuple(parsed[m * row : m * (row + 1)]) for row in range(m))


def _starts_at_identity(law: FactoredInertia, problems: Problems) -> bool:
    with np.errstate(all="ignore"):
        start = law.factor_at(np.zeros(1)).reshape(law.initial.shape)
    deviation = np.abs(start - np.eye(len(start)))
    if deviation.max() <= IDENTITY_TOLERANCE:
        return True
    i, j = np.unravel_index(deviation.argmax(), deviation.shape)
    expected = f"expected the identity at t = 0, got [{i}][{j}] = {start[i, j]:g}"
    problems.add(("inertia", "factor"), expected)
    return False


def _definite(law: InertiaLaw, horizon: float, problems: Problems) -> bool:
    times = np.linspace(0.0, horizon, INSTANTS)
    wrong = _first_wrong(law, times) or _singular_between(law, times)
    if wrong:
        problems.add(("inertia",), wrong)
    return wrong is None


def _first_wrong(law: InertiaLaw, times: Array) -> str | None:
    """What is wrong with the inertia at the first of some instants at which something is."""
    for t, matrix in zip(times, _matrices(law, times), strict=True):
        if not np.isfinite(matrix).all():
            i, j = np.argwhere(~np.isfinite(matrix))[0]
            got = f"got [{i}][{j}] = {matrix[i, j]:g}"
            return f"at t = {t:g} s: expected finite entries, {got}"
        wrong = tensors.asymmetry(matrix) or tensors.indefiniteness(matrix)
        if wrong:
            return f"at t = {t:g} s: {wrong}"
    return None


def _singular_between(law: InertiaLaw, times: Array) -> str | None:
    """Where the inertia is singular between instants of a grid at all of which it is definite.

    S* 𝕀_0 S is nowhere negative, and zero only for the instants at which S is singular. Each local
    minimum of the smallest eigenvalue is searched on ever finer grids.
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
    if not len(singular):
        return None
    t = centre[singular[0]]
    return f"at t = {t:.6g} s: expected a positive definite matrix, got the eigenvalue 0"


def _matrices(law: InertiaLaw, times: Array) -> Array:
    with np.errstate(all="ignore"):
        found = law.matrix_at(times)
    return np.broadcast_to(found, (len(times), *found.shape[-2:]))
