"""The reference of a loop over a horizon, as an engine integrates it, and what is wrong with it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from eqt_cli.base.arrays import Array, distinct, frobenius, norm
from eqt_cli.base.errors import Problems
from eqt_cli.base.expressions import Expression, shortened
from eqt_cli.base.stored import Status
from eqt_cli.components.mechanics import Tracking
from eqt_cli.engines.engine import ROUNDING, Problem, together
from eqt_cli.engines.solve_ivp import SolveIvp, coefficients, solve
from eqt_cli.loop.closed_loop import ClosedLoop, ReferenceSystem
from eqt_cli.numbers.instants import bounds_of_integral, instants_of

RTOL = 1e-8
"""Relative tolerance for the integration of a reference."""

MOST_EVALUATIONS = 10_000
"""Largest number of evaluations of an integrated reference, so that a check takes seconds."""

JUMP = 1e-6
"""Least jump relative to the largest value on the horizon."""

LEAST_JUMP = 1e-12
"""Least jump in SI units; smaller ones are those of rounding."""

MOST_LISTED = 5
"""Most times that a remark lists."""


@dataclass(frozen=True)
class Horizon:
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        Times in increasing order, s.
    pose : (n, d, d)
        Q_d.
    velocity, acceleration, torque : (n, m)
        V_d, V̇_d and τ_d in the body frame; NaN where the reference is not finite.
    jumps
        Jumps of Q_d, V_d or τ_d as (time, name, size with its unit if all coordinates share it).
    spent
        Number of evaluations after which the integration stopped, at the last of the times; None if
        it reached the end.
    """

    times: Array
    pose: Array
    velocity: Array
    acceleration: Array
    torque: Array
    jumps: list[tuple[float, str, str]]
    spent: int | None = None

    @property
    def finite(self) -> Array:
        """Whether the reference is finite at each time."""
        parts = (frobenius(self.pose), norm(self.velocity), norm(self.torque))
        return np.isfinite(np.array(parts)).all(axis=0)


class _Light(SolveIvp):
    """The engine of references: DOP853 without SciPy."""

    solver = staticmethod(solve)


def reference_over_horizon(
    loop: ClosedLoop,
    start: tuple[Array, Array],
    times: Array,
    most_evaluations: int = MOST_EVALUATIONS,
) -> Horizon:
    """Compute Q_d, V_d, V̇_d and τ_d at some times, and at the known instants between them.

    Parameters
    ----------
    start
        Q_d(0) and V_d(0).
    times : (n,)
        Times in increasing order from 0, s.
    """
    system, stop = ReferenceSystem.of(loop), float(times[-1])
    instants, *sides = together(system.instants(stop), times)
    inner = (instants > 0) & (instants < stop)
    instants, *sides = (times[inner] for times in (instants, *sides))
    times = distinct([*times, *instants])
    state = system.initial_state(*start, *start)
    states = np.broadcast_to(state, (len(times), len(state)))
    spent = None
    if len(state):
        engine = _Light(rtol=RTOL, atol=1e-3 * RTOL, max_steps=most_evaluations)
        solution = engine.solve(Problem(system, state[None], times))
        states = solution.states[0]
        if solution.status[0] == Status.STEP_LIMIT:
            spent = engine.max_steps
            solved = int(np.isfinite(states).all(axis=-1).sum())
            times, states = times[:solved], states[:solved]
            instants = instants[instants <= times[-1]]
    with np.errstate(all="ignore"):
        s = system.tracking(times, states)
        shown = Horizon(times, s.Qd, s.Vd, s.Vd_dot, s.tau_d + 0 * s.P, [], spent)
        if len(instants):
            there = states[np.searchsorted(times, instants)]
            before, after = (
                np.nextafter(*pair) for pair in zip(sides, (-np.inf, np.inf), strict=True)
            )
            left, right = (
                system.tracking(side[: len(instants)], there) for side in (before, after)
            )
            parts = loop.group.parts
            units = (parts[0].velocity_unit, parts[0].force_unit) if len(parts) == 1 else ("", "")
            shown = replace(shown, jumps=sorted(_jumps(shown, instants, units, left, right)))
    return shown


def _jumps(
    shown: Horizon, instants: Array, units: tuple[str, str], left: Tracking, right: Tracking
) -> Iterator[tuple[float, str, str]]:
    for what, scale, size, unit in (
        ("Q_d", shown.pose, frobenius(right.Qd - left.Qd), ""),
        ("V_d", shown.velocity, norm(right.Vd - left.Vd), units[0]),
        ("τ_d", shown.torque, norm(right.tau_d - left.tau_d + 0 * left.P), units[1]),
    ):
        largest = np.nanmax(np.abs(scale)) if np.isfinite(scale).any() else 0.0
        for t, by in zip(instants, size, strict=True):
            if by > max(JUMP * largest, LEAST_JUMP):
                yield float(t), what, f"{by:.3g} {unit}".strip()


def check_reference(shown: Horizon, most_torque: float | None, problems: Problems) -> list[str]:
    """Note where the reference is not finite, or needs more than a given torque.

    Returns
    -------
    list of str
        Remarks on jumps, which may be intended, and on a check that did not reach the end.
    """
    finite, sizes = shown.finite, norm(shown.torque)
    if not finite.all():
        t = shown.times[np.flatnonzero(~finite)[0]]
        problems.add(f"has no finite real value at about t = {t:.4g} s; correct its expressions")
    elif most_torque is not None and sizes.max() > most_torque:
        t = shown.times[sizes.argmax()]
        problems.add(
            f"needs a torque of {sizes.max():.4g} at t = {t:.4g} s, more than {most_torque:g}"
        )
    at: dict[str, list[str]] = {}
    for t, what, by in shown.jumps:
        at.setdefault(f"{what} jumps by {by} at t =", []).append(f"{t:g}")
    remarks = [f"{jump} {_listed(instants)} s" for jump, instants in at.items()]
    if shown.spent is not None:
        until = f"t = {shown.times[-1]:.4g} s only, after {shown.spent:,} evaluations"
        remarks.append(f"checked until {until}")
    return remarks


STEPS = 64
"""Least number of steps over a horizon: what is longer than such a step is no short pulse."""


@lru_cache(maxsize=1024)  # the points of a sweep have mostly the same expressions
def missed(expression: Expression, until: float, rtol: float) -> str:
    """Say what DOP853 would lose of an expression with steps that end at its instants.

    Its steps are the longest ones that the tolerance allows. Their sum is compared with bounds of
    the integral by intervals, which overlook nothing.
    """
    instants = instants_of([expression], until)
    bounds = bounds_of_integral(expression, until) if len(instants) else None
    if bounds is None:
        return ""
    ends, *sides = together(instants, np.array([0.0, until]))
    inner = (ends > 0) & (ends < until)
    before, after = sides[0] * (1 - ROUNDING), sides[1] * (1 + ROUNDING)
    # The ends of the horizon may be instants but for a rounding.
    starts = np.append(ROUNDING * until, after[inner])
    stops = np.append(before[inner], (1 - ROUNDING) * until)
    counts = np.maximum(1, np.ceil((stops - starts) * STEPS / until)).astype(int)
    parts = [np.linspace(*span) for span in zip(starts, stops, counts + 1, strict=True)]
    low, high = (np.concatenate([part[side] for part in parts]) for side in (np.s_[:-1], np.s_[1:]))
    weights, added, (least, most, size) = coefficients(), 0.0, bounds
    with np.errstate(all="ignore"):
        while len(low):
            h = high - low
            slopes = expression.evaluate({"t": low[:, None] + h[:, None] * weights["c"]})
            fifth, third = (slopes @ weights[f"ERROR_{n}"][0] for n in (5, 3))
            error = h * fifth**2 / np.sqrt(fifth**2 + 0.01 * third**2)
            large = (np.abs(error) > rtol * size) & (h > 1e-12 * until)
            added += float((h * (slopes @ weights["STEP"][0]))[~large].sum())
            low, middle, high = low[large], (low[large] + high[large]) / 2, high[large]
            low, high = np.append(low, middle), np.append(middle, high)
    allowed = JUMP * size + LEAST_JUMP * until
    if not (added < least - allowed or added > most + allowed):  # NaN is found elsewhere
        return ""
    return (
        f"'{shortened(expression.text)}' has pulses that steps miss: they would add {added:.6g} "
        f"until t = {until:g} s, and its integral is {(least + most) / 2:.6g}; write the pulses "
        "with pulse(t, period, from, to), or split the horizon"
    )


def _listed(instants: list[str]) -> str:
    """Return times, but of many the first and the last ones, and their number."""
    if len(instants) <= MOST_LISTED:
        return ", ".join(instants)
    return f"{', '.join(instants[: MOST_LISTED - 1])}, …, {instants[-1]} ({len(instants):,} times)"
