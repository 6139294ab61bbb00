"""Whether an experiment is numerically ill: an inertia that rounding spoils, a stiff loop."""

from typing import NamedTuple

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.linearised import flow
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Problem
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.local_stability import Along, small_loops
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw

EPSILON = float(np.finfo(float).eps)

ORDINARY = 20_000
"""Evaluations of the vector field, or steps, that nothing is said of: two seconds of a run by
itself. Of the shipped experiments `se3_survey` takes 14,000 for stability, most some hundreds."""

TRIAL = 1_500
"""Evaluations of a trial with an implicit method: half a second."""

ENOUGH = 0.02
"""Of the horizon: from a trial that came so far the whole is told. It was right to 20 % on SO(3)
and 1 % of the horizon; on the submersible 3,000 evaluations are spent on the first millisecond."""

SAMPLES = 4_001
"""At which it is looked how far the trial came."""


class Stiff(NamedTuple):
    """The loop that takes longest for its stability.

    Attributes
    ----------
    label
        Of its law.
    rates : (instants, n)
        The eigenvalues of the loop, 1/s.
    work
        What the engine takes, in what it counts.
    """

    label: str
    rates: Array
    work: float


def ill_conditioned(experiment: Experiment) -> str:
    """Why the inertia spoils velocities by rounding, in words; empty where it does not.

    V = 𝕀⁻¹P is known to about ε κ, with ε = 2.2e-16 and the condition number κ of the inertia in
    units that make its diagonal 1 (Higham 2002, Theorem 7.2 and Section 7.3): a mass in grams is
    no matter, nearly dependent axes are. Where ε κ exceeds `rtol`, no step can be that accurate.
    """
    loop, rtol = next(iter(experiment.loops.values())), experiment.engine.rtol
    times, numbers = _condition_numbers(loop.inertia, experiment.config.time.duration)
    worst = int(numbers.argmax())
    if numbers[worst] * EPSILON <= rtol:
        return ""
    when = "" if len(times) == 1 else f" at t = {times[worst]:.4g} s"
    return (
        f"its condition number is {numbers[worst]:.2g}{when}, so that rounding alone changes "
        f"velocities by {numbers[worst] * EPSILON:.1g} of their size, more than solver.rtol = "
        f"{rtol:g}; choose other axes, or increase solver.rtol"
    )


def _condition_numbers(law: InertiaLaw, horizon: float) -> tuple[Array, Array]:
    """Those of the inertia with its diagonal scaled to 1, at some instants."""
    times = np.zeros(1) if isinstance(law, Inertia) else np.linspace(0.0, horizon, 101)
    with np.errstate(all="ignore"):
        found = law.matrix_at(times)
    matrices = np.broadcast_to(found, (len(times), *found.shape[-2:]))
    roots = np.sqrt(np.diagonal(matrices, axis1=-2, axis2=-1))
    return times, np.linalg.cond(matrices / (roots[:, :, None] * roots[:, None, :]))


def stiff(experiment: Experiment, along: Along) -> str:
    """What a stiff loop costs by the engine, and what by others, in words; empty if none is stiff.

    A loop is stiff if the fastest decay of its errors asks for more than `ORDINARY` evaluations,
    and an implicit method takes fewer (Hairer and Wanner 1996, Section IV.1).

    Parameters
    ----------
    along
        Where on the reference loops are linearised.
    """
    found = _stiffest(experiment, along)
    if found is None:
        return ""
    loop, duration = experiment.loops[found.label], experiment.config.time.duration
    chosen, others = experiment.engine, []
    explicit = SolveIvp(rtol=chosen.rtol).work_for_stability(found.rates, duration)
    implicit, reached = _by_radau(experiment, loop)
    if not implicit < explicit:
        return ""  # it is long, and not stiff
    if implicit < found.work:
        told = f"about {_rounded(implicit)} evaluations" if reached > ENOUGH else "fewer"
        others.append(f"`solver.method: Radau` {told}")
    other = experiment.solver.other
    if other is not None and 0 < (work := other.work_for_stability(found.rates, duration)):
        others += [f"engine {other.name} about {_rounded(work)} {other.counted}"] * (
            work < found.work
        )
    if not others:
        return ""
    return (
        f"the loop of '{found.label}' is stiff: its errors decay at up to "
        f"{np.abs(found.rates).max():.2g} 1/s, for which engine {chosen.name} takes about "
        f"{_rounded(found.work)} {chosen.counted} a run; {', '.join(others)}"
    )


def _rounded(count: float) -> str:
    """A number with two digits: ``46,000``."""
    return f"{float(f'{count:.2g}'):,.0f}"


def _stiffest(experiment: Experiment, along: Along) -> Stiff | None:
    """The loop that takes the engine longest, if that is longer than `ORDINARY`."""
    found, engine = [], experiment.engine
    for label, loop in small_loops(experiment, along).items():
        matrices = flow(loop, *along)
        if np.isfinite(matrices).all():
            rates = np.linalg.eigvals(matrices)
            work = engine.work_for_stability(rates, experiment.config.time.duration)
            found.append(Stiff(label, rates, work))
    slowest = max(found, key=lambda each: each.work, default=None)
    return slowest if slowest and slowest.work > ORDINARY else None


def _by_radau(experiment: Experiment, loop: ClosedLoop) -> tuple[float, float]:
    """About how many evaluations a run takes by an implicit method, from how far a trial came.

    It starts where all errors are 0, since fast errors are gone in no time. Infinite where it came
    nowhere.
    """
    Qd, Vd, stop = experiment.initial_pose, experiment.initial_velocity, experiment.times[-1]
    engine = SolveIvp(method="Radau", rtol=experiment.engine.rtol, max_steps=TRIAL)
    states = loop.initial_state(Qd, Vd, Qd, Vd)[None]
    problem = Problem(loop, states, np.linspace(0.0, stop, SAMPLES))
    solution = engine.solve(problem)
    known = int(np.isfinite(solution.states[0]).all(axis=-1).sum()) - 1
    reached = known / (SAMPLES - 1)
    return (solution.steps[0] / reached if known else np.inf), reached
