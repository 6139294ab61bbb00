"""Certificates of cascades: the rates of the commanded attitude, and what keeps it defined."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, norm
from eqt_cli.components.matrix_groups import turn_of_distance
from eqt_cli.extend import Identity, Row, Runs, Sample, TrajectoryCheck, Verdict, rate_of
from eqt_cli.extensions.underactuated.cascade import Cascade
from eqt_cli.loop.closed_loop import ClosedLoop

WEAK = 0.1
"""Least share of its median below which a force is remarked: its direction then turns fast."""


class CommandedRates(Identity):
    """Ω_c and Ω̇_c are the rates of R_c along the motion of the model, at random states.

    Without a heading R_c follows the body, so that only the direction of the push is compared.
    """

    name: ClassVar[str] = "rates of the commanded attitude"
    statement: ClassVar[str] = "derived"
    section: ClassVar[float] = 7.0
    per_law: ClassVar[bool] = True
    of_whole: ClassVar[bool] = True
    not_rational: ClassVar[str] = "a direction is no rational function of a force"

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the rates are those of the model, without an estimate of what else acts."""
        law = loop.controller
        follows = isinstance(law, Cascade) and law.rates == "model" and law.position.c1 is None
        return follows and loop.setpoint == "full"

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare Ṙ_c with R_cΩ_c^, and the rate of Ω_c with Ω̇_c."""
        law = sample.loop.controller
        assert isinstance(law, Cascade) and sample.s.flat is not None
        s = law.commanded(sample.s).tracking
        turning = s.Qd @ s.G.hat(s.Vd)
        axis = np.array(law.direction)
        yield rate_of(s.Qd @ axis), turning @ axis
        if sample.s.flat.heading is not None or s.G.dimension == 1:
            yield rate_of(s.Qd), turning
            yield rate_of(s.Vd), s.Vd_dot


class ForceStays(TrajectoryCheck):
    """‖F‖ > 0 in all runs, without which no attitude is commanded. Measured: the least ‖F‖/m."""

    name: ClassVar[str] = "F is not 0"
    statement: ClassVar[str] = "Lee et al. (2010)"
    section: ClassVar[float] = 7.1

    def applies(self, runs: Runs) -> bool:
        """Whether the law is a cascade."""
        vehicle = runs.vehicle
        return vehicle is not None and hasattr(vehicle.problem.loop.controller, "commanded")

    def check(self, runs: Runs) -> Row:
        """Compare the least with the median: samples can miss a zero."""
        assert runs.vehicle is not None
        if not len(runs.vehicle.states):
            return self.undecided(runs)
        loop = runs.vehicle.loop
        s = loop.seen(loop.tracking(runs.vehicle.problem.times, runs.vehicle.states))
        law: Any = loop.controller
        sizes = norm(law.commanded(s).acceleration)
        least, typical = float(sizes.min()), float(np.median(sizes))
        angle = turn_of_distance(law.attitude_error(s)[:, 0]).max()
        remark = f"R(0) is up to {np.degrees(angle):.3g}° from R_c(0)"
        verdict = Verdict.HOLDS
        if not least > WEAK * typical:
            verdict = Verdict.VIOLATED
            t = runs.vehicle.problem.times[sizes.argmin() % sizes.shape[-1]]
            remark += f"; F is nearly 0 at {t:.4g} s: give position.limit below the weight per mass"
        return self.row(verdict, least, WEAK * typical, remark, runs.label)
