"""Search, progress and report, shared by `eqt tune` and `eqt worst`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.cli.shared.output import (
    as_remark,
    count_of,
    duration,
    laid_out,
    print_found,
    print_json,
    print_text,
)
from eqt_cli.cli.shared.progress import notes
from eqt_cli.cli.shared.run_and_report import executor_from
from eqt_cli.core.errors import InterruptedRun
from eqt_cli.core.interruptions import Interrupted

if TYPE_CHECKING:
    from eqt_cli.analysis.text_tables import TextTable
    from eqt_cli.execution.executors import Executor
    from eqt_cli.results.result import Result
    from eqt_cli.tuning.searches import Searches
    from eqt_cli.tuning.searching import Found


def searched(
    search: Searches[Any],
    begin: Callable[..., Found],
    out: Path | None,
    computing: tuple[str | None, int | None, str | None],
    *,
    dry_run: bool,
    force: bool,
    json: bool,
) -> Found | None:
    """Search and return the outcome; for a dry run, print the plan and return None.

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
        return None
    out = out or search.folder
    try:
        return begin(search, out, executor=executor, force=force)
    except Interrupted as error:
        raise InterruptedRun(
            f"interrupted; what was found is kept in {out}: run the same command again to "
            "continue, or with --force to start over",
            error.exit_code,
            [f"  {law}, {found}" for law, found in notes().items()],
        ) from None


def _print_plan(search: Searches[Any], executor: Executor, *, json: bool) -> None:
    """Print the runs and the time that a search will take."""
    from eqt_cli.tuning.generations import expected

    section, found = search.section, expected(search, executor)
    runs = count_of(search.base.config.ensemble.runs, "run")
    cases = len(search.in_cases(search.laws[0]))
    each = f"{runs} in each of {cases} cases" if cases > 1 else runs
    factors = [
        count_of(len(search.laws), "law"),
        f"{section.seeds} search{'es' if section.seeds > 1 else ''}",
        count_of(section.budget, "generation"),
        count_of(section.population, "point"),
    ]
    lines = [
        f"{' × '.join(factors)} = {found.points}",
        f"runs     {search.searched_runs} ({each} at each point), and at most "
        f"{search.judging_runs} to judge the outcome",
        f"time     about {duration(found.seconds)} with {count_of(found.workers, 'worker')}",
    ]
    print_found(asdict(found), "\n".join(lines), json=json)


def report(
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
        print_json({"folder": str(path), **done.record, **counted})
        return
    with as_remark(), open_result(path) as result:
        for table in tables(result, done.record):
            print_text(laid_out(table), "")
    print_text(
        *causes, f"results  {path}", *([f"next     eqt run {path / config}"] if config else [])
    )
