"""Functions of the grammar with kinks or steps; most take several arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.core.arrays import absolute, apply, clip, less, maximum, minimum, smooth_less, where


@dataclass(frozen=True)
class Piecewise:
    """A function that is defined in pieces.

    Attributes
    ----------
    value
        The function, of floats, arrays or symbols.
    compared
        Returns the pairs of arguments that it compares, from their number; None stands for 0.
    takes
        The arguments in words.
    count
        The number of arguments; None for two or more.
    """

    value: Callable[..., Any]
    compared: Callable[[int], Iterable[tuple[int, int | None]]]
    takes: str
    count: int | None


def _sign(x: Any) -> Any:
    return where(less(x, 0.0), -1.0, where(less(0.0, x), 1.0, 0.0))


def _smoothstep(x: Any, start: Any, end: Any) -> Any:
    s = clip((x - start) / (end - start), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def _chosen(a: Any, b: Any, x: Any, y: Any) -> Any:
    return where(less(a, b), x, y)


def _atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) from the x axis, by arc tangents of numbers from −1 to 1."""
    steep = smooth_less(absolute(x), absolute(y))
    angle = apply("atan", where(steep, x, y) / where(steep, y, x))
    above = where(smooth_less(y, 0.0), -np.pi / 2, np.pi / 2)
    behind = where(less(y, 0.0), -np.pi, np.pi)  # a real jump, so not `smooth_less`
    return where(steep, above - angle, where(smooth_less(x, 0.0), angle + behind, angle))


def _every_pair(count: int) -> Iterable[tuple[int, int | None]]:
    return combinations(range(count), 2)


PIECEWISE = {
    "min": Piecewise(lambda *x: reduce(minimum, x), _every_pair, "two or more arguments", None),
    "max": Piecewise(lambda *x: reduce(maximum, x), _every_pair, "two or more arguments", None),
    "sign": Piecewise(_sign, lambda _: [(0, None)], "one argument", 1),
    "step": Piecewise(
        lambda x, start: where(less(x, start), 0.0, 1.0),
        lambda _: [(0, 1)],
        "two arguments, as in 'step(t, 1)', which is 0 before t = 1 and 1 after",
        2,
    ),
    "smoothstep": Piecewise(
        _smoothstep,
        lambda _: [(0, 1), (0, 2)],
        "three arguments, as in 'smoothstep(t, 1, 3)', which rises from 0 at 1 to 1 at 3",
        3,
    ),
    "atan2": Piecewise(
        _atan2,
        lambda _: [(0, None)],
        "two arguments, as in 'atan2(y, x)', the angle of the point (x, y) in rad",
        2,
    ),
    "where": Piecewise(
        _chosen,
        lambda _: [(0, 1)],
        "a comparison and two values, as in 'where(t < 1, 0, 2)'",
        4,
    ),
}
"""The functions with kinks or steps, at which engines end a step."""
