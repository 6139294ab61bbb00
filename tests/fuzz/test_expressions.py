"""Expressions of any shape, by seed: values, instants, series and programs, without an exception.

`make fuzz` tries 10,000 of them, `make test` a hundredth. What floats give, arrays give, too.
"""

import os
import random
from contextlib import suppress

import numpy as np
import pytest

from eqt_cli.base.arrays import FUNCTIONS
from eqt_cli.base.errors import ExpressionError, InputError
from eqt_cli.base.expressions import PIECEWISE, parse
from eqt_cli.numbers.instants import instants
from eqt_cli.numbers.jets import series
from eqt_cli.numbers.program import traced

SHARES = 100
CASES = 10_000 // SHARES
FULL = os.environ.get("EQT_FUZZ") == "full"
NUMBERS = "0 1 2 0.5 3 1e7 1e-9 1e300 1e-300 pi 100 64 1e17 7 0.1 -1".split()
TIMES = np.array([0.0, 1.0, -1.0, 0.5, 1e9])


def text_of(seed):
    """An expression in t."""
    random_ = random.Random(seed)

    def part(depth):
        kind = random_.random()
        if depth == 0 or kind < 0.15:
            return "t" if random_.random() < 0.5 else random_.choice(NUMBERS)
        if kind < 0.55:
            sign = random_.choice("+ - * / ** **".split())
            return f"({part(depth - 1)} {sign} {part(depth - 1)})"
        if kind < 0.75:
            return f"{random_.choice(FUNCTIONS)}({part(depth - 1)})"
        if kind < 0.8:
            return f"-{part(depth - 1)}"
        name = random_.choice(list(PIECEWISE))
        if name == "where":
            sign = random_.choice("< > <= >=".split())
            a, b, x, y = (part(depth - 1) for _ in range(4))
            return f"where({a} {sign} {b}, {x}, {y})"
        count = PIECEWISE[name].count or random_.choice((2, 3))
        same = [part(depth - 1)] * count
        different = [part(depth - 1) for _ in range(count)]
        return f"{name}({', '.join(same if random_.random() < 0.15 else different)})"

    return part(random_.choice((1, 2, 3, 4)))


def _apart(expression, t):
    """How far rounding of t moves a value, such as cos(1e300**t): rounding within does the same."""
    near = [expression.evaluate({"t": t * (1 + k * 2.0**-52)}) for k in range(-8, 9)]
    return np.ptp(near) if np.isfinite(near).all() else np.inf


@pytest.mark.parametrize("share", range(SHARES if FULL else 1))
def test_every_expression_has_values_series_and_programs(share):
    for seed in range(share * CASES, (share + 1) * CASES):
        text = text_of(seed)
        try:
            expression = parse(text)
        except ExpressionError:  # a part without t has no value
            continue
        floats = [expression.evaluate({"t": t}) for t in TIMES.tolist()]
        arrays = np.broadcast_to(expression.evaluate({"t": TIMES}), 5)
        for t, one, other in zip(TIMES, arrays, floats, strict=True):
            if not np.isclose(one, other, rtol=1e-6, atol=0, equal_nan=True):
                assert abs(one - other) <= _apart(expression, t), text
        with suppress(InputError):  # too many
            instants(expression, 10.0)
        for t in (0.0, 1.0, 0.3):
            series(expression, {"t": t}, 4)

        def derivatives(x, expression=expression):
            found = series(expression, {"t": x["x"][0]}, 2)
            return {"y": np.array([found.derivative(k) for k in range(3)], dtype=object)}

        traced(derivatives, {"x": 1})
