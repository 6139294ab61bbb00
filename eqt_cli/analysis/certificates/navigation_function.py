"""Whether Υ is a navigation function, from its critical points."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.certificates.setting import Setting
from eqt_cli.mechanics.critical_points import CriticalSet, critical_sets


class NavigationFunction(Hypothesis):
    """Υ is proper and Morse with a unique minimum: measured is the least |Hessian eigenvalue| ≠ 0.

    Morse-Bott where critical points form manifolds along which alone the Hessian is 0.
    """

    name: ClassVar[str] = "Υ is a navigation function"
    statement: ClassVar[str] = "Definition 2.1"
    section: ClassVar[float] = 2.9

    def check(self, setting: Setting) -> list[Row]:
        """The critical sets with their indices."""
        G, K = setting.loop.group, setting.loop.gains.K
        found = critical_sets(G, K)
        if found is None:
            return [self.row(Verdict.UNKNOWN, remark=f"critical points on {G.name} not known")]
        remark = "; ".join(_described(each) for each in found)
        return [self.row(_verdict(found), _least(found), remark=remark)]


def _verdict(found: list[CriticalSet]) -> Verdict:
    minima = [each for each in found if each.index == 0]
    clean = all(each.nullity == each.dimension for each in found)
    if minima != found[:1] or not clean:  # the identity comes first, and is a single point
        return Verdict.VIOLATED
    return Verdict.MORSE_BOTT if any(each.dimension for each in found) else Verdict.HOLDS


def _least(found: list[CriticalSet]) -> float:
    sizes = [np.sort(np.abs(each.hessian))[each.nullity :].min() for each in found]
    return float(min(sizes))


def _described(each: CriticalSet) -> str:
    whole = f", a manifold of dimension {each.dimension}" if each.dimension else ""
    return f"{each.name}: index {each.index}{whole}"
