"""`eqt tune` and `eqt worst`: search for the best gains and for the worst run of each law."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.cli.shared import options, output
from eqt_cli.cli.shared.progress import notes
from eqt_cli.cli.shared.run_and_report import executor_from, time_line
from eqt_cli.core.errors import InterruptedRun
from eqt_cli.core.interruptions import Interrupted

if TYPE_CHECKING:
    from eqt_cli.analysis.text_tables import TextTable
    from eqt_cli.execution.executors import Executor
    from eqt_cli.results.result import Result
    from eqt_cli.tuning.generations import Found
    from eqt_cli.tuning.searches import Searches


def tune(
    config: options.Config,
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    workers: options.Workers = None,
    executor: options.ExecutorName = None,
    scheduler: options.Scheduler = None,
    dry_run: options.DryRun = False,
    force: options.Force = False,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Find the best gains of each law and store the result in results/NAME-tuned.

    After an interruption, run the same command again to continue. The exit code is 4 if a law has
    no feasible gains.
    """
    from eqt_cli import api
    from eqt_cli.tuning.tables import tuning_tables
    from eqt_cli.tuning.tune import Search

    source = options.source_of(config, set_, engine)
    search = Search.read(source, trust_plugins=trust_plugins)
    computing = (executor, workers, scheduler)
    done = _searched(search, api.tune, out, computing, dry_run=dry_run, force=force, json=json)
    laws, failed = done.record["laws"], done.judged.failed
    lost = [
        f"no feasible point of {law['label']}: the least violation is {law['least_violation']:.3g}"
        for law in laws
        if not law["winners"]
    ]
    first = next((law["winners"][0]["config"] for law in laws if law["winners"]), None)
    causes = [*lost, *(["some held-out runs failed"] if failed else [])]
    _report(done, tuning_tables, causes, first, json=json)
    if causes:
        raise typer.Exit(4 if lost else 3)


def worst(
    config: options.Config,
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    workers: options.Workers = None,
    executor: options.ExecutorName = None,
    scheduler: options.Scheduler = None,
    fail_above: Annotated[float | None, options.option("--fail-above")] = None,
    dry_run: options.DryRun = False,
    force: options.Force = False,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Search for the worst run of each law and store the result in results/NAME-worst.

    It finds bad runs and proves nothing: worse ones may exist. After an interruption, run the same
    command again to continue.

    Options
    -------
    Result
        --fail-above X  Exit with 4 if a law has a run that failed, or whose objective is above X
            (below X where larger values are better).
    """
    from eqt_cli import api
    from eqt_cli.tuning.tables import worst_tables
    from eqt_cli.tuning.worst import WorstSearch

    source = options.source_of(config, set_, engine)
    search = WorstSearch.read(source, trust_plugins=trust_plugins)
    computing = (executor, workers, scheduler)
    done = _searched(search, api.worst, out, computing, dry_run=dry_run, force=force, json=json)
    causes = [] if fail_above is None else list(_beyond(done.record, fail_above))
    _report(done, worst_tables, causes, done.record["laws"][0]["config"], json=json)
    if causes:
        raise typer.Exit(4)


def _beyond(record: dict[str, Any], bound: float) -> Iterator[str]:
    """Yield a line for each law with a failed run, or one worse than a bound."""
    from eqt_cli.results.quantity_table import QUANTITIES

    metric = record["objective"]
    cost = QUANTITIES[metric].cost
    side = "above" if cost(1.0) > 0 else "below"
    for law in record["laws"]:
        if law["failed"]:
            yield f"{law['label']}: a run failed"
        elif cost(law["value"]) > cost(bound):
            yield f"{law['label']}: {metric} {law['value']:.4g} is {side} {bound:g}"


def _searched(
    search: Searches[Any],
    begin: Callable[..., Found],
    out: Path | None,
    computing: tuple[str | None, int | None, str | None],
    *,
    dry_run: bool,
    force: bool,
    json: bool,
) -> Found:
    """Search and return the outcome; for a dry run, print the plan and end the command.

    Parameters
    ----------
    begin
        `tune` or `worst` of the API.
    computing
        Requested executor, number of workers and scheduler.
    """
    from eqt_cli.experiment.study import Study

    executor = executor_from(Study(None, search.base), *computing)
    if dry_run:
        _print_plan(search, executor, json=json)
        raise typer.Exit
    out = out or search.folder
    output.say(_runs_line(search))
    try:
        return begin(search, out, executor=executor, force=force)
    except Interrupted as error:
        raise InterruptedRun(
            f"interrupted; what was found is kept in {out}: run the same command again to continue",
            error.exit_code,
            [f"  {law}, {found}" for law, found in notes().items()],
        ) from None


def _runs_line(search: Searches[Any]) -> str:
    """Return the line with the runs that a search will take, and what they are for."""
    runs = output.count_of(search.base.config.ensemble.runs, "run")
    cases = len(search.in_cases(search.laws[0]))
    each = f"{runs} in each of {cases} cases" if cases > 1 else runs
    return (
        f"runs     {search.searched_runs} ({each} at each point), and at most "
        f"{search.judging_runs} {search.judging}"
    )


def _print_plan(search: Searches[Any], executor: Executor, *, json: bool) -> None:
    """Print the runs and the time that a search will take."""
    from eqt_cli.tuning.generations import expected

    section, found = search.section, expected(search, executor)
    factors = [
        output.count_of(len(search.laws), "law"),
        f"{section.seeds} search{'es' if section.seeds > 1 else ''}",
        output.count_of(section.budget, "generation"),
        output.count_of(section.population, "point"),
    ]
    lines = [
        f"{' × '.join(factors)} = {found.points}",
        _runs_line(search),
        time_line(found.seconds, found.workers),
    ]
    output.print_found(asdict(found), "\n".join(lines), json=json)


def _report(
    done: Found,
    tables: Callable[[Result, dict[str, Any]], Sequence[TextTable]],
    causes: Sequence[str],
    config: str | None,
    *,
    json: bool,
) -> None:
    """Print the outcome of a search.

    Parameters
    ----------
    causes
        Reasons why the exit code is not 0.
    config
        Configuration in the folder, to be run next; None if nothing was found.
    """
    from eqt_cli.results.result import open_result

    path = done.judged.folder.path
    if json:
        counted = {"failed": done.judged.failed, "causes": list(causes)}
        output.print_json({"folder": str(path), **done.record, **counted})
        return
    with output.as_remark(), open_result(path) as result:
        for table in tables(result, done.record):
            output.print_text(output.laid_out(table), "")
    output.print_text(
        *causes, f"results  {path}", *([f"next     eqt run {path / config}"] if config else [])
    )
