"""Baseline files of curves, and differences from them; it knows no figure and no drawing."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.core.files import refusals
from eqt_cli.core.regular_files import content_of
from eqt_cli.plots.curve_data import Curve

TOLERANCE = 1e-6
"""Largest difference of a curve from its baseline, over the largest value of the baseline's panel.

It holds horizontally and vertically: a box plot has its numbers across, the path of a run both
ways. The scale is the panel's, not the curve's: a component that is 0 but for rounding differs
between processors by its whole size, which is invisible beside the others.

The value is the bound of the cross-check of a run by the other engine: 1000 times the relative
tolerance 1e-9 of the shipped experiments. Other processors and versions of the libraries round
differently, and so move adaptive steps, by much less; no eye sees a thousandth of a panel.
"""

SMALLEST_SCALE = 1e-6
"""Least scale of a panel, for panels of zeros: 1e-12 there is rounding."""

MOST_BYTES = 256_000_000
"""Largest size of a file that is read, bytes."""

DIGITS = 9
"""Significant digits that are kept, so that rounding is far below `TOLERANCE`."""

_ANEW = "`eqt plot RESULT --figure NAME --format json --out DIR` writes numbers to compare with"
_TEXTS = ("panel", "name", "across", "up")


@dataclass(frozen=True)
class Check:
    """Comparison of the curves of a figure with their baseline.

    Attributes
    ----------
    curves
        Number of curves in both.
    largest
        Largest difference, over the largest value of its panel.
    differences
        Differences beyond `TOLERANCE`, and curves in one of the two only; a sentence each.
    """

    curves: int
    largest: float
    differences: list[str]


def to_json(curves: Sequence[Curve]) -> bytes:
    """Return the content of the file, a line per name and list of numbers for readable diffs."""
    return b"[\n" + b",\n".join(_record(curve).encode() for curve in curves) + b"\n]\n"


def read(path: Path) -> list[Curve]:
    """Read curves that `to_json` wrote.

    Raises
    ------
    EqtError
        If the file cannot be read or holds anything else.
    """
    with refusals(path, "read", _ANEW):
        content = content_of(path, MOST_BYTES)
    try:
        return [_curve(record) for record in json.loads(content)]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise EqtError(f"{path}: does not hold the numbers of a figure; {_ANEW}") from error


def compare(found: Sequence[Curve], baseline: Sequence[Curve]) -> Check:
    """Compare the curves of a drawing with those of its baseline."""
    new, old = ({(c.panel, c.name): c for c in curves} for curves in (found, baseline))
    both = [(new[key], old[key]) for key in old if key in new]
    texts = [f"{_named(old[key])}: is missing" for key in old if key not in new]
    texts += [f"{_named(new[key])}: is not in the baseline" for key in new if key not in old]
    scales = _scales(baseline)
    texts += [text for pair in both for text in _differences(*pair, *scales[pair[1].panel])]
    relative = (_largest(*pair, *scales[pair[1].panel]) for pair in both if _comparable(*pair))
    largest = max(relative, default=0.0)
    return Check(len(both), largest, texts)


def _scales(curves: Sequence[Curve]) -> dict[str, tuple[float, float]]:
    """Return the largest magnitudes of each panel, across and up."""
    scales: dict[str, tuple[float, float]] = {}
    for curve in curves:
        across, up = scales.get(curve.panel, (SMALLEST_SCALE, SMALLEST_SCALE))
        scales[curve.panel] = max(across, _size(curve.x)), max(up, _size(curve.y))
    return scales


def _differences(new: Curve, old: Curve, across: float, up: float) -> Iterator[str]:
    """Yield the differences of one curve, whose panel has these scales."""
    for place in ("across", "up"):
        got, expected = getattr(new, place), getattr(old, place)
        if got != expected:
            yield f"{_named(new)}: the scale is named '{got}', expected '{expected}'"
    if not _comparable(new, old):
        yield (
            f"{_named(new)}: has {len(new.x)} samples over {_span(new.x)}, expected "
            f"{len(old.x)} over {_span(old.x)}"
        )
        return
    for found, kept, scale in ((new.x, old.x, across), (new.y, old.y, up)):
        error, tolerance = _error(found, kept), TOLERANCE * scale
        wrong = np.flatnonzero(error > tolerance)
        if len(wrong):
            worst = int(np.argmax(error))
            first, last, most = (_place(old, index) for index in (wrong[0], wrong[-1], worst))
            how = (
                f"lie elsewhere across; most number {worst + 1}: got {_place(new, worst)}, "
                f"expected {most}"
                if kept is old.x
                else f"differ, from {first} to {last}; most at {most}: got "
                f"{found[worst]:.{DIGITS}g}, expected {kept[worst]:.{DIGITS}g}"
            )
            samples = f"{len(wrong)} of {len(error)} samples"
            yield f"{_named(new)}: {samples} {how} within {tolerance:.2g}"
            return


def _named(curve: Curve) -> str:
    return f"panel '{curve.panel}', curve '{curve.name}'"


def _place(curve: Curve, index: int) -> str:
    """Return the place of a sample: ``t = 2.5 s``."""
    symbol, _, unit = curve.across.removesuffix(")").partition(" (")
    return f"{symbol or 'x'} = {curve.x[index]:.{DIGITS}g} {unit}".rstrip()


def _span(x: Array) -> str:
    return f"{x[0]:g} to {x[-1]:g}" if len(x) else "nothing"


def _comparable(new: Curve, old: Curve) -> bool:
    """Whether both have the same number of samples."""
    return new.x.shape == old.x.shape


def _size(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))


def _error(new: Array, old: Array) -> Array:
    """Return the difference at every sample; infinite where only one of the two is finite.

    Files hold finite numbers only, so an infinite value of a figure counts as missing.
    """
    seen = np.isfinite(new), np.isfinite(old)
    error = np.abs(np.subtract(new, old, out=np.zeros(new.shape), where=seen[0] & seen[1]))
    return np.where(seen[0] == seen[1], error, np.inf)


def _largest(new: Curve, old: Curve, across: float, up: float) -> float:
    """Return the largest difference, across or up, over the panel's scale in that direction."""
    pairs = ((new.x, old.x, across), (new.y, old.y, up))
    return max(float(np.max(_error(x, kept), initial=0.0)) / scale for x, kept, scale in pairs)


def _record(curve: Curve) -> str:
    texts = [f'"{k}": {json.dumps(getattr(curve, k), ensure_ascii=False)}' for k in _TEXTS]
    numbers = [f'"{k}": [{", ".join(map(_text, getattr(curve, k)))}]' for k in ("x", "y")]
    return "{" + ",\n ".join([*texts, *numbers]) + "}"


def _text(value: float) -> str:
    return f"{value:.{DIGITS}g}" if np.isfinite(value) else "null"


def _curve(record: dict[str, Any]) -> Curve:
    texts = {name: str(record[name]) for name in _TEXTS}
    x, y = (np.array(record[name], dtype=float) for name in ("x", "y"))
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError("x and y are no lists of one length")
    return Curve(**texts, x=x, y=y)
