"""Allocation: which thrusts, or speeds of wheels, give a command."""

from collections.abc import Iterator, Sequence

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.numbers.rounded import pseudo_inverse

SMALLEST = 1e-10
"""Largest singular value of B, relative to the largest of all, that counts as 0."""

ALL = 0.995
"""Share of a torque from which on all of it arrives."""

FAINT = 1e-6
"""Norm of a row of B, relative to the largest, that digits of the thrusters' directions explain."""


def row_norms(B: Array) -> Array:
    """Return the norms of the rows, ``(m, 1)``; 1 for rows that are `FAINT` beside the largest."""
    largest = np.maximum(np.abs(B).max(axis=1, keepdims=True), np.finfo(float).tiny)
    norms: Array = largest * np.linalg.norm(B / largest, axis=1, keepdims=True)  # none overflows
    return np.where(norms > FAINT * norms.max(), norms, 1.0)


def allocation(B: Array, least: float, scale: Array) -> tuple[Array, Array | None]:
    """Return B⁺ without weak directions, and the commands that pass through it; None for all.

    A direction is weak where a singular value of B, with rows divided by their norms, is below
    `least` of the largest. The sum of squares of u/scale is least.
    """
    norms = row_norms(B)
    U, sizes, _ = np.linalg.svd(B / norms, full_matrices=False)
    strong = sizes >= least * sizes[0]
    if not (~strong & (sizes > SMALLEST * sizes[0])).any():
        return scale[:, None] * pseudo_inverse(B * scale, int(strong.sum())), None
    row_space = U[:, strong].T / norms[:, 0]
    inverse = scale[:, None] * np.linalg.pinv(row_space @ B * scale) @ row_space
    return inverse, B @ inverse


def lost_directions(
    G: MatrixLieGroup, wanted: Array, B: Array, least: float, actuators: str, is_told: bool = True
) -> Iterator[str]:
    """Yield remarks on the wanted directions, ``(k, m)``, in which little or nothing pushes.

    An allocation that is told B gives these up; one by other numbers asks for them in vain.
    """
    lost, weak = unreachable(B), unreachable(B, least)
    shares = np.diagonal(B @ allocation(B, least, np.ones(B.shape[1]))[0])
    parts = [
        f"{_in_words(row, G.axis_names)} {100 * share:.2g} %"
        for row, share in zip(wanted, shares.tolist(), strict=True)
        if is_told and np.sqrt(SMALLEST) < share < ALL
    ]
    arrives = f"; of what it asks along one axis alone arrives {', '.join(parts)}" if parts else ""
    if len(lost):
        named = ", ".join(_in_words(row, G.axis_names) for row in lost @ wanted)
        rank = f"rank {len(wanted) - len(lost)} of {len(wanted)}"
        yield f"with {rank} cannot push along {named}; what a law asks for there is lost{arrives}"
        arrives = ""
    if len(weak) > len(lost):
        weak /= np.abs(weak).max(axis=1, keepdims=True)
        named = ", ".join(_in_words(row, G.axis_names) for row in weak @ wanted)
        pushed = f"push along {named} with less than {least:g} of their strength elsewhere"
        if not is_told:
            yield f"{pushed}, and the allocation, by the means of drawn numbers, asks for more"
            return
        yield (
            f"{pushed} (the rows of B divided by their norms), which is given up: what a law asks "
            f"for there is lost{arrives}; add {actuators}, or set a smaller least"
        )


def unreachable(B: Array, least: float = SMALLEST) -> Array:
    """Return the directions n with nᵀB = 0 as rows ``(m − rank, m)``, in few coordinates each.

    Singular values of B, with rows divided by their norms, count as 0 below `least` of the largest.
    """
    norms = row_norms(B)
    U, sizes, _ = np.linalg.svd(B / norms)
    rank = int((sizes >= max(least, SMALLEST) * max(sizes[0], np.finfo(float).tiny)).sum())
    rows = U[:, rank:].T.copy()
    if least > SMALLEST:
        rows[np.abs(rows) < least * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)] = 0.0
    rows /= norms[:, 0]
    rows /= np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
    done = 0
    for column in range(rows.shape[1]):  # Gauss-Jordan, largest entries first
        if done == len(rows):
            break
        best = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[best, column]) < np.sqrt(SMALLEST):
            continue
        rows[[done, best]] = rows[[best, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    return np.where(np.abs(rows) < np.sqrt(SMALLEST), 0.0, rows)


def _in_words(direction: Array, names: Sequence[str]) -> str:
    """Return a direction in the names of the coordinates: ``vx``, ``ωy − 0.5 vx``.

    Its first number that is not 0 is 1.
    """
    words = ""
    for number, name in zip(direction.tolist(), names, strict=True):
        if number:
            sign = (" − " if number < 0 else " + ") if words else ""
            size = "" if abs(abs(number) - 1) < SMALLEST else f"{abs(number):.3g} "
            words += f"{sign}{size}{name}"
    return words
