"""Runs that ended at the limit of steps: whether their loops are unstable."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.store_reader import ResultFile

LIMIT = "step limit"
"""What the messages of such runs begin with."""


@purposes.remarks_on_a_result
def remarks(result: ResultFile) -> Iterator[str]:
    """Yield the laws whose runs ended at the limit of steps, and the growth of their errors."""
    of: Any = result
    if not getattr(of, "status", np.zeros(0)).any() or of.is_sweep:
        return
    laws = _laws(of)
    rates = _rates(of) if laws else {}
    for label in laws:
        rate = rates.get(label)
        if rate is not None and rate > 0:
            yield (
                f"{label} ended at solver.max_steps, and its loop is unstable: frozen at the worst "
                f"time along the reference, small errors grow at {rate:.2g} 1/s (`eqt margins`); "
                "no tolerance corrects that"
            )
        elif rate is not None:
            yield f"{label} ended at solver.max_steps, though its small errors decay"


def _laws(result: Any) -> list[str]:
    """Return the laws with such runs; none of a result without messages."""
    with suppress(EqtError):
        places = result.failures[:100]
        messages = zip(places, result.messages(places), strict=True)
        return sorted({result.labels[where[0]] for where, said in messages if LIMIT in said})
    return []


def _rates(result: Any) -> dict[str, float]:
    """Return the largest growth of small errors by law, 1/s; none where it cannot be computed."""
    from eqt_cli.api.loading import load_experiment  # slow to import
    from eqt_cli.config.remarks import along_reference
    from eqt_cli.loop.growth import growth
    from eqt_cli.loop.linearised import linearised, off_limits

    rates = dict[str, float]()
    try:
        experiment = load_experiment(result.path).base
        along = along_reference(experiment, experiment.reference_over_horizon())
        for label, loop in experiment.loops.items():
            with np.errstate(all="ignore"):
                linear = linearised(off_limits(loop), *along)
            if np.isfinite(linear.closed).all():
                rates[label] = float(growth(linear).rate)
    except (EqtError, ValueError, ArithmeticError, AttributeError, AssertionError):
        pass
    return rates
