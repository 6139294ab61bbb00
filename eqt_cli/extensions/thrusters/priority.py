"""Thrusts within limits: the nearest to a command, or by priority."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from eqt_cli.base.arrays import Array, absolute, apply_matrix, clip, less, stack, where
from eqt_cli.components.allocation import SMALLEST, row_norms

NEAR = 1e-12
"""A solved thrust so near its limit, in N and relative to it, is at the limit."""


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
    norms, faces = row_norms(C), [np.linalg.inv(C)]
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
