"""Remarks before a run: where an own law does not stay on its reference."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import norm
from eqt_cli.base.errors import KeyPath
from eqt_cli.base.registry import is_foreign
from eqt_cli.components.laws import RunsCode, counteracts
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon

TIMES = 9
"""Number of times of the reference at which a law is called."""

APART = 1e-6
"""Largest |τ − τ_d| that is only rounding, relative to that of τ_d and of the stiffness by 1 rad or
1 m: a root of a rounding error is 1e-8."""


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[tuple[KeyPath, str]]:
    """Yield own laws whose torque on the reference is not the one that drives it."""
    for label, loop in experiment.loops.items():
        law: Any = loop.controller
        is_own = is_foreign(type(law).__module__) and not isinstance(law, RunsCode)
        if not (is_own and counteracts(law) and "track" in law.tasks):
            continue
        shown = shown or experiment.reference_over_horizon()
        at = np.linspace(0, len(shown.times) - 1, TIMES).astype(int)
        times, Q, V = shown.times[at], shown.pose[at], shown.velocity[at]
        states = [loop.initial_state(q, v, q, v, t) for q, v, t in zip(Q, V, times, strict=True)]
        s = loop.holding(times).tracking(times, np.stack(states))
        with np.errstate(all="ignore"):  # its runs say what is no number
            apart, size = norm(law.torque(s) - s.tau_d), np.abs(s.tau_d).max()
        if not apart.max() > APART * (size + np.abs(s.stiffness).max()):
            continue
        worst = apart.argmax()
        until = ", until its memory has adapted" if law.memory(loop.group) else ""
        yield (
            ("controllers", experiment.laws[label].index),
            f"on the reference, without an error, its torque is up to {apart[worst]:.3g} from τ_d, "
            f"at {times[worst]:.4g} s, so that the body leaves it{until}; the feedforward "
            "s.relative.cancelling_feedforward would hold it there",
        )
