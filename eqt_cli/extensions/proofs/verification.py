"""Checks the certificates of a configuration, by a few runs, or of a result, by its content."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.api.loading import Configuration, experiment_at, open_at
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import EqtError
from eqt_cli.base.registry import blamed
from eqt_cli.base.reporting import RUNS_DONE, InNotebook, count_of, reporter, step
from eqt_cli.base.stored import Status
from eqt_cli.components.initial_states import Stream, generator
from eqt_cli.components.laws import EqT, RunsCode
from eqt_cli.components.mechanics import Gains
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.config.document import document_of
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import along_reference, gains_flown, remark_on, small_loops
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Engine, Solution
from eqt_cli.engines.native import compiled_if_faster
from eqt_cli.extensions.proofs import certificates
from eqt_cli.extensions.proofs.run_checks import StepsEndAtTimes, window_times
from eqt_cli.extensions.proofs.sample import ExactStates, Sample, sampled
from eqt_cli.loop.bounds import bounds_of
from eqt_cli.loop.growth import Along, growth
from eqt_cli.loop.linearised import linearised
from eqt_cli.numbers.leaves import with_fields
from eqt_cli.results.result import Result
from eqt_cli.runs.batches import Batch, batches
from eqt_cli.runs.bounds import crossings
from eqt_cli.runs.compute_part import Desired, measured, shared_reference
from eqt_cli.runs.preflight import rehearse

RUNS = 20
"""Number of runs per law that check a configuration, unless it has fewer."""

FEW_RUNS = 3
"""Number of runs per law that are integrated again, for states that a result does not hold
and for the nodes of the momentum balance."""

TIGHTER, FINEST = 1e-3, 1e-12
"""Factor of the tolerances with which momentum is balanced, and the least relative one."""

JUDGED = ("energy_residual", "group_drift", "final_pose_error", "final_velocity_error")
"""Metrics of a result that certificates use."""

SHOWN = ("lyapunov", "pose_error", "velocity_error")
"""Signals of a result that certificates use if it has them."""

OF_ESTIMATE = ("nees", "nees_dof", "innovations", "innovation_square", "innovation_correlation")
"""Those of a law that reads the estimate of a filter with a covariance."""

_MARKS = {"hold": "✓ ", "proved": "✓ ", "fail": ""}
"""What stands before the number of rows of a verdict; before all others a question mark."""

INTEGRATED = "runs integrated again"
"""Title of the step that computes states which a result does not hold."""


@dataclass(frozen=True, repr=False)
class Verification(InNotebook):
    """The outcome of a verification.

    Attributes
    ----------
    rows
        Identities, trajectories, hypotheses, each in the paper's order.
    runs, failed_runs
        Numbers of runs over all controllers.
    experiment
        The verified experiment.
    engines
        Names of the engines that integrated the runs.
    departing
        How poles of laws along the reference are not those at Q_d = I, by label. Stiffness and
        damping of small errors are checked there.
    """

    rows: list[certificates.Row]
    runs: int
    failed_runs: int
    experiment: Experiment
    engines: list[str]
    departing: Mapping[str, str] = field(default_factory=dict)

    @property
    def failures(self) -> list[certificates.Row]:
        """The rows that refute a statement."""
        return [row for row in self.rows if row.verdict is certificates.Verdict.FAILS]

    @property
    def titled(self) -> list[certificates.Row]:
        """The rows, with titles in place of the labels of laws."""
        return certificates.with_titles(self.rows, self.experiment.titles)

    def causes(self, titles: Mapping[str, str]) -> list[str]:
        """Return the reasons why the exit code of `eqt verify` is not 0, laws by these titles."""
        some = f"{self.failed_runs} of {count_of(self.runs, 'run')} failed"
        causes = [some] if self.failed_runs else []
        for row in certificates.with_titles(self.failures, titles):
            law = f" ({row.controller})" if row.controller else ""
            causes.append(f"{row.statement}: {row.name}{law} fails")
        return causes

    def answer(self) -> list[str]:
        """Return how many statements hold, what fails, and what is open, a line for each cause."""
        name, group = self.experiment.name, self.experiment.group.name
        counts, engines = certificates.tally(self.titled).split(", "), " and ".join(self.engines)
        titles = self.experiment.titles
        return [
            "   ".join(_MARKS.get(count.split(" ", 1)[1], "? ") + count for count in counts),
            *self.causes(titles),
            *certificates.open_rows(self.titled),
            *(f"small errors of {titles[law]}: {words}" for law, words in self.departing.items()),
            f"{name} on {group}, {self.runs} runs with engine {engines}",
        ]

    def records(self) -> list[dict[str, Any]]:
        """Return a record per row."""
        return [asdict(row) for row in self.rows]


def verify(
    target: Study | Configuration,
    *,
    runs: int | None = None,
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    exact: bool = False,
) -> Verification:
    """Check the paper's statements on an experiment or on the runs of a result.

    Parameters
    ----------
    target
        A result folder or file, whose stored runs are checked; or a `Study` or a configuration, of
        which new runs are computed.
    runs
        Number of new runs per law, at most that of the experiment. Default: 20.
    point
        Point of a sweep, counted from 0. Default for an experiment: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.
    workers
        Number of cores to use.
    exact
        Whether to prove identities with exact numbers. Proved rows have ``degree``, ``points`` and
        ``probability``.

    Returns
    -------
    Verification
        Each of its ``rows`` has a verdict; ``failures`` are the rows that refute a statement.

    Raises
    ------
    EqtError
        If the target cannot be read, or is the result of a sweep and ``point`` is missing.

    Examples
    --------
    >>> eqt_cli.verify("results/paper").failures
    []
    """
    if isinstance(target, str | os.PathLike):
        path = Path(target)
        if path.suffix == ".h5" or path.is_dir():
            if runs is not None:
                raise EqtError(f"{path}: a result is verified as it is; leave runs out")
            with open_at(path, point) as opened:
                return verify_stored(opened, trust_plugins, workers, exact)
    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    remark_on(experiment)
    count = min(runs or RUNS, experiment.config.ensemble.runs)
    return verify_experiment(experiment, count, workers, exact)


@blamed()
def verify_experiment(
    experiment: Experiment, runs: int = RUNS, workers: int = 1, exact: bool = False
) -> Verification:
    """Check every certificate, the trajectories on the first `runs` runs of each controller.

    Parameters
    ----------
    exact
        Whether identities are to be proved.
    """
    with threadpool_limits(1):
        verifier = _Verifier(experiment, runs, workers, exact)
        desired = shared_reference(verifier.study)
        with step(RUNS_DONE, verifier.study.plans.total):
            laws = [verifier.runs_of(label, desired) for label in experiment.loops]
        return verifier.verification(laws, desired)


@blamed()
def verify_stored(
    results: Result, trust_plugins: bool, workers: int = 1, exact: bool = False
) -> Verification:
    """Check every certificate of the experiment, or the point, that a result holds.

    Trajectories are those that are stored.

    Raises
    ------
    EqtError
        If the result is a sweep's, or its experiment cannot be built, as without its plugins.
    """
    experiment = build(document_of(results, trust_plugins))
    results.single("one experiment is verified")
    with threadpool_limits(1):
        runs = min(FEW_RUNS, experiment.config.ensemble.runs)
        verifier = _Verifier(experiment, runs, workers, exact)
        if results.has("desired_pose"):
            desired = {name: results[name] for name in ("desired_pose", "desired_velocity")}
            for name, values in desired.items():
                if not np.isfinite(values[0]).all():
                    raise results.refusal(f"its '{name}' is not finite at the start")
        else:  # of a sweep that keeps metrics only
            desired = shared_reference(verifier.study)
        with step(INTEGRATED, runs * len(experiment.loops)):
            laws = [verifier.runs_of(label, desired, results) for label in experiment.loops]
        return verifier.verification(laws, desired)


@purposes.certificates_of_a_report
def certificates_of(result: Result, trust_plugins: bool, workers: int) -> dict[str, Any]:
    """Return tables of a report: of all certificates of a result, and of those in doubt."""
    rows = verify_stored(result, trust_plugins, workers).rows
    rows = certificates.with_titles(rows, result.title_of)
    table = certificates.certificate_table
    return {"certificates": table(rows), "doubts": table(rows, brief=True)}


@dataclass(frozen=True)
class _Verifier:
    """An experiment of which some runs per law are integrated, as a run would do it."""

    experiment: Experiment
    runs: int
    workers: int
    exact: bool
    flown: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    """Sample times and flat states of the good runs, by label."""
    engines: dict[str, None] = field(default_factory=dict)
    """Names of the engines that integrated runs, in order."""

    @cached_property
    def study(self) -> Study:
        """The first runs of the experiment."""
        first = Study(None, self.experiment.of_runs(self.runs))
        rehearse(first)
        return first

    def runs_of(
        self, label: str, reference: Desired, stored: Result | None = None
    ) -> certificates.Runs:
        """The runs that a result stores or, without one, those of the study.

        A result holds no states: these are always those of the study.
        """
        [batch] = batches(self.study, label, np.arange(self.study.plan.runs))
        solution = self._solved(batch)
        loop, threshold = batch.problem.loop, self.experiment.config.settling_threshold
        by_parts = isinstance(threshold, dict)
        names = (*JUDGED, "settling_time") if by_parts else JUDGED
        of_estimate = OF_ESTIMATE if loop.vehicle.knows_covariance else ()
        optional = (*SHOWN, *of_estimate, *loop.task.errors.values())
        if stored is None:
            with np.errstate(all="ignore"):  # runs that failed are NaN, or large
                values = measured(batch, solution, reference, (*names, *optional))
            values |= {"time": batch.problem.times, "status": solution.status}
        else:
            index = list(self.experiment.loops).index(label)
            names = (*names, "status", *filter(stored.has, optional))
            values = {name: stored.read(name, controller=index) for name in names}
            values["time"] = stored["time"]
        values |= {name: values[x] for name, x in loop.task.errors.items() if x in values}
        self.flown[label] = batch.problem.times, solution.states[solution.status == 0]
        good = values["status"] == 0

        def of_good(array: Array) -> Any:
            return array if good.all() else array[good[: len(array)]]  # all need no copy

        signals, estimate = (
            {name: of_good(values[name]) for name in names if name in values}
            for names in (SHOWN, of_estimate)
        )
        return certificates.Runs(
            label=label,
            claims_decrease=loop.claims_decrease,
            rtol=batch.engine.rtol,
            threshold=loop.task.bound(threshold, loop.group),
            settled=np.isfinite(values["settling_time"][good]) if by_parts else None,
            times=values["time"],
            **{"lyapunov": None, **signals},
            **{name: values[name][good] for name in JUDGED},
            failed=int(np.count_nonzero(~good)),
            departures=loop.departures,
            vehicle=self._vehicle(batch, solution),
            energy=loop.controller.energy,
            theorem=loop.controller.theorem,
            estimate=estimate if of_estimate else None,
            desired_speed=float(np.nanmax(norm(reference["desired_velocity"]))),
            rate=self._rate(label),
            barrier=loop.task.barrier(loop.controller, loop.gains, loop.reference),
            leaves_spin=len(loop.task.free(loop.gains)) > 1,
        )

    def _solved(self, batch: Batch) -> Solution:
        """The runs of a batch, of which those that cross a bound of `failed_when` have failed."""
        engine = self._engine(batch)
        solution = engine.solve(batch.problem, self.workers, reporter().advance)
        if most := self.experiment.config.failed_when:
            bounds = bounds_of(most, batch.problem.loop)
            solution.status[list(crossings(bounds, engine, batch.problem))] = Status.BOUND_CROSSED
        return solution

    def _engine(self, batch: Batch) -> Engine:
        """The engine of the runs of a batch; noted for the summary."""
        engine = compiled_if_faster(batch.engine, batch.problem)
        self.engines[engine.name] = None
        return engine

    @cached_property
    def _along(self) -> Along:
        """The reference where small errors are judged."""
        return along_reference(self.experiment, self.experiment.reference_over_horizon())

    def _rate(self, label: str) -> float | None:
        """The rate at which small errors decay, 1/s; None if it is not known, or they grow."""
        loop = small_loops(self.experiment, self._along).get(label)
        with np.errstate(all="ignore"):
            linear = None if loop is None else linearised(loop, *self._along)
        if linear is None or linear.at_rest is None or not np.isfinite(linear.closed).all():
            return None
        rate = -growth(linear.at_rest).rate
        return rate if rate > 0 else None

    def _vehicle(self, batch: Batch, solution: Solution) -> certificates.VehicleRuns | None:
        """The good runs of a loop that is not ideal."""
        if batch.problem.loop.vehicle.is_ideal:
            return None
        good = np.flatnonzero(solution.status == 0)
        seed = self.experiment.config.ensemble.seed
        problem = batch.problem.select(good)
        runs = certificates.VehicleRuns(problem, solution.states[good], seed, good)
        few = np.arange(min(len(good), FEW_RUNS))
        if not len(few):
            return runs
        selected = runs.problem.select(few)
        problem = StepsEndAtTimes.of(selected, window_times(selected))
        engine = self._engine(batch)
        if (factor := max(TIGHTER, FINEST / engine.rtol)) < 1:
            engine = engine.tightened(factor)
        states, atol = engine.solve(problem, self.workers).states, getattr(engine, "atol", 0.0)
        few_runs = certificates.VehicleRuns(problem, states, seed, good[few])
        return replace(runs, windows=replace(few_runs, rtol=engine.rtol, atol=atol))

    def verification(self, runs: list[certificates.Runs], desired: Desired) -> Verification:
        """All rows."""
        Qd, Vd = desired["desired_pose"], desired["desired_velocity"]
        loops, horizon = self.experiment.loops, float(self.experiment.times[-1])
        finite = np.isfinite(Qd).all(axis=(-2, -1)) & np.isfinite(Vd).all(axis=-1)
        times = np.linspace(0.0, horizon, len(Qd))[finite]
        rigid = self.experiment.config.rigid is not False
        rows = [
            *identities_of(self.experiment, exact=self.exact),
            *certificates.trajectory_rows(runs),
            *certificates.hypothesis_rows(
                certificates.Setting(loops, times, Qd[finite], Vd[finite], rigid, self.exact)
            ),
        ]
        # Code is compared with the law that it claims to be.
        for index, (label, loop) in enumerate(loops.items(), start=1):
            if isinstance(law := loop.controller, RunsCode):
                random, flown = _random(self.experiment, index, Stream.CODE), self.flown.get(label)
                rows += law.judged(label, loop, horizon, random, flown)
        failed = sum(run.failed for run in runs)
        count = sum(run.count for run in runs) + failed
        small = gains_flown(self.experiment)
        departing = {label: x.departs for label, x in small.items() if x.departs}
        return Verification(rows, count, failed, self.experiment, list(self.engines), departing)


def identities_of(experiment: Experiment, *, exact: bool = False) -> list[certificates.Row]:
    """Check every identity of an experiment, which needs no runs.

    Parameters
    ----------
    exact
        Whether they are to be proved.
    """
    horizon = float(experiment.times[-1])
    loops = {
        label: replace(loop.inside, controller=law)
        for label, loop in experiment.loops.items()
        if (law := loop.inside.controller.formula) is not None
    }
    any_loop = experiment.loop
    if any_loop.inside is not any_loop:
        G = any_loop.group
        any_loop = replace(any_loop, gains=Gains(np.eye(G.size), np.eye(G.dimension)))
    any_loop = replace(any_loop, controller=EqT())
    samples = []
    for index, (label, loop) in enumerate([("", any_loop), *loops.items()]):
        sample = sampled(label, loop, horizon, _random(experiment, index, Stream.CERTIFICATES))
        if exact:
            random = _random(experiment, index, Stream.EXACT_STATES)
            sample = replace(sample, exact=ExactStates(label, loop, random))
        samples.append(sample)
    return certificates.identity_rows(samples[0], samples[1:], list(_cascades(experiment, horizon)))


@purposes.identities_of_laws
def tallies(experiment: Experiment) -> dict[str, str]:
    """Return how many identities of each law hold, in words, by its label."""
    rows, tally = identities_of(experiment), certificates.tally
    return {x: tally([row for row in rows if row.controller == x]) for x in experiment.loops}


def _cascades(experiment: Experiment, horizon: float) -> Iterator[Sample]:
    """Yield the cascades along the motion of their model."""
    for index, (label, loop) in enumerate(experiment.loops.items(), start=1):
        law: Any = getattr(loop.controller, "around", loop.controller)
        if hasattr(law, "commanded") and hasattr(law, "position"):
            law = with_fields(law, position=with_fields(law.position, period=None))
            vehicle = Vehicle(forces=(*law.known_forces, *law.across))
            of_model = replace(loop, vehicle=vehicle, controller=law)
            yield sampled(label, of_model, horizon, _random(experiment, index, Stream.CERTIFICATES))


def _random(experiment: Experiment, index: int, stream: Stream) -> np.random.Generator:
    """Return the generator of the states of a law; 0 belongs to no law."""
    return generator(experiment.config.ensemble.seed, stream, index)
