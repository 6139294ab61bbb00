"""Detects numerical difficulties: an ill-conditioned inertia, or a stiff loop."""

from typing import NamedTuple

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.linearised import flow
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Problem
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.local_stability import Along, small_loops
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw

EPSILON = float(np.finfo(float).eps)

ORDINARY = 20_000
"""Largest number of evaluations of the vector field, or of steps, without a remark: two seconds for
a single run. For stability, most shipped experiments need some hundreds, `se3_survey` 14,000."""

TRIAL = 1_500
"""Number of evaluations of a trial with an implicit method: half a second."""

ENOUGH = 0.02
"""Share of the horizon that a trial must reach to extrapolate its evaluations. On SO(3), a
trial over 1 % of the horizon was right to 20 %. On the submersible, the first millisecond alone
takes 3,000 evaluations."""

SAMPLES = 4_001
"""Number of samples that show how far the trial came."""


class Stiff(NamedTuple):
    """The loop that needs most work for numerical stability.

    Attributes
    ----------
    label
        Label of its law.
    rates : (instants, n)
        Eigenvalues of the loop, 1/s.
    work
        Work of the engine, in the units that it counts.
    """

    label: str
    rates: Array
    work: float


def ill_conditioned(experiment: Experiment) -> str:
    """Return the words for a remark on an ill-conditioned inertia; empty if it is not.

    V = 𝕀⁻¹P is accurate to about ε κ, with ε = 2.2e-16 and the condition number κ of the inertia in
    units that make its diagonal 1 (Higham 2002, Theorem 7.2 and Section 7.3). So units do not
    matter, but nearly dependent axes do. If ε κ exceeds `rtol`, no step can be that accurate.
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
    """Return instants, and the condition numbers of the inertia with its diagonal scaled to 1."""
    times = np.zeros(1) if isinstance(law, Inertia) else np.linspace(0.0, horizon, 101)
    with np.errstate(all="ignore"):
        found = law.matrix_at(times)
    matrices = np.broadcast_to(found, (len(times), *found.shape[-2:]))
    roots = np.sqrt(np.diagonal(matrices, axis1=-2, axis2=-1))
    return times, np.linalg.cond(matrices / (roots[:, :, None] * roots[:, None, :]))


def stiff(experiment: Experiment, along: Along) -> str:
    """Return the words for a remark on the work for a stiff loop; empty if no loop is stiff.

    A loop is stiff if the fastest decay of its errors needs more than `ORDINARY` evaluations, and
    an implicit method needs fewer (Hairer and Wanner 1996, Section IV.1).

    Parameters
    ----------
    along
        Points of the reference at which loops are linearised.
    """
    found = _stiffest(experiment, along)
    if found is None:
        return ""
    loop, duration = experiment.loops[found.label], experiment.config.time.duration
    chosen, others = experiment.engine, []
    explicit = SolveIvp(rtol=chosen.rtol).work_for_stability(found.rates, duration)
    implicit, reached = _radau_evaluations(experiment, loop)
    if not implicit < explicit:
        return ""  # the horizon is long, but the loop is not stiff
    if implicit < found.work:
        count = f"about {_rounded(implicit)} evaluations" if reached > ENOUGH else "fewer"
        others.append(f"`solver.method: Radau` {count}")
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
    """Format a number with two digits: ``46,000``."""
    return f"{float(f'{count:.2g}'):,.0f}"


def _stiffest(experiment: Experiment, along: Along) -> Stiff | None:
    """Return the loop with the most work, if that is more than `ORDINARY`; else None."""
    found, engine = [], experiment.engine
    for label, loop in small_loops(experiment, along).items():
        matrices = flow(loop, *along)
        if np.isfinite(matrices).all():
            rates = np.linalg.eigvals(matrices)
            work = engine.work_for_stability(rates, experiment.config.time.duration)
            found.append(Stiff(label, rates, work))
    slowest = max(found, key=lambda each: each.work, default=None)
    return slowest if slowest and slowest.work > ORDINARY else None


def _radau_evaluations(experiment: Experiment, loop: ClosedLoop) -> tuple[float, float]:
    """Estimate the evaluations of a run by an implicit method from the progress of a trial.

    The trial starts without errors, because fast errors decay at once. The estimate is infinite if
    the trial makes no progress. The second value is the share of the horizon that it reached.
    """
    Qd, Vd, stop = experiment.initial_pose, experiment.initial_velocity, experiment.times[-1]
    engine = SolveIvp(method="Radau", rtol=experiment.engine.rtol, max_steps=TRIAL)
    states = loop.initial_state(Qd, Vd, Qd, Vd)[None]
    problem = Problem(loop, states, np.linspace(0.0, stop, SAMPLES))
    solution = engine.solve(problem)
    known = int(np.isfinite(solution.states[0]).all(axis=-1).sum()) - 1
    reached = known / (SAMPLES - 1)
    return (solution.steps[0] / reached if known else np.inf), reached
