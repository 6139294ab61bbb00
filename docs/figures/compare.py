"""Compares the numbers behind figures, as `eqt plot --format json` writes them, with kept ones.

python docs/figures/compare.py FOUND KEPT [TOLERANCE]    for every KEPT/FIGURE.json also in FOUND
"""

import json
import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

TOLERANCE = 1e-6
"""Largest difference of a curve, over the largest value of its panel.

It holds across and up: a box plot has its numbers across, the path of a run both ways. A component
that is 0 but for rounding differs between processors by its whole size, which is invisible beside
the others of its panel. The value is the bound of the cross-check of a run by the other engine:
1000 times the relative tolerance 1e-9 of the shipped experiments. Other processors and versions of
the libraries differ by much less; no eye sees a thousandth of a panel.
"""

SMALLEST_SCALE = 1e-6
"""Least scale of a panel, for panels of zeros: 1e-12 there is rounding."""


def differences(found: list[dict], kept: list[dict]) -> Iterator[tuple[str, float]]:
    """Yield every curve in words with its largest difference over the scale of its panel."""
    new, old = ({(c["panel"], c["name"]): c for c in curves} for curves in (found, kept))
    for key in dict.fromkeys([*old, *new]):
        curve = f"panel '{key[0]}', curve '{key[1]}'"
        if key not in new or key not in old:
            yield f"{curve}: {'is not kept' if key in new else 'is missing'}", np.inf
            continue
        for axis, label in (("x", "across"), ("y", "up")):
            got, expected = (np.array(one[key][axis], dtype=float) for one in (new, old))
            if got.shape != expected.shape or new[key][label] != old[key][label]:
                yield f"{curve}, {new[key][label]}: has another length or scale", np.inf
                continue
            panel = [c[axis] for c in kept if c["panel"] == key[0]]
            sizes = np.abs(np.array(list(chain(*panel)), dtype=float))
            scale = np.nanmax(sizes, initial=SMALLEST_SCALE)
            off = np.where(np.isnan(got) & np.isnan(expected), 0.0, np.abs(got - expected))
            off = np.where(np.isnan(off), np.inf, off) / scale
            worst = int(off.argmax()) if off.size else 0
            values = f"got {got[worst]:g}, expected {expected[worst]:g}" if off.size else ""
            yield f"{curve}, {old[key][label]}: sample {worst}: {values}", off.max(initial=0.0)


def main(found: Path, kept: Path, tolerance: float = TOLERANCE) -> int:
    """Print every difference beyond the tolerance; return 4 if there is one, else 0."""
    wrong = False
    for path in sorted(kept.glob("*.json")):
        if not (found / path.name).exists():
            continue
        one, other = (json.loads((folder / path.name).read_text()) for folder in (found, kept))
        every = list(differences(one, other))
        beyond = [text for text, off in every if not off <= tolerance]
        for text in beyond:
            print(f"{path.stem}: {text}")
        largest = max(off for _, off in every)
        print(f"{path.stem}: {'differs' if beyond else 'agrees'}; largest difference {largest:.2g}")
        wrong = wrong or bool(beyond)
    return 4 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:3]), *map(float, sys.argv[3:])))
