"""The `inertia` section: a tensor, constant or varying in time, checked over the horizon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import Expression, parse
from eqt_cli.experiment import tensors
from eqt_cli.experiment.problems import Path, Problems
from eqt_cli.experiment.schema import FactoredInertiaSection, PrescribedInertiaSection
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import FactoredInertia, Inertia, InertiaLaw, PrescribedInertia

INSTANTS = 1001
"""How many instants of the horizon a time-varying inertia is checked at."""

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
    with np.errstate(all="ignore"):
        found = law.matrix_at(times)
        matrices = np.broadcast_to(found, (INSTANTS, *found.shape[-2:]))
    for t, matrix in zip(times, matrices, strict=True):
        if not np.isfinite(matrix).all():
            i, j = np.argwhere(~np.isfinite(matrix))[0]
            got = f"got [{i}][{j}] = {matrix[i, j]:g}"
            problems.add(("inertia",), f"at t = {t:g} s: expected finite entries, {got}")
            return False
        wrong = tensors.asymmetry(matrix) or tensors.indefiniteness(matrix)
        if wrong:
            problems.add(("inertia",), f"at t = {t:g} s: {wrong}")
            return False
    return True
