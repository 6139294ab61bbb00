"""Settings that a style sheet may change, and their bounds; it knows no file.

Sheets are passed around. A sheet sets how a figure looks: no programs, no folders, no code that
Matplotlib would call, and no numbers with which a drawing never ends or exceeds the memory.
"""

import ast
import math
from collections.abc import Iterator
from typing import Any

_LOOKS = (
    "axes. axes3d. boxplot. contour. date. errorbar. figure. font. grid. hatch. hist. image. "
    "legend. lines. markers. mathtext. patch. path.simplify path.snap pdf. polaraxes. ps. savefig. "
    "scatter. svg. text. xaxis. xtick. yaxis. ytick."
).split()
"""Prefixes of the keys that set how a figure looks."""

_NOT_LOOKS = ("figure.hooks", "ps.usedistiller")
"""Keys with these prefixes that name code or programs."""

OF_A_MACHINE = frozenset(
    "backend backend_fallback date.epoch docstring.hardcopy figure.max_open_warning "
    "figure.raise_window interactive savefig.directory timezone tk.window_focus toolbar "
    "webagg.address webagg.open_in_browser webagg.port webagg.port_retries".split()
)
"""Keys that Matplotlib itself leaves out of a style, as eqt does."""

MOST = 300.0
"""Largest magnitude of a number without a bound of its own, such as a size in points."""

_MOST = {"dpi": 2400.0, "figsize": 50.0, "weight": 1000.0, "threshold": 1e4}
"""Bounds of numbers, by suffix of the key."""

THINNEST = 0.05
"""Least non-zero width of a line, pt, since dashes scale with it."""

SHORTEST = 0.5
"""Least length of a pattern of dashes over the width of the line."""

MOST_IN_CYCLE = 1000
"""Most entries of a property cycle."""


def check(key: str, value: Any, default: Any) -> None:
    """Raise a `ValueError` with the reason if a style may not set a key to a value.

    Matplotlib's default may always be set.
    """
    if value == default:
        return
    if not key.startswith(tuple(_LOOKS)) or key in _NOT_LOOKS:
        raise ValueError(f"Key {key}: says nothing of how a figure looks; remove the line")
    most = next((most for end, most in _MOST.items() if key.endswith(end)), MOST)
    for number in _numbers(value):
        if not abs(number) <= most:
            raise ValueError(f"Key {key}: expected numbers of at most {most:g}, got {number:g}")
        if key.endswith("width") and 0 < number < THINNEST:
            raise ValueError(f"Key {key}: expected 0 or at least {THINNEST}, got {number:g}")
    for pattern in _patterns(key, value):
        if sum(pattern) < SHORTEST:
            raise ValueError(
                f"Key {key}: expected dashes and gaps of {SHORTEST} or more together, "
                f"got {sum(pattern):g}"
            )


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield value
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from _numbers(entry)
    elif hasattr(value, "by_key"):
        yield from _numbers(list(value.by_key().values()))


def _patterns(key: str, value: Any) -> Iterator[list[float]]:
    """Yield lengths of dashes and gaps: from a list, behind an offset, or from a cycle."""
    if key.endswith("pattern"):
        yield list(_numbers(value))
    elif hasattr(value, "by_key"):
        for style in value.by_key().get("linestyle", ()):
            yield from _patterns("linestyle", style)
    elif key.endswith("linestyle") and isinstance(value, tuple):
        _, dashes = value
        yield from [list(_numbers(dashes))] if dashes else []


def check_cycle(text: str) -> None:
    """Raise a `ValueError` for a property cycle that is no cycler of literal values.

    Matplotlib before 3.11 evaluates the text, with no names but ``cycler``; without attributes and
    operators nothing else can be reached, and nothing is larger than it is written.
    """
    try:
        count = _entries(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"axes.prop_cycle is no cycler of literal values: {text}") from None
    if count > MOST_IN_CYCLE:
        raise ValueError(
            f"Key axes.prop_cycle: expected at most {MOST_IN_CYCLE} entries, got {count}"
        )


def _entries(node: ast.expr) -> int:
    """Return the number of entries of a cycle; raise a `ValueError` if it is none."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mult):
        both = _entries(node.left), _entries(node.right)
        return max(both) if isinstance(node.op, ast.Add) else math.prod(both)
    if not (isinstance(node, ast.Call) and getattr(node.func, "id", None) == "cycler"):
        raise ValueError
    given = [*node.args, *(keyword.value for keyword in node.keywords)]
    return max((_length(ast.literal_eval(each)) for each in given), default=0)


def _length(value: Any) -> int:
    if isinstance(value, dict):
        return max((_length(each) for each in value.values()), default=0)
    return len(value) if isinstance(value, list | tuple | str) else 1
