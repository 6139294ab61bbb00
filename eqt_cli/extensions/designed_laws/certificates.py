"""What laws that reject a disturbance promise: their estimate tends to it."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from eqt_cli.extend import Hypothesis, Row, Setting, TrajectoryCheck, Verdict
from eqt_cli.extensions.designed_laws.rejection import DISTURBANCE, Rejecting
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.growth import growth
from eqt_cli.loop.linearised import linearised

PUSHED = 0.01
"""Error of the pose, rad or m, that the disturbance would give a law that does not reject it."""

FOUND = 1e-5
"""Largest relative error of its estimate: states at rest are known to 1e-6 (`AT_REST`)."""


class DisturbanceFound(Hypothesis):
    """With a constant wrench δ at rest, a law that rejects it is stable where δ̂ = δ.

    Of `l1`, where δ̂ = e^{−aT} δ.
    """

    name: ClassVar[str] = "δ̂ tends to δ"
    statement: ClassVar[str] = "a constant wrench at rest, to first order"
    section: ClassVar[float] = 8.95
    kind = TrajectoryCheck.kind

    def check(self, setting: Setting) -> list[Row]:
        """Compare δ with the change of δ̂ between the states where the loop rests."""
        loops = setting.loops.items()
        return [self._row(*law) for law in loops if isinstance(law[1].controller, Rejecting)]

    def _row(self, label: str, loop: ClosedLoop) -> Row:
        law = loop.controller
        assert isinstance(law, Rejecting)
        constant = law.constant_disturbance(loop, PUSHED)
        loop = replace(loop, reference=constant.reference)
        G, delta = loop.group, constant.wrench
        pose = constant.reference.motion(G, 0.0)[0]
        free = replace(loop.vehicle, forces=constant.forces)
        pushed = replace(free, forces=(*constant.forces, *constant.pushes))
        here = np.zeros(1), pose[None], np.zeros((1, G.dimension))
        both = (replace(loop, vehicle=vehicle) for vehicle in (free, pushed))
        at_rest = [linearised(x, *here) for x in both]
        if not all(x.is_constant and growth(x).is_stable for x in at_rest):
            return self.row(Verdict.UNKNOWN, remark="does not rest", controller=label)
        states = (x.about.loop.memory(x.about.states)[DISTURBANCE] for x in at_rest)
        expected = constant.share * delta
        apart = np.abs(np.subtract(*states) + expected).max() / np.abs(delta).max()
        verdict = Verdict.HOLDS if apart <= FOUND else Verdict.FAILS
        return self.row(verdict, float(apart), FOUND, "relative", label)
