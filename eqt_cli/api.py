"""What Python users and the commands call, from loading to drawing.

Everything here is also an attribute of `eqt_cli` itself.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from eqt_cli.analysis.certificates import Row
from eqt_cli.analysis.comparison import Comparison, Window
from eqt_cli.analysis.comparison import compare as compare_results
from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.analysis.comparison.maps import Map, compare_map
from eqt_cli.analysis.oracles import oracle_named
from eqt_cli.analysis.verification import RUNS, Verification, verify_experiment, verify_stored
from eqt_cli.config import yaml_source
from eqt_cli.config.plugins import load_stored_plugins
from eqt_cli.config.source import ConfigSource, overridden, read_config, source_of
from eqt_cli.core.errors import ComponentError, EqtError, Remedy
from eqt_cli.execution.executors import Executor, executors
from eqt_cli.execution.folder import CONFIG
from eqt_cli.execution.run_study import (
    Execution,
    Progress,
    Remark,
    Shard,
    execute,
    pack_folder,
    warn,
)
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.horizon import remarks
from eqt_cli.experiment.read_study import study
from eqt_cli.experiment.study import Study
from eqt_cli.results.result import Result, open_result, point_folder
from eqt_cli.store.reserved_names import point_group
from eqt_cli.tuning.search import Search, search_from
from eqt_cli.tuning.tune import Told, Tuning, folder_of
from eqt_cli.tuning.tune import tune as run_search

if TYPE_CHECKING:
    import xarray

    from eqt_cli.plots.kept_numbers import Check

Note = Callable[[str], None]

Configuration = str | os.PathLike[str] | Mapping[str, Any]
"""A YAML file, a result whose configuration to use, or the configuration itself."""

ResultPath = str | os.PathLike[str]
"""A result folder, or the file in it; a `StoredResult` is one."""


@dataclass(frozen=True)
class LoadedExperiment:
    """A checked experiment, or a sweep of them, ready to run.

    Attributes
    ----------
    study
        All of its points.
    """

    study: Study

    @property
    def experiment(self) -> Experiment:
        """Its group, laws, gains and distributions, at the first point of a sweep."""
        return self.study.base

    @property
    def source(self) -> ConfigSource:
        """The configuration as it was given."""
        return self.study.source

    @property
    def name(self) -> str:
        """Its name, and that of its folder under ``results/``."""
        return self.experiment.name

    @property
    def config(self) -> dict[str, Any]:
        """The configuration with every default written out."""
        return self.study.resolved

    @property
    def controllers(self) -> list[str]:
        """The labels of its controllers."""
        return list(self.experiment.loops)

    def __repr__(self) -> str:
        runs = self.experiment.config.ensemble.runs
        points = f"{len(self.study)} points, each with " if self.study.sweep else ""
        return (
            f"<experiment {self.name} on {self.experiment.group.name}: {points}{runs} runs of "
            f"{', '.join(self.controllers)}>"
        )


@dataclass(frozen=True)
class StoredResult(Execution, os.PathLike[str]):
    """A result in its folder; it stands for its path wherever one is expected."""

    @property
    def path(self) -> Path:
        """The folder."""
        return self.folder.path

    def __fspath__(self) -> str:
        return str(self.path)

    @property
    def file(self) -> Path:
        """The result file."""
        return self.folder.results

    @cached_property
    def data(self) -> xarray.Dataset:
        """The result as an xarray Dataset, which reads from the file when values are asked for."""
        return open_results(self, "xarray")

    def __repr__(self) -> str:
        failed = f", {self.failed} failed" if self.failed else ""
        return f"<result {self.path}: {self.runs} runs{failed}>"


Shown = ResultPath | LoadedExperiment
"""What figures are drawn of: a result, or an experiment as a YAML file or loaded."""

YAML = (".yaml", ".yml")
"""How files of configurations end, where results could be meant as well."""


def load_experiment(
    config: Configuration,
    overrides: Mapping[str, Any] | None = None,
    *,
    trust_plugins: bool = False,
) -> LoadedExperiment:
    """Read and check a configuration.

    Parameters
    ----------
    config
        A YAML file, a result folder or file (its stored configuration), or the configuration as a
        mapping.
    overrides
        Values by key, as ``{"gains.kp": 2, "ensemble.runs": 50}``; NumPy arrays are taken as lists.
    trust_plugins
        Execute plugin sources that are stored in a result file.

    Returns
    -------
    LoadedExperiment
        To be given to `run`.

    Raises
    ------
    ConfigError
        With every problem, each at its place.
    EqtError
        If there is no such file.
    """
    if overrides is not None and not isinstance(overrides, Mapping):
        raise EqtError(
            f"overrides: expected values by key, as {{'gains.kp': 2}}, got {overrides!r}"
        )
    given = {f"overrides[{k!r}]": f"{k}={_flow(value)}" for k, value in (overrides or {}).items()}
    return LoadedExperiment(study(_source(config, given), trust_plugins=trust_plugins))


def run(
    experiment: LoadedExperiment | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    progress: Progress = lambda runs: None,
    executor: Executor | None = None,
    rerun_failed: bool = False,
    shard: Shard | None = None,
    resumed: Progress = lambda runs: None,
    remark: Remark = warn,
) -> StoredResult:
    """Run an experiment, and keep its result in a folder.

    A folder that already holds the finished result of the same experiment is left as it is.

    Parameters
    ----------
    experiment
        From `load_experiment`, or what that takes.
    out
        The result folder; ``results/<name>`` if not given.
    force
        Start over, removing what eqt wrote there.
    workers
        Cores to use. More than one may start processes, for which a script needs the usual
        ``if __name__ == "__main__":``.
    progress
        Called with the number of runs that are done since the last call, in fractions.
    executor
        Who computes; if not given, `choose_executor` chooses.
    rerun_failed
        Compute those runs again that failed, each by itself.
    shard
        Compute only this share, beside other processes; `pack` joins the shares.
    resumed
        Called at the start with the number of runs that earlier sessions have done.
    remark
        Called with what is worth knowing and no error; a warning if not given.

    Raises
    ------
    EqtError
        If the folder holds another experiment, or cannot be written. Runs that fail do not raise:
        see `StoredResult.failed`.
    """
    loaded = experiment if isinstance(experiment, LoadedExperiment) else load_experiment(experiment)
    for known in remarks(loaded.experiment):
        remark(known)
    done = execute(
        loaded.study,
        Path("results") / loaded.name if out is None else Path(out),
        executor=executor or choose_executor(loaded, workers),
        force=force,
        rerun_failed=rerun_failed,
        shard=shard,
        progress=progress,
        resumed=resumed,
        remark=remark,
    )
    return StoredResult(**vars(done))


def tune(
    search: Search | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    progress: Progress = lambda runs: None,
    executor: Executor | None = None,
    resumed: Progress = lambda runs: None,
    remark: Remark = warn,
    told: Told = lambda law, generation, population: None,
) -> Tuning:
    """Search for the best gains of each law, and compare the winners on held-out runs.

    The folder becomes the result of the held-out runs, to be compared, drawn and reported like any
    other; in ``tuned/`` are the complete configurations of the winners.

    Parameters
    ----------
    search
        A configuration with a section ``tune``, or what `search_from` has made of one.
    out
        The folder; ``results/<name>-tuned`` if not given. Generations that it holds are not
        computed again.
    force, workers, progress, executor, resumed, remark
        As of `run`.
    told
        Called after every generation, with the law, the number of generations, and the points.

    Returns
    -------
    Tuning
        What was found for each law, and the result of the held-out runs.

    Raises
    ------
    ConfigError
        With every problem of the configuration, each at its place.
    EqtError
        If it tunes nothing, or the folder holds something else.
    """
    if not isinstance(search, Search):
        search = search_from(_source(search, {}))
    chosen = executor or choose_executor(LoadedExperiment(Study(None, search.base)), workers)
    return run_search(
        search,
        folder_of(search) if out is None else Path(out),
        executor=chosen,
        force=force,
        progress=progress,
        resumed=resumed,
        remark=remark,
        told=told,
    )


def choose_executor(
    experiment: LoadedExperiment,
    workers: int = 1,
    name: str | None = None,
    scheduler: str | None = None,
) -> Executor:
    """Who computes an experiment.

    Parameters
    ----------
    workers
        Cores to use.
    name
        Of an executor. If not given: Dask for a scheduler, threads for an engine that computes
        outside Python, and else processes, for more than one core.
    scheduler
        Address of a running Dask scheduler.
    """
    if scheduler:
        make: Callable[..., Executor] = executors.get("dask")  # the only one with a scheduler
        return make(workers, scheduler)
    suitable = "threads" if experiment.experiment.engine.threads else "auto"
    return executors.get(name or suitable)(workers)


def pack(folder: ResultPath, *, trust_plugins: bool = False, remark: Remark = warn) -> StoredResult:
    """Join the shares of an experiment that several calls of `run` have computed.

    Parameters
    ----------
    folder
        The result folder that all of them wrote to.
    trust_plugins
        Execute plugin sources that are stored in a result file.
    remark
        As of `run`.

    Raises
    ------
    EqtError
        If shares are missing.
    """
    loaded = load_experiment(Path(folder) / CONFIG, trust_plugins=trust_plugins)
    return StoredResult(**vars(pack_folder(loaded.study, Path(folder), remark)))


@overload
def open_results(
    path: str | os.PathLike[str], kind: Literal["xarray"], point: int | None = None
) -> xarray.Dataset: ...
@overload
def open_results(
    path: str | os.PathLike[str], kind: Literal["arrays"], point: int | None = None
) -> Result: ...
@overload
def open_results(
    path: str | os.PathLike[str], kind: None = None, point: int | None = None
) -> xarray.Dataset | Result: ...


def open_results(
    path: str | os.PathLike[str],
    kind: Literal["xarray", "arrays"] | None = None,
    point: int | None = None,
) -> xarray.Dataset | Result:
    """Open a result, after checking that its file is safe to read.

    Parameters
    ----------
    path
        The result folder, or the file in it.
    kind
        ``"xarray"`` for an `xarray.Dataset`, ``"arrays"`` for eqt's own reader, which needs nothing
        installed; if not given, the first where xarray is installed, and else the second.
    point
        Of a sweep, counted from 0: that one as the result of a single experiment. Without it, an
        `xarray.Dataset` of a sweep whose points differ in shape holds what they have in common.

    Returns
    -------
    xarray.Dataset or Result
        Both read values when they are asked for, and are closed by a ``with`` block.

    Raises
    ------
    ResultError
        If there is no such result or point, or its file is damaged or not safe.
    EqtError
        If an `xarray.Dataset` is asked for and the extra ``xarray`` is not installed.
    """
    if kind not in (None, "xarray", "arrays"):
        raise EqtError(f"kind {kind!r}: expected 'xarray', 'arrays' or None")
    if kind == "arrays":
        return open_result(Path(path), point)
    if find_spec("xarray") is None or find_spec("h5netcdf") is None:
        if kind is None:
            return open_result(Path(path), point)
        raise EqtError(
            "xarray is not installed: pip install xarray h5netcdf, or open with kind='arrays'"
        )
    import xarray

    with open_result(path) as checked:
        file, in_group = checked.path, checked.has_groups
        attributes = None if point is None else dict(checked.point(point).attributes)
    if point is None or attributes is None:
        return xarray.open_dataset(file, engine="h5netcdf")
    group = point_group(point) if in_group else None
    opened = xarray.open_dataset(file, engine="h5netcdf", group=group)
    found = (opened if in_group else opened.isel(point=point)).assign_attrs(attributes)
    found.set_close(opened.close)
    return found


def compare(
    result: str | os.PathLike[str],
    metrics: Sequence[str] = (),
    windows: Sequence[str | Window] = (),
    *,
    point: int | None = None,
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
) -> Comparison:
    """Compare the controllers of a result, run by run on the same initial states.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of what to compare, as ``eqt compare RESULT --list`` shows them; a choice if empty.
    windows
        Over which seconds, as ``"0:5"``.
    point
        Of a sweep, counted from 0.
    confidence, resamples, seed
        Of the bootstrap.

    Raises
    ------
    EqtError
        If the result has no such metric or window.
    """
    if isinstance(metrics, str):
        raise EqtError(f"metrics: expected a list of names, as [{metrics!r}], got {metrics!r}")
    if isinstance(windows, str | Window):
        raise EqtError(f"windows: expected a list of windows, as ['0:5'], got {windows!r}")
    parsed = [_window(window) for window in windows]
    with open_result(_path("result", result), point) as results:
        how = Resampling(confidence, resamples, seed)
        return compare_results(results, metrics=metrics, windows=parsed, how=how)


def compare_sweep(
    result: ResultPath,
    metrics: Sequence[str],
    *,
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
) -> list[Map]:
    """Compare the controllers at each point of a sweep: which of them wins where.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of stored numbers per run; one map each.
    confidence, resamples, seed
        As of `compare`.

    Raises
    ------
    EqtError
        If the result is no sweep, or has no such metric.
    """
    with open_result(_path("result", result)) as results:
        if not results.is_sweep:
            raise results.error("is a single experiment; `eqt compare` without more compares it")
        how = Resampling(confidence, resamples, seed)
        return [compare_map(results, name, how) for name in metrics]


def plot(
    result: Shown | Sequence[Shown],
    figure: str | Mapping[str, Mapping[str, Any]] | None = None,
    out: str | os.PathLike[str] | None = None,
    *,
    formats: Sequence[str] = ("pdf", "svg", "png"),
    width: str = "column",
    options: Mapping[str, Any] | None = None,
    style: Sequence[str] = (),
    tex: bool = False,
    point: int | Sequence[int] | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    note: Note = lambda text: None,
) -> list[Path]:
    """Draw a figure of a result, or one of several, and write it as files.

    Parameters
    ----------
    result
        The result folder, or the file in it; several to draw them in one figure. Or a YAML
        configuration or a `LoadedExperiment`, of which the figures that need no run are drawn.
    figure
        Its name, as ``eqt list figures`` shows them; or several, with the options of each. If not
        given, ``paper``, and of a configuration ``reference``.
    out
        The folder; ``figures`` in that of the first result if not given, and ``figures/<name>`` for
        a configuration.
    formats
        ``pdf``, ``svg``, ``png``, or ``json`` for the numbers.
    width
        ``column`` (3.5 in) or ``page`` (7.16 in).
    options
        Of the figure, as ``{"log": True}``.
    style
        Matplotlib style sheets to lay over eqt's own.
    tex
        Let LaTeX set the text.
    point
        Of a sweep, counted from 0; several to draw them in one figure.
    trust_plugins
        Execute plugin sources that are stored in the result, where the figure shows certificates.
    workers
        Cores to use, where the figure shows certificates.
    note
        Called with what takes some seconds, before it is done.

    Returns
    -------
    list of Path
        The files, one per figure and format.

    Raises
    ------
    EqtError
        If there is no such result, figure or option, or the result lacks what it shows.
    """
    from eqt_cli.plots.base import OfCertificates
    from eqt_cli.plots.drawing.style import Style
    from eqt_cli.plots.figures import figures
    from eqt_cli.plots.render import render
    from eqt_cli.plots.save import check_targets

    with _opened(result, point) as opened:
        first = opened[0]
        figure = figure or ("paper" if isinstance(first, Result) else "reference")
        wanted = {figure: options or {}} if isinstance(figure, str) else figure
        within = Path("figures") if point is None else point_folder(*_points(point))
        home = (
            first.path.parent / within if isinstance(first, Result) else Path("figures", first.name)
        )
        folder = home if out is None else Path(out)
        check_targets(folder / f"{name}.{format}" for name in wanted for format in formats)
        rows: list[Row] = []
        of_certificates = any(issubclass(figures.get(name), OfCertificates) for name in wanted)
        if of_certificates and isinstance(first, Result):
            note("checking the paper's statements on the result takes some seconds")
            rows = verify_stored(first, trust_plugins=trust_plugins, workers=workers).rows
        look = Style(tuple(style), tex)
        return [
            file
            for name, given in wanted.items()
            for file in render(
                opened, name, folder, formats, width, given, style=look, certificates=rows
            )
        ]


def check_figures(
    result: Shown | Sequence[Shown],
    figures: Mapping[str, Mapping[str, Any]],
    folder: str | os.PathLike[str],
    *,
    point: int | Sequence[int] | None = None,
) -> dict[str, Check]:
    """Compare the numbers behind figures with those that `plot` has written as ``json``.

    Parameters
    ----------
    result, point
        As of `plot`.
    figures
        Their names, with the options of each.
    folder
        Where the numbers are.

    Raises
    ------
    EqtError
        If there is no such result, figure, option or file.
    """
    from eqt_cli.plots.render import check

    with _opened(result, point) as opened:
        return {name: check(opened, name, Path(folder), given) for name, given in figures.items()}


@contextmanager
def _opened(
    result: Shown | Sequence[Shown], point: int | Sequence[int] | None
) -> Iterator[list[Result | Experiment]]:
    """All chosen points of all results, or of configurations that have not been run."""
    single = isinstance(result, (str, os.PathLike, LoadedExperiment))
    # The checker does not follow `single` back to the types that it tells apart.
    given: list[Shown] = [result] if single else list(result)  # type: ignore[list-item, arg-type]
    if not given:
        raise EqtError("result: expected a result or several, got none")
    points = _points(point) or [None]
    with ExitStack() as stack:
        yield [_shown(one, number, stack) for one in given for number in points]


def _shown(one: Shown, point: int | None, stack: ExitStack) -> Result | Experiment:
    if not isinstance(one, LoadedExperiment):
        if Path(one).suffix not in YAML:
            return stack.enter_context(open_result(Path(one), point))
        one = load_experiment(one)
    return _at_point(one, point)


def _at_point(loaded: LoadedExperiment, point: int | None) -> Experiment:
    """The experiment at a point of a sweep, at the first if none is chosen."""
    if not 0 <= (point or 0) < len(loaded.study):
        raise EqtError(f"point: expected one of 0 to {len(loaded.study) - 1}, got {point}")
    return loaded.study.experiment(point or 0)


def _points(point: int | Sequence[int] | None) -> list[Any]:
    return [point] if isinstance(point, int) else list(point or ())


def write_report(
    result: ResultPath,
    out: str | os.PathLike[str] | None = None,
    *,
    figures: Sequence[str] = (),
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    note: Note = lambda text: None,
    unverified: Callable[[EqtError], None] = lambda error: None,
) -> Path:
    """Write a result as one HTML page that needs no network: figures, comparison, certificates.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    out
        The page; ``report.html`` in the result folder if not given.
    figures
        Names of those to show; a choice if empty.
    point
        Of a sweep, counted from 0.
    trust_plugins
        Execute plugin sources that are stored in the result; without, a result with plugins gets a
        page without certificates, which says so.
    workers
        Cores to use.
    note
        Called with what takes some seconds, before it is done.
    unverified
        Called with the reason why the page has no certificates.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    EqtError
        If there is no such result or figure, or the page cannot be written.
    """
    from eqt_cli.plots.save import check_targets, write
    from eqt_cli.report import report
    from eqt_cli.report.figures import named

    with open_result(Path(result), point) as opened:
        within = Path() if point is None else point_folder(point)
        path = opened.path.parent / within / "report.html" if out is None else Path(out)
        check_targets([path])  # before the work, and not after it
        wanted = named(figures) if figures else None
        note("checking the paper's statements and drawing the figures takes some seconds")
        rows: list[Row] = []
        reason = ""
        if not opened.is_sweep:
            try:
                rows = verify_stored(opened, trust_plugins=trust_plugins, workers=workers).rows
            except EqtError as error:
                reason = f"The result could not be verified: {error}"
                unverified(error)
        page = report(opened, wanted, rows, reason)
    write({path: page.encode()})
    return path


def animate(
    result: ResultPath,
    run: int = 0,
    controllers: Sequence[str] = (),
    out: str | os.PathLike[str] | None = None,
    *,
    formats: Sequence[str] = ("gif", "html"),
    seconds: float = 8.0,
    point: int | None = None,
    trust_plugins: bool = False,
    note: Note = lambda text: None,
) -> list[Path]:
    """Show one run as a moving picture: bodies against the reference frame, error and torque.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    run
        Its number, counted from 0.
    controllers
        Labels of those to show; all if empty.
    out
        The folder; ``figures`` in that of the result if not given.
    formats
        ``gif``, or ``html`` for a page.
    seconds
        How long the GIF lasts.
    point
        Of a sweep, counted from 0.
    trust_plugins
        Execute plugin sources that are stored in the result.
    note
        Called with what takes some seconds, before it is done.

    Returns
    -------
    list of Path
        The files, one per format.

    Raises
    ------
    EqtError
        If there is no such result, run or controller, or no body can be shown.
    """
    from eqt_cli.plots.animation.gif import gif
    from eqt_cli.plots.animation.motion import motion
    from eqt_cli.plots.save import check_targets, write
    from eqt_cli.report.animation import animation

    contents = {}
    with open_result(Path(result), point) as opened:
        if trust_plugins:
            load_stored_plugins(opened)
        try:
            motion(opened, run, controllers)  # what cannot be shown is said before all else
        except ComponentError as error:
            if trust_plugins or not source_of(opened).stored_plugins:
                raise
            text = f"{error}; the result holds plugins, which are executed only on request"
            advice = "read them with `eqt show --plugins`, then add {}"
            raise EqtError(text, Remedy(advice, "trust_plugins")) from error
        within = Path("figures") if point is None else point_folder(point)
        folder = opened.path.parent / within if out is None else Path(out)
        paths = {format: folder / f"run{run}.{format}" for format in formats}
        check_targets(paths.values())
        for format, path in paths.items():
            if format == "html":
                contents[path] = animation(opened, run, controllers).encode()
            else:
                note("drawing the pictures of the GIF takes some seconds")
                contents[path] = gif(opened, run, controllers, seconds=seconds)
    write(contents)
    return list(contents)


def verify(
    target: LoadedExperiment | Configuration,
    *,
    runs: int | None = None,
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    progress: Progress = lambda runs: None,
    oracle: str | Sequence[str] = (),
) -> Verification:
    """Check the paper's statements on an experiment or on the runs of a result.

    Parameters
    ----------
    target
        From `load_experiment`, or what that takes. Of a result folder or file, the stored runs are
        judged; of all else, new ones.
    runs
        New runs per controller, at most those of the experiment; 20 if not given.
    point
        Of a sweep, counted from 0; the first of an experiment if not given.
    trust_plugins
        Execute plugin sources that are stored in a result file.
    workers
        Cores to use.
    progress
        Called with the number of new runs that are done since the last call, in fractions.
    oracle
        ``mujoco``, ``pinocchio`` or both: programs whose rigid bodies eqt's is compared with.

    Returns
    -------
    Verification
        Its ``rows`` have a verdict each; ``failures`` are those that refute a statement.

    Raises
    ------
    EqtError
        If the target cannot be read, or is a sweep's result and no point is given.
    """
    names = [oracle] if isinstance(oracle, str) else oracle
    oracles = [oracle_named(name) for name in names]
    if not isinstance(target, (LoadedExperiment, Mapping)):
        path = Path(target)
        if path.suffix == ".h5" or path.is_dir():
            if runs is not None:
                raise EqtError(f"{path}: a result is verified as it is; leave runs out")
            with open_result(path, point) as opened:
                return verify_stored(
                    opened, trust_plugins=trust_plugins, workers=workers, oracles=oracles
                )
    if not isinstance(target, LoadedExperiment):
        target = load_experiment(target, trust_plugins=trust_plugins)
    experiment = _at_point(target, point)
    count = min(runs or RUNS, experiment.config.ensemble.runs)
    return verify_experiment(experiment, count, progress, workers, oracles)


def _path(name: str, given: Any) -> Path:
    try:
        return Path(given)
    except TypeError:
        expected = "a path" if name == "result" else "a path or a mapping"
        raise EqtError(f"{name}: expected {expected}, got {given!r}") from None


def _window(given: Any) -> Window:
    if isinstance(given, Window):
        return given
    if isinstance(given, str):
        return Window.parse(given)
    raise EqtError(f"windows: expected text such as '0:5', or a Window, got {given!r}")


def _source(config: Configuration, overrides: Mapping[str, str]) -> ConfigSource:
    if isinstance(config, Mapping):
        return _from_mapping(config, overrides)
    return read_config(_path("config", config), overrides)


def _from_mapping(config: Mapping[str, Any], overrides: Mapping[str, str]) -> ConfigSource:
    """A configuration out of Python, by way of its text, so that it is judged like any other."""
    text = yaml_source.dump(
        json.loads(_flow({**config, "name": config.get("name") or "experiment"}))
    )
    source = yaml_source.load(text, "config")
    return overridden(ConfigSource(source, source.data, Path.cwd()), overrides)


def _flow(value: Any) -> str:
    """A value as YAML on one line; JSON is YAML."""
    try:
        return json.dumps(value, default=_listed)
    except TypeError as error:
        raise EqtError(
            f"{value!r}: a configuration holds numbers, text, lists and mappings"
        ) from error


def _listed(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError
