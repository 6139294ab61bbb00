"""Stability margins of linearised loops: eigenvalues, delay margins and gain margins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.analysis.delay_margin import CutLoop, delay_margin
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.linearised import Linearised, linearised
from eqt_cli.core.arrays import Array
from eqt_cli.core.error_origin import blamed
from eqt_cli.core.errors import InputError
from eqt_cli.core.problems import Problems
from eqt_cli.core.reporting import reporter, step
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.horizon import along_reference, check_reference, reference_over_horizon
from eqt_cli.experiment.local_stability import Along, Growth, growth, left_out, size_of

LARGEST_FACTOR = 128.0
"""Largest factor by which gains are multiplied or divided."""

FACTOR_STEP = 2.0
"""Ratio of successive factors at which stability is tested."""

GAINS = {"kp": ("kp",), "kd": ("kd",), "both": ("kp", "kd")}
"""Gains that are multiplied together, by the name of the margin."""


@dataclass(frozen=True)
class GainMargin:
    """The factors of a gain between which a loop is stable.

    Attributes
    ----------
    lower, upper
        None if the loop is stable down to 1/`LARGEST_FACTOR`, or up to `LARGEST_FACTOR`.
    """

    lower: float | None
    upper: float | None


@dataclass(frozen=True)
class LawMargins:
    """The stability margins of the loop of one law.

    Attributes
    ----------
    label
        Label of the law.
    growth
        Growth of small errors at the worst time.
    size
        Real part of the largest eigenvalue, 1/s; for a sampled law its modulus.
    is_indicative
        Whether the linearised loop depends on time. Eigenvalues then prove nothing.
    offset : (m,)
        Steady-state error ε with Q = Q_d exp(ε); 0 for a loop that depends on time.
    delay
        Delay margin, s: added delay of the command. For a sampled law, the largest whole number of
        periods with which the loop is stable. Infinite if no delay makes the loop unstable; None
        if the loop is unstable without added delay.
    delay_periods
        Delay margin of a sampled law in periods.
    gains
        Gain margins by the names in `GAINS`, for gains that the law uses; empty if the loop is
        unstable.
    """

    label: str
    growth: Growth
    size: float
    is_indicative: bool
    offset: Array
    delay: float | None
    delay_periods: int | None
    gains: dict[str, GainMargin]

    @property
    def is_unstable(self) -> bool:
        """Whether the loop is certainly unstable."""
        return self.growth.is_stable is False and not self.is_indicative


@dataclass(frozen=True)
class Margins:
    """The stability margins of the loops of an experiment.

    Attributes
    ----------
    experiment
        The experiment.
    laws
        Margins of its laws, in their order.
    period
        Control period, s; None if the laws act continuously.
    left_out
        Places in the configuration of parts that the linear loops leave out.
    """

    experiment: Experiment
    laws: list[LawMargins]
    period: float | None
    left_out: list[str]


@blamed()
def margins_of(experiment: Experiment) -> Margins:
    """Compute the margins of every law of an experiment.

    Raises
    ------
    ConfigError
        If the reference is not finite.
    InputError
        If a loop has no derivative about its reference.
    ComponentError
        If a plugin fails.
    """
    shown, problems = reference_over_horizon(experiment), Problems(experiment.source.place)
    check_reference(shown, None, problems.at("reference"))
    problems.raise_if_any()
    along = along_reference(experiment, shown)
    laws = []
    # One BLAS thread: with several, small matrices take ten times as long.
    with threadpool_limits(1), step("laws", len(experiment.loops)):
        for label, loop in experiment.loops.items():
            laws.append(_of_law(label, loop, along))
            reporter().advance(1)
    first = next(iter(experiment.loops.values()))
    control = first.vehicle.control
    period = None if control is None else control.period
    return Margins(experiment, laws, period, list(left_out(first)))


def _of_law(label: str, loop: ClosedLoop, along: Along) -> LawMargins:
    found = linearised(loop, *along)
    if not np.isfinite(found.closed).all():
        raise InputError(
            f"the loop of '{label}' has no derivative where all errors are 0, for example because "
            "its law jumps there; leave this law out"
        )
    largest = growth(found, along.times)
    delay, gains = None, dict[str, GainMargin]()
    if largest.is_stable:
        cut = zip(found.A, found.B, found.C, strict=True)
        delay = min(delay_margin(CutLoop(A, B, C, found.period)) for A, B, C in cut)
        gains = _gain_margins(found)
    periods = None
    if found.period is not None and delay is not None and np.isfinite(delay):
        periods = round(delay / found.period)
    return LawMargins(
        label,
        largest,
        size_of(largest, found),
        not found.is_constant,
        found.offset[0],
        delay,
        periods,
        gains,
    )


def _gain_margins(loop: Linearised) -> dict[str, GainMargin]:
    """Return the margins of the gains that the law uses."""
    times, found = np.zeros(len(loop.A)), {}
    for which, names in GAINS.items():

        def rate(factor: float, names: tuple[str, ...] = names) -> float:
            return growth(loop.with_gains(dict.fromkeys(names, factor)), times).rate

        changed = loop.with_gains(dict.fromkeys(names, FACTOR_STEP))
        if not np.array_equal(changed.closed, loop.closed):
            ends = (_first_unstable(rate, step) for step in (1 / FACTOR_STEP, FACTOR_STEP))
            found[which] = GainMargin(*ends)
    return found


def _first_unstable(rate: Callable[[float], float], step: float) -> float | None:
    """Return the factor nearest to 1 on one side at which the loop becomes unstable, or None."""
    from scipy.optimize import brentq  # slow to import

    def rate_at(logarithm: float) -> float:
        return rate(float(np.exp(logarithm)))

    known, end = 0.0, np.log(step)
    while abs(end) <= np.log(LARGEST_FACTOR) * (1 + 1e-12):
        if not rate_at(end) <= 0.0:
            return float(np.exp(brentq(rate_at, known, end, xtol=1e-5)))
        known, end = end, end + np.log(step)
    return None
