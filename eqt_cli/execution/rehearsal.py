"""Begins a study as a run would, with two runs of every law, for `eqt config check`.

The runs are put together, solved and measured by what does so for a run. Nothing is kept.
"""

import time
import traceback
import warnings
from collections.abc import Hashable, Iterator
from contextlib import contextmanager

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.parts import LoopPart, parts_of
from eqt_cli.core.arrays import Array, norm
from eqt_cli.core.errors import EqtError, InputError, Problems
from eqt_cli.core.registry import described, place_of
from eqt_cli.engines import Problem
from eqt_cli.execution.batches import Batch, batches
from eqt_cli.experiment.study import Study
from eqt_cli.experiment.trial import TOGETHER

MOST_SECONDS = 3.0
"""Of one core, for all laws; those that are left then are named."""

ALONE = 1e-8
"""Relative: what the rates of a run may change by where others are beside it. Sums of another
length are rounded in another way, and differences of nearly equal numbers enlarge that."""


def rehearse(study: Study, problems: Problems) -> list[str]:
    """Note what would fail in a run: an exception, a shape, no number, what cannot be compiled.

    Returns
    -------
    list of str
        The laws that were not tried since those before them took too long, in words.
    """
    started, left = time.process_time(), dict.fromkeys(study.base.loops)
    for group in _by_kind(study):
        if time.process_time() - started > MOST_SECONDS:
            those = f"the laws before took more than {MOST_SECONDS:g} s"
            return [f"not tried: {', '.join(left)}; {those}"]
        label, first = group[0]
        components = parts_of(first.problem.loop, list(study.base.loops).index(label))
        with _blaming(components, problems):
            _begin([batch for _, batch in group], components)
        for label, _ in group:
            left.pop(label, None)
    return []


def _by_kind(study: Study) -> list[list[tuple[str, Batch]]]:
    """The first two runs of every law, and the first of the last point; equal structures together.

    So the numbers of a law come as ``(runs, 1)``, and two instances of a law are solved as one.
    """
    groups: dict[Hashable, list[tuple[str, Batch]]] = {}
    for index in sorted({0, len(study.shapes) - 1}):
        piece = study.piece(index)
        runs = piece.plan.runs
        entries = np.unique([0, min(1, runs - 1), (len(piece) - 1) * runs])
        for label in study.base.loops:
            for batch in batches(piece, label, entries):
                groups.setdefault((index, batch.kind), []).append((label, batch))
    return list(groups.values())


def _begin(group: list[Batch], components: list[LoopPart]) -> None:
    """Raise for the first thing that is wrong with these runs."""
    problem, engine = Problem.joined([batch.problem for batch in group]), group[0].engine
    law = components[0].name
    rates = _rates(problem)
    if not np.isfinite(rates).all():
        run = int(np.flatnonzero(~np.isfinite(rates).all(axis=-1))[0])
        name, value = _first_that_is_none(problem.loop, rates[run])
        raise InputError(f"{law} gives no number at the start: the rate of {name} is {value:g}")
    alone = [_rates(problem.select(slice(k, k + 1)))[0] for k in range(problem.runs)]
    change = norm(rates - np.array(alone))
    if (change > ALONE * (1 + norm(rates))).any():
        raise InputError(
            f"{law} mixes runs: the rates of a run change by {change.max():.2g} when it is solved "
            "beside others; sum over the last axis only, as the functions of eqt_cli.extend do"
        )
    engine.rehearse(problem)


def _rates(problem: Problem) -> Array:
    """The vector field at the start, ``(runs, n)``, behind what a sampled law does there."""
    loop, states, t = problem.batched_loop(), problem.states, float(problem.times[0])
    if loop.vehicle.control is not None:
        states = loop.after_instant(t, states, problem.errors_at(0))
    return loop.holding(t).vector_field(t, states)


def _first_that_is_none(loop: ClosedLoop, rates: Array) -> tuple[str, float]:
    """The stretch of a state that has a rate which is no number, and that number."""
    stretches = loop.layout.split(rates)
    name = next(name for name, values in stretches.items() if not np.isfinite(values).all())
    return name.replace("_", " "), float(stretches[name][~np.isfinite(stretches[name])][0])


@contextmanager
def _blaming(components: list[LoopPart], problems: Problems) -> Iterator[None]:
    """Note an exception at the component whose code raised it, with its line; else at the law.

    What nobody's component but eqt's own can have raised is raised again.
    """
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    except EqtError as error:
        problems.at(*_culprit(error.__cause__ or error, components).path).add(str(error))
    except Exception as error:
        if not any(component.is_foreign for component in components):
            raise
        culprit, place = _culprit(error, components), place_of(error)
        at = f" at {place}" if place else ""
        problems.at(*culprit.path).add(f"{culprit.name} fails {TOGETHER}: {described(error)}{at}")


def _culprit(error: BaseException, components: list[LoopPart]) -> LoopPart:
    """The component of the innermost line that is in the file of one that is not eqt's."""
    own = {type(c.part).__module__: c for c in reversed(components) if c.is_foreign}
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    modules = [str(frame.f_globals.get("__name__", "")) for frame in reversed(frames)]
    return next((own[module] for module in modules if module in own), components[0])
