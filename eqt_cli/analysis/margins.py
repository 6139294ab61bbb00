"""How far loops are from instability, to first order: their eigenvalues, delay and gain margins."""

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
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.horizon import along_reference, check_reference, reference_over_horizon
from eqt_cli.experiment.local_stability import Along, Growth, growth, left_out, size_of

MOST = 128.0
"""Gains are multiplied by factors up to this, and divided by as much."""

STEP = 2.0
"""Between factors at which it is looked whether the loop is stable."""

GAINS = {"kp": ("kp",), "kd": ("kd",), "both": ("kp", "kd")}
"""Which gains are multiplied at once."""


@dataclass(frozen=True)
class GainMargin:
    """The factors of a gain between which a loop is stable.

    Attributes
    ----------
    lower, upper
        None where it is stable down to 1/`MOST`, or up to `MOST`.
    """

    lower: float | None
    upper: float | None


@dataclass(frozen=True)
class LawMargins:
    """How far the loop of one law is from instability.

    Attributes
    ----------
    label
        Of the law.
    growth
        Of small errors, at the worst of the times.
    size
        The real part of its largest eigenvalue, 1/s; of a sampled law its modulus.
    is_indicative
        Whether the loop, to first order, depends on the time: then eigenvalues decide nothing.
    offset : (m,)
        Where the loop stays beside its reference, ε with Q = Q_d exp(ε); 0 of one that depends on
        the time.
    delay
        The delay margin, s: further delay of the command; of a sampled law the longest in whole
        periods with which the loop is stable. Infinite if none makes it unstable; None where it is
        not stable without.
    delay_periods
        The same in periods of a sampled law.
    gains
        Those of `GAINS`; without those that the law does not use, and none where the loop is not
        stable.
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
        """Whether the loop is unstable, without doubt."""
        return self.growth.is_stable is False and not self.is_indicative


@dataclass(frozen=True)
class Margins:
    """How far the loops of an experiment are from instability.

    Attributes
    ----------
    experiment
        With its laws.
    laws
        In their order.
    period
        Of control, s; None where the laws act continuously.
    left_out
        What is not part of the linear loops, by its place in the configuration.
    """

    experiment: Experiment
    laws: list[LawMargins]
    period: float | None
    left_out: list[str]


@blamed()
def margins_of(experiment: Experiment) -> Margins:
    """The margins of every law of an experiment.

    Raises
    ------
    ConfigError
        If the reference leaves the real numbers.
    InputError
        If a loop has no derivative about its reference.
    ComponentError
        If a component of the user's own fails.
    """
    shown, problems = reference_over_horizon(experiment), Problems(experiment.source.place)
    check_reference(shown, None, problems.at("reference"))
    problems.raise_if_any()
    along = along_reference(experiment, shown)
    laws = []
    # One thread: for small matrices, several take ten times as long.
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
            f"the loop of '{label}' has no derivative where all errors are 0, as of a law that "
            "jumps there; leave this law out"
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
    """Those of the gains that the law uses."""
    times, found = np.zeros(len(loop.A)), {}
    for which, names in GAINS.items():

        def rate(factor: float, names: tuple[str, ...] = names) -> float:
            return growth(loop.with_gains(dict.fromkeys(names, factor)), times).rate

        changed = loop.with_gains(dict.fromkeys(names, STEP))
        if not np.array_equal(changed.closed, loop.closed):
            ends = (_first_unstable(rate, step) for step in (1 / STEP, STEP))
            found[which] = GainMargin(*ends)
    return found


def _first_unstable(rate: Callable[[float], float], step: float) -> float | None:
    """The factor nearest to 1 on one side at which the largest rate is 0; None if there is none."""
    from scipy.optimize import brentq  # slow to import

    def rate_at(logarithm: float) -> float:
        return rate(float(np.exp(logarithm)))

    known, end = 0.0, np.log(step)
    while abs(end) <= np.log(MOST) * (1 + 1e-12):
        if not rate_at(end) <= 0.0:
            return float(np.exp(brentq(rate_at, known, end, xtol=1e-5)))
        known, end = end, end + np.log(step)
    return None
