"""Tunes every law on every training sample: all of them side by side, batch by batch."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, cast

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.base import files
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER
from eqt_cli.base.reporting import brief, count_of, reporter
from eqt_cli.config.document import Document
from eqt_cli.config.study import study
from eqt_cli.extensions.search.candidates import computed
from eqt_cli.extensions.search.exchanges import (
    FEWEST_EXCHANGING,
    SETTLED,
    is_small,
    more_of,
    rounds_of,
)
from eqt_cli.extensions.search.fronts import Constraint
from eqt_cli.extensions.search.keys import TuneSection
from eqt_cli.extensions.search.law_search import LawSearch, SearchFolder
from eqt_cli.extensions.search.model_search import Best, ModelSearch, Tried
from eqt_cli.extensions.search.record import AS_IT_IS, values_text
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.extensions.search.search import columns, swept
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.result import mean_over_runs
from eqt_cli.runs.executors import Executor


class Sampled(Protocol):
    """A search on training samples: what `tune.Search` says of itself."""

    @property
    def section(self) -> TuneSection: ...
    @property
    def laws(self) -> tuple[LawSearch, ...]: ...
    @property
    def objectives(self) -> tuple[str, ...]: ...
    @property
    def bounds(self) -> tuple[Constraint, ...]: ...
    @property
    def scored_metrics(self) -> list[str]: ...
    @property
    def samples(self) -> range: ...
    @property
    def points(self) -> int: ...
    @property
    def runs_at_a_point(self) -> int: ...
    @property
    def budget(self) -> int: ...
    def by_models(
        self,
        law: LawSearch,
        sample: int,
        free: Sequence[int] | None = None,
        tried: Tried | None = None,
    ) -> ModelSearch | Fixed: ...
    def on_sample(self, document: Document, sample: int) -> Document: ...
    def in_cases(self, law: LawSearch) -> dict[str, LawSearch]: ...


@dataclass(frozen=True, eq=False)
class Training:
    """A law on one training sample.

    Attributes
    ----------
    law
        The search for the law.
    sample
        Number of the sample, from 1.
    free
        The coordinates that are searched.
    """

    law: LawSearch
    sample: int
    free: tuple[int, ...] = ()

    def snapped(self, shares: Array) -> Array:
        """Return the points of the unit cube whose values can be set, as whole numbers can."""
        axes = [self.law.axes[self.law.order[k]] for k in self.free]
        if not any(axis.integer for axis in axes):
            return shares
        at = [[a.share(a.at(x)) for a, x in zip(axes, row, strict=True)] for row in shares.tolist()]
        return np.array(at).reshape(shares.shape)


@dataclass
class Fixed:
    """In place of a search, the one point of a law without keys, whatever the bounds are."""

    tried: Tried | None = None

    def points(self) -> Generator[Array, Tried, Best]:
        """Yield the point; what is sent back says how good it is."""
        self.tried = yield np.empty((1, 0))
        return Best(self.tried, self.best(), "sure")

    def best(self) -> int | None:
        """Return the point; None if no run has a number."""
        return 0 if self.tried is not None and np.isfinite(self.tried.costs[0]) else None


Batches = Generator[dict[int, Array], dict[int, Tried], dict[int, Best]]
"""Yields points by sample, gets how good they are, and returns what was found on every sample."""

Going = dict[int, "ModelSearch | Fixed"]
"""The searches of a law that are under way, by sample."""


def trained(search: Sampled, folder: SearchFolder, executor: Executor) -> dict[Training, Best]:
    """Find the best point of every law on every training sample.

    A batch has points of all searches that have not ended, and runs them side by side. What it
    gives is written once, so that a search goes on from there bit for bit.
    """
    keys = [{sample: Training(law, sample) for sample in search.samples} for law in search.laws]
    going: list[Going] = [{} for _ in search.laws]
    courses = [_course(search, *of_law) for of_law in zip(keys, going, strict=True)]
    ended, number = dict[Training, Best](), 0
    with threadpool_limits(1):  # models must not depend on how a library splits a product
        wanted = {k: next(course) for k, course in enumerate(courses)}
        while wanted:
            proposed = {keys[k][s]: x for k, points in wanted.items() for s, x in points.items()}
            answers = _answers(search, folder, number, proposed, executor)
            number, before, wanted = number + 1, wanted, {}
            for k, points in before.items():
                try:
                    wanted[k] = courses[k].send({s: answers[keys[k][s]] for s in points})
                except StopIteration as stopped:
                    ended |= {keys[k][s]: best for s, best in stopped.value.items()}
            for law, of_law in zip(search.laws, going, strict=True):
                reporter().note(law.label, _so_far(search, law, of_law))
    tried = sum(len(best.tried) for best in ended.values())
    reporter().skip((search.points - tried) * search.runs_at_a_point)
    return {key: ended[key] for of_law in keys for key in of_law.values()}


def _course(search: Sampled, keys: Mapping[int, Training], going: Going) -> Batches:
    """Search for a law on all samples; other laws change nothing of it."""
    (law, *_) = (key.law for key in keys.values())
    return (yield from _within(search, keys, going, tuple(range(len(law.axes))), {}))


def _within(
    search: Sampled,
    keys: Mapping[int, Training],
    going: Going,
    free: tuple[int, ...],
    ended: dict[tuple[int, ...], dict[int, Best]],
) -> Batches:
    """Search some coordinates of a law: each sample by itself, then with the others' best points.

    The laws that it contains are searched first. Their points count as tried, so that it is never
    worse on the training runs.

    Parameters
    ----------
    free
        The coordinates; the others are 0, which leaves their numbers out.
    ended
        What was found in fewer coordinates, which is extended.
    """
    (law, *_) = (key.law for key in keys.values())
    before: dict[int, Tried | None] = dict.fromkeys(keys)
    optional = [k for k in law.optional if k in free and len(free) > 1]
    for number in optional:
        rest = tuple(k for k in free if k != number)
        if rest not in ended:
            ended[rest] = yield from _within(search, keys, going, rest, ended)
        for sample, best in ended[rest].items():
            whole = np.insert(best.tried.shares, free.index(number), 0.0, axis=1)
            tried, earlier = replace(best.tried, shares=whole), before[sample]
            before[sample] = tried if earlier is None else earlier.joined(tried)
    for sample, key in keys.items():
        going[sample] = search.by_models(key.law, sample, free, before[sample])

    def abreast(steps: Mapping[int, Generator[Array, Tried, Best]]) -> Batches:
        lifted = {s: _lifted(step, free, len(law.axes)) for s, step in steps.items()}
        return (yield from _abreast(lifted))

    best_ones = yield from abreast({sample: one.points() for sample, one in going.items()})
    for _ in range(rounds_of(search.budget) if len(keys) >= FEWEST_EXCHANGING else 0):
        best_ones |= yield from abreast(_exchanges(search, going, best_ones))
        if all((one.gained or 0.0) <= SETTLED for one in best_ones.values()):
            break
    if is_small(search.budget, len(free)):  # too few points to say how far from the best they are
        best_ones = {sample: replace(one, gained=None) for sample, one in best_ones.items()}
    return best_ones


def _exchanges(
    search: Sampled, going: Going, best: Mapping[int, Best]
) -> dict[int, Generator[Array, Tried, Best]]:
    """Return how the samples of a law go on from the best points of the others."""
    steps = {}
    for sample, one in going.items():
        others = _best_points(best, sample)
        if isinstance(one, ModelSearch) and len(others):
            steps[sample] = one.exchanged(others, more_of(search.budget))
    return steps


def _best_points(best: Mapping[int, Best], sample: int) -> Array:
    """Return the best points of the other samples."""
    others = [one for number, one in best.items() if number != sample and one.point is not None]
    return np.array([one.tried.shares[one.point] for one in others])


def _lifted(
    step: Generator[Array, Tried, Best], free: Sequence[int], axes: int
) -> Generator[Array, Tried, Best]:
    """Return a search of some coordinates as one that asks for points with all of them."""
    answer: Any = None
    while True:
        try:
            points = step.send(answer)
        except StopIteration as stopped:
            return cast(Best, stopped.value)
        whole = np.zeros((len(points), axes))
        whole[:, free] = points
        answer = replace((yield whole), shares=points)


def _abreast(steps: Mapping[int, Generator[Array, Tried, Best]]) -> Batches:
    """Take the searches of several samples side by side, batch by batch."""
    ended, wanted = dict[int, Best](), dict[int, Array]()
    answers: dict[int, Tried | None] = dict.fromkeys(steps)
    while answers:
        wanted = {}
        for sample, answer in answers.items():
            try:
                wanted[sample] = steps[sample].send(answer)  # type: ignore[arg-type]
            except StopIteration as stopped:
                ended[sample] = stopped.value
        answers = dict((yield wanted)) if wanted else {}
    return {sample: ended[sample] for sample in steps}


def _so_far(search: Sampled, law: LawSearch, going: Going) -> str:
    """Describe the best point of the first sample of a law so far."""
    of_law = [*going.values()]
    points = sum(0 if one.tried is None else len(one.tried) for one in of_law)
    done = f"{count_of(points, 'point')} on {count_of(len(of_law), 'training sample')}"
    first = of_law[0]
    best = first.best()
    if best is None or first.tried is None:
        return f"{done}, no feasible point so far"
    shares = first.tried.shares[best].tolist()  # fewer where a law that it contains is searched
    values = values_text(law.values(shares)) if len(shares) == len(law.axes) else "fewer numbers"
    values = values or AS_IT_IS
    cost = quantity_of(search.objectives[0]).cost(first.tried.costs[best])
    return f"{done}, best so far: {search.objectives[0]} {brief(float(cost))} at {values}"


def _answers(
    search: Sampled,
    folder: SearchFolder,
    number: int,
    proposed: Mapping[Training, Array],
    executor: Executor,
) -> dict[Training, Tried]:
    """Return how good the points of a batch are: as its file says, else by running them."""
    path = folder.batch(number)
    with files.refusals(folder.path, "used", OTHER_FOLDER):
        stored = (files.read_record(path, "tried") or {"tried": {}})["tried"]
    read = {key: _read(stored.get(_name(key)), points) for key, points in proposed.items()}
    answers = {key: answer for key, answer in read.items() if answer is not None}
    missing = {key: points for key, points in proposed.items() if key not in answers}
    reporter().skip(sum(map(len, answers.values())) * search.runs_at_a_point)
    if missing:
        answers |= (added := _run(search, missing, executor, tried=number > 0))
        stored |= {_name(key): _written(answer) for key, answer in added.items()}
        with files.refusals(folder.path, "used", OTHER_FOLDER):
            path.parent.mkdir(parents=True, exist_ok=True)
            files.write_record(path, {"tried": stored})
    return {key: answers[key] for key in proposed}


def _name(key: Training) -> str:
    return f"{key.law.slug}, sample {key.sample}"


def _written(tried: Tried) -> dict[str, Any]:
    return {field.name: getattr(tried, field.name).tolist() for field in fields(tried)}


def _read(record: Any, points: Array) -> Tried | None:
    """Return what a file holds of these very points; None if it holds no such thing."""
    if record is None:
        return None
    arrays = {field.name: np.array(record[field.name], dtype=float) for field in fields(Tried)}
    if not np.array_equal(arrays["shares"], points):
        return None
    return Tried(**arrays | {"measured": arrays["measured"].reshape(len(points), -1)})


def _run(
    search: Sampled, proposed: Mapping[Training, Array], executor: Executor, *, tried: bool
) -> dict[Training, Tried]:
    """Run the points of each training in every case of its law, and return how good they are.

    All are computed together, a study for each training and case; `tried` is whether one was
    computed before.
    """
    trainings, studies = [], []
    for training, points in proposed.items():
        for case in search.in_cases(training.law).values():
            trainings.append(training)
            sweep = swept(case, columns(case, points))
            studies.append(study(search.on_sample(sweep, training.sample)))
    cases: dict[Training, list[Numbers]] = {training: [] for training in proposed}
    numbers = computed(studies, search.scored_metrics, executor, tried=tried)
    for training, of_case in zip(trainings, numbers, strict=True):
        cases[training].append(of_case)
    worst = search.section.over_cases == "worst"
    return {
        training: _judged(search, points, cases[training], worst=worst)
        for training, points in proposed.items()
    }


def _judged(search: Sampled, points: Array, cases: Sequence[Numbers], *, worst: bool) -> Tried:
    """Return how good points are, over the cases."""
    scored = [_measured(search, case) for case in cases]
    (costs, measured, lost, unsettled) = (np.array(column) for column in zip(*scored, strict=True))
    held = []
    for bound, column in zip(search.bounds, np.moveaxis(measured, -1, 0), strict=True):
        if bound.equal:  # over the cases; others hold in each
            held.append(column.mean(axis=0)[:, None])
        else:
            held.append((column.max(axis=0) if bound.above else column.min(axis=0))[:, None])
    return Tried(
        points,
        costs.max(axis=0) if worst else costs.mean(axis=0),
        np.concatenate(held, axis=1) if held else np.empty((len(points), 0)),
        lost.mean(axis=0),
        unsettled.sum(axis=0),
    )


def _measured(search: Sampled, numbers: Numbers) -> tuple[Array, Array, Array, Array]:
    """Return cost, bounded numbers ``(points, bounds)``, lost share, and unsettled runs of a case.

    All are over the runs that have all numbers; the others are lost.
    """
    (objective,) = search.objectives
    names = dict.fromkeys([objective, *(bound.metric for bound in search.bounds)])
    values = {name: numbers.counted(name)[:, 0] for name in names}
    complete = np.isfinite([*values.values()]).all(axis=0)
    values = {name: np.where(complete, value, np.nan) for name, value in values.items()}
    cost = quantity_of(objective).cost(mean_over_runs(values[objective]))
    bounded = [_bounded(bound, values[bound.metric]) for bound in search.bounds]
    settling = numbers.metric("settling_time")[:, 0]
    unsettled = (numbers.good[:, 0] & np.isnan(settling)).sum(axis=1)
    measured = np.stack(bounded, axis=1) if bounded else np.empty((len(cost), 0))
    return cost, measured, (~complete).mean(axis=1), unsettled


def _bounded(bound: Constraint, values: Array) -> Array:
    """Return what is bounded at each point: the mean over runs, or the worst one."""
    if not bound.every_run:
        return mean_over_runs(values)
    ends = np.where(np.isnan(values), -np.inf if bound.above else np.inf, values)
    worst = ends.max(axis=-1) if bound.above else ends.min(axis=-1)
    return np.where(np.isfinite(worst), worst, np.nan)
