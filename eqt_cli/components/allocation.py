"""Allocation: which thrusts, or speeds of wheels, give a command within limits, or by priority."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from eqt_cli.base.arrays import Array, absolute, apply_matrix, clip, less, stack, where
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.numbers.rounded import pseudo_inverse

SMALLEST = 1e-10
"""Largest singular value of B, relative to the largest of all, that counts as 0."""

ALL = 0.995
"""Share of a torque from which on all of it arrives."""

FAINT = 1e-6
"""Norm of a row of B, relative to the largest, that digits of the thrusters' directions explain."""

NEAR = 1e-12
"""A solved thrust so near its limit, in N and relative to it, is at the limit."""


def _norms(B: Array) -> Array:
    """Return the norms of the rows, ``(m, 1)``; 1 for rows that are `FAINT` beside the largest."""
    largest = np.maximum(np.abs(B).max(axis=1, keepdims=True), np.finfo(float).tiny)
    norms: Array = largest * np.linalg.norm(B / largest, axis=1, keepdims=True)  # none overflows
    return np.where(norms > FAINT * norms.max(), norms, 1.0)


def allocation(B: Array, least: float, scale: Array) -> tuple[Array, Array | None]:
    """Return B⁺ without weak directions, and the commands that pass through it; None for all.

    A direction is weak where a singular value of B, with rows divided by their norms, is below
    `least` of the largest. The sum of squares of u/scale is least.
    """
    norms = _norms(B)
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
    norms = _norms(B)
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


def nearest_thrusts(
    command: Array, B: Array, free: Array, scale: Array, low: Array, high: Array
) -> Array:
    """Return the thrusts within limits whose torque is nearest to a command.

    `free` are those without limits.
    """
    if not np.isfinite(command).all():
        return np.full(len(low), np.nan)
    if (free >= low).all() and (free <= high).all():
        return free
    from scipy.optimize import lsq_linear  # slow to import

    # An active set ends at the very optimum, but counts each change of the set as an iteration.
    limits, most = (low / scale, high / scale), 100 * len(low)
    solved = lsq_linear(B * scale, command, limits, method="bvls", tol=1e-14, max_iter=most)
    at = solved.active_mask
    return np.where(at < 0, low, np.where(at > 0, high, np.clip(scale * solved.x, low, high)))


# Allocation by priority ---------------------------------------------------------------------------


def words_of(group: str | list[str]) -> list[str]:
    """Return the directions of one group of an order, which may be one word."""
    return [group] if isinstance(group, str) else group


def axes_of(word: str, names: Sequence[str], B: Array) -> list[int]:
    """Return the axis of a direction, or all of a kind along which anything pushes."""
    of_kind = [k for k, name in enumerate(names) if name.split()[0] == word and B[k].any()]
    return [names.index(word)] if word in names else of_kind


def faces_of(C: Array, low: Array, high: Array) -> tuple[Array, ...]:
    """Return C⁻¹, and for each r the faces of the set that r rows of C reach within limits.

    The set is a zonotope; the normal of each face is normal to r − 1 columns. A face gives a
    range of y_r from the numbers y before it, [l + w·y, h + w·y], here as a row (l, h, w).
    """
    norms, faces = _norms(C), [np.linalg.inv(C)]
    for r in range(1, len(C) + 1):
        columns = np.array([*combinations(range(len(C)), r - 1)], dtype=int)
        A = C[:r] / norms[:r]
        normals = np.linalg.svd(A[:, columns].swapaxes(0, 1))[0][..., -1]
        # Others limit the numbers before alone. The number of rows must not depend on B.
        normals = np.resize(normals[np.abs(normals[:, -1]) > SMALLEST], normals.shape)
        pushes = np.stack([normals @ A * low, normals @ A * high])
        ends = np.stack([pushes.min(axis=0).sum(axis=-1), pushes.max(axis=0).sum(axis=-1)], axis=-1)
        of_rows = normals / norms[:r, 0]
        rows = np.concatenate([ends, -of_rows[:, :-1]], axis=-1) / of_rows[:, -1:]
        rows[:, :2].sort(axis=-1)
        faces.append(rows)
    return tuple(faces)


def by_priority(command: Array, groups: Sequence[Sequence[int]], faces: Sequence[Array]) -> Array:
    """Return the numbers y of groups, as near to the command as the faces and those before allow.

    For a group of several, c is the reachable point nearest to 0, coordinate by coordinate;
    y = c + s (d − c) with the largest s ≤ 1. Groups without axes are thrusts without effect.
    """
    y = command[..., :0]
    for group in groups:
        d = stack([command[..., axis] for axis in group] or [0.0 * command[..., 0]])
        start, count, c = y.shape[-1], d.shape[-1], y
        for face in faces[start : start + count]:
            low, high = _ends(c, face)
            nearest = d if count == 1 else 0.0 * d[..., :1]
            c = np.concatenate([c, clip(nearest, -_least(-low), _least(high))], axis=-1)
        y = c
        if count == 1:
            continue
        move = np.concatenate([0.0 * c[..., :start], d - c[..., start:]], axis=-1)
        share = 1.0 + 0.0 * d[..., :1]
        for r in range(start, start + count):
            w, (low, high) = faces[r][..., 2:], _ends(c[..., :r], faces[r])
            slope = move[..., r, None] - _product(w, move[..., :r])
            size = absolute(move[..., r, None]) + _product(absolute(w), absolute(move[..., :r]))
            room = where(less(0.0, slope), high - c[..., r, None], c[..., r, None] - low)
            counts = less(NEAR * size, absolute(slope))
            shares = where(counts, room / where(counts, absolute(slope), 1.0), 1.0)
            share = clip(_least(shares), 0.0, share)
        y = c + share * move
    return y


def _ends(y: Array, face: Array) -> tuple[Array, Array]:
    """Return the ranges of the next number by each face, ``(..., n)``."""
    moved = _product(face[..., 2:], y)
    return face[..., 0] + moved, face[..., 1] + moved


def _product(w: Array, y: Array) -> Array:
    """Return w·y; 0 of no numbers."""
    return apply_matrix(w, y) if y.shape[-1] else 0.0 * w.sum(axis=-1)


def _least(x: Array) -> Array:
    """Return the least number along the last axis, ``(..., 1)``."""
    while (n := x.shape[-1]) > 1:
        a, b = x[..., : n // 2], x[..., n // 2 : n // 2 * 2]
        x = np.concatenate([where(less(a, b), a, b), x[..., n // 2 * 2 :]], axis=-1)
    return x
