"""The sections gains and inertia: checked matrices, and tensors that may vary in time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.base.expressions import Expression, formula
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
from eqt_cli.components.pose_notation import square
from eqt_cli.config import schema
from eqt_cli.numbers.rounded import inverse


def gains_from(section: Any, G: MatrixLieGroup, problems: Problems, of: Any = ()) -> Gains | None:
    """Return the gains of a section, or None after noting its problems.

    Parameters
    ----------
    section
        The keys `kp` and `kd` that are present and have the right type.
    of
        Of `task: point`, the axis in the frames of K and of K_d.
    """
    K = K_d = None
    if "kp" in section:
        with problems.catching("kp"):
            K = _weight(section["kp"], G)
            require_symmetric(K)
            if of:
                K = _of_axis(K, np.array(of[0]), isinstance(section["kp"], list))
            elif not _positive(stiffness := _eigenvalues(mechanics.hessian_at_identity(G, K))):
                # Υ has no non-degenerate minimum at I
                raise InputError(
                    f"must be positive, got {_written(section['kp'])}, else small errors do not "
                    f"decay: it gives them the stiffness {_listed(stiffness)} (on SO3, sums of two "
                    "eigenvalues)"
                )
    if "kd" in section:
        with problems.catching("kd"):
            K_d = square(section["kd"], G.dimension, G)
            c, size = np.array(of[1] if of else np.zeros(G.dimension)), np.abs(K_d).max()
            is_left = np.abs((K_d + K_d.T) @ c).max() <= 1e-9 * size
            or_free = f", or 0 along ({_listed(c)}) in the law's frame" if of else ""
            require_definite(K_d + is_left * size * np.outer(c, c), or_free)
    return None if K is None or K_d is None else Gains(K, K_d)


def _of_axis(K: Array, c: Array, is_matrix: bool) -> Array:
    """Return the weight k c cᵀ of a number k, or of itself."""
    weight = (c @ K @ c) * np.outer(c, c)
    if not c @ K @ c > 0 or (is_matrix and np.abs(K - weight).max() > 1e-9 * np.abs(K).max()):
        got = f"got eigenvalues {_listed(_eigenvalues(K))}"
        raise InputError(f"expected k > 0, or k c cᵀ with c = ({_listed(c)}) in its frame, {got}")
    return weight


OF_ATTITUDES = {"k_R": ("kp", 0.5), "k_Omega": ("kd", 1.0)}
"""Gains of attitudes as papers write them, each with the gain that it gives, and its factor."""


def kp_and_kd(
    section: schema.GainsSection | None, G: MatrixLieGroup, problems: Problems
) -> dict[str, Any]:
    """Return the gains of a section as `kp` and `kd`, after noting what cannot be both."""
    gains = {key: value for key, value in section or () if value is not None}
    for name in (name for name in OF_ATTITUDES if name in gains):
        value, (gain, factor) = gains.pop(name), OF_ATTITUDES[name]
        if gain in gains:
            problems.at(name).add(f"gives {gain}, which is given as well; remove one of the two")
        elif not all(part.turns for part in G.parts):
            problems.at(name).add(f"is a gain of attitudes alone, got {G.name}; give {gain}")
        else:
            gains[gain] = factor * value
    return gains


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


def require_definite(matrix: Array, also: str = "", semi: str = "", hint: str = "") -> None:
    """Raise an `InputError` if a matrix is not positive definite, or not ``semi``definite.

    Its symmetric part counts.
    """
    eigenvalues = _eigenvalues((matrix + matrix.T) / 2)
    if not (eigenvalues.min() >= -_rounding(eigenvalues) if semi else _positive(eigenvalues)):
        got = f"got eigenvalues {_listed(eigenvalues)}"
        raise InputError(f"expected a positive {semi}definite matrix{also}, {got}{hint}")


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


def _written(gain: Any) -> str:
    """Return a number, a diagonal or a matrix as it may stand in a configuration."""
    return f"[{', '.join(map(_written, gain))}]" if isinstance(gain, list) else f"{gain:g}"


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

JUMP = 1e-5
"""Share of the velocity by which run and body differ behind a jump of an inertia; what changes
within 2e-9 of the horizon without one is less."""

Constant = float | list[float] | list[list[float]]


def inertia_from(
    section: Any, G: MatrixLieGroup, horizon: float, problems: Problems
) -> InertiaLaw | None:
    """Return the inertia of a section, or None after noting its problems."""
    if isinstance(section, schema.UrdfInertiaSection):
        with problems.catching():
            return inertia_from(_of_urdf(section, G), G, horizon, problems)
        return None
    if isinstance(section, schema.PrescribedInertiaSection):
        rows = _expressions(section.matrix, G, problems.at("matrix"))
        law: InertiaLaw | None = PrescribedInertia(rows, section.leaves is True) if rows else None
    elif isinstance(section, schema.FactoredInertiaSection):
        law = _factored(section, G, problems)
    elif isinstance(section, schema.AddedInertiaSection):
        rigid = _constant(section.rigid, G, problems.at("rigid"))
        with problems.catching("added"):
            added = square(section.added, G.dimension, G)
            require_symmetric(added)
            require_definite(added, semi="semi", hint=_of_fossen(added))
            if rigid is not None:
                return Inertia(rigid + added, inverse(rigid + added), added=added)
        return None
    else:
        matrix = _constant(section, G, problems)
        return None if matrix is None else Inertia(matrix, inverse(matrix))
    if law is not None:
        with problems.catching():
            _require_definite(law, np.linspace(0.0, horizon, INSTANTS))
            if section.leaves is None:
                _require_constant_mass(law, G, np.linspace(0.0, horizon, INSTANTS))
    return law


def _of_fossen(added: Array) -> str:
    """Return the cure for an added mass with the sign of Fossen's derivatives; "" for others."""
    if not np.linalg.eigvalsh(-added)[0] >= 0:
        return ""
    return (
        "; Fossen's derivatives, as X_u̇ = −5.5 kg, are the negative of the added mass: write them "
        "without their sign"
    )


def _too_large_product(matrix: Array) -> str:
    """Name a product of inertia that no body with these moments has; "" if there is none."""
    moments = np.diag(matrix)
    most = np.sqrt(np.maximum(np.outer(moments, moments), 0.0)) + np.diag(
        np.full(len(moments), np.inf)
    )
    share = np.abs(matrix) / np.where(most > 0, most, np.inf)
    i, j = sorted(np.unravel_index(share.argmax(), share.shape))
    if not (moments.min() > 0 and share[i, j] >= 1):
        return ""
    return (
        f"; the product [{i}][{j}] = {matrix[i, j]:g} is too large for its moments: it must be "
        f"less than √({moments[i]:g} · {moments[j]:g}) = {most[i, j]:.3g}"
    )


BODY = [(slice(0, 3), True), (slice(3, 6), False)]
"""The axes of a rotation in space, which turns, and of a translation."""


def _of_urdf(section: schema.UrdfInertiaSection, G: MatrixLieGroup) -> list[list[float]]:
    """Return the tensor of a body in space."""
    parts = [(part.axes, bool(part.turns)) for part in G.parts]
    if parts not in (BODY[:1], BODY):
        raise InputError(f"`urdf` is the inertia of a body on SO3 or SE3, not on {G.name}")
    if (section.mass is None) == (parts == BODY):
        raise InputError("expected `mass` on SE3, and none on SO3")
    if len(section.urdf) != 6:
        raise InputError(f"urdf: expected ixx, ixy, ixz, iyy, iyz, izz, got {section.urdf}")
    matrix = np.eye(G.dimension) * (section.mass or 0.0)
    rows = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])  # the upper triangle
    matrix[rows] = matrix[rows[::-1]] = section.urdf
    return matrix.tolist()


def _factored(
    section: schema.FactoredInertiaSection, G: MatrixLieGroup, problems: Problems
) -> FactoredInertia | None:
    initial = _constant(section.initial, G, problems.at("initial"))
    rows = _expressions(section.factor, G, problems.at("factor"))
    if initial is None or not rows:
        return None
    law = FactoredInertia(initial, rows, section.leaves is True)
    with np.errstate(all="ignore"):
        start = law.factor_at(np.zeros(1)).reshape(initial.shape)
    deviation = np.abs(start - np.eye(len(start)))
    if deviation.max() <= IDENTITY_TOLERANCE:
        return law
    i, j = np.unravel_index(deviation.argmax(), deviation.shape)
    problems.at("factor").add(f"expected the identity at t = 0, got [{i}][{j}] = {start[i, j]:g}")
    return None


SIX = "; write six numbers of a URDF or SDF as {urdf: [ixx, ixy, ixz, iyy, iyz, izz]}"


def _constant(value: Constant, G: MatrixLieGroup, problems: Problems) -> Array | None:
    with problems.catching():
        hint = SIX if isinstance(value, list) and len(value) == 6 and np.isscalar(value[0]) else ""
        try:
            matrix = square(value, G.dimension, G)
            require_symmetric(matrix)
            if not hint and np.linalg.eigvalsh(with_other_products(G, matrix))[0] > 0:
                hint = OTHER_SIGN
            hint = hint or _too_large_product(matrix)
            require_definite(matrix)
        except InputError as error:
            raise InputError(f"{error}{hint}") from None
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


def _require_constant_mass(law: InertiaLaw, G: MatrixLieGroup, times: Array) -> None:
    """Raise an `InputError` with both meanings of a mass that varies."""
    matrices = matrices_at(law, times)
    for masses in (matrices[:, part.axes, part.axes] for part in G.parts if not part.turns):
        change = np.abs(masses - masses[0]).max(axis=(1, 2))
        # Products such as those of a factor round.
        if change.max() > IDENTITY_TOLERANCE * np.abs(masses[0]).max():
            k = change.argmax()
            i, j = np.unravel_index(np.abs(masses[k] - masses[0]).argmax(), masses[0].shape)
            raise InputError(
                f"expected a constant mass, got {masses[0, i, j]:g} at t = 0 s and "
                f"{masses[k, i, j]:g} at t = {times[k]:g} s; add `leaves: true` if mass leaves or "
                "joins at the velocity of the body, so that m dv/dt = F, as in a rocket, or "
                "`leaves: false` if the momentum is kept, so that d(m v)/dt = F, as where mass "
                "joins from rest"
            )


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
