"""The error dynamics of the documentation on SO(3) as plain formulas, in floats or fractions."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

J = np.array([[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]])
INERTIA = [[Fraction(str(x)) for x in row] for row in J.tolist()]
K, K_D = 1.0, 0.5
POINTS = {
    "eqt": (1.0, 1.0, 0.0),
    "gt": (0.5, 0.5, 0.5),
    "nog": (0.0, 1.0, 0.0),
    "asym": (1.0, 0.5, 0.5),
}
"""The paper's inertia and gains, and the weights (g, c, n)."""


def cross(a: Any, b: Any) -> Any:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def forces(label: str, e: Any, w: Any, wd: Any, J: Any = J) -> Any:
    """𝕀ω̃̇ of the documentation, with e = sin θ n."""
    g, c, n = (type(w[0])(k) if isinstance(w[0], Fraction) else k for k in POINTS[label])
    k, k_d = (Fraction(1), Fraction(1, 2)) if isinstance(w[0], Fraction) else (K, K_D)
    return (
        -2 * k * e
        - k_d * w
        + cross(J @ w, w)
        - (1 - g) * cross(w, J @ wd)
        - (1 - c) * cross(wd, J @ w)
        + n * (J @ cross(w, wd))
    )


def fractions(rows: Sequence[Sequence[str]]) -> Any:
    return np.array([[Fraction(x) for x in row] for row in rows], dtype=object)


def exact_A(label: str, wd: Sequence[Fraction]) -> tuple[Any, Any]:
    """A and B in fractions: the formulas at unit vectors, without the cubic term."""
    inertia, at = np.array(INERTIA, dtype=object), np.array(wd, dtype=object)
    a, b, c = inertia
    inverse = np.array([cross(b, c), cross(c, a), cross(a, b)]).T / (a @ cross(b, c))
    columns = []
    for x in np.array([[Fraction(i == j) for j in range(6)] for i in range(6)], dtype=object):
        e, w = x[:3], x[3:]
        force = forces(label, e, w, at, inertia) - cross(inertia @ w, w)
        columns.append([*(w + cross(e, at)), *(inverse @ force)])
    return np.array(columns).T, np.concatenate([0 * inverse, inverse])


def is_definite(M: Any) -> bool:
    """By elimination on lists of fractions."""
    rows = [list(row) for row in M]
    while rows:
        first, *rest = rows
        if first[0] <= 0:
            return False
        rows = [
            [b - row[0] * a / first[0] for a, b in zip(first[1:], row[1:], strict=True)]
            for row in rest
        ]
    return True
