"""`eqt tune` and `eqt worst`: search for the best gains and for the worst run of each law."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import InterruptedRun
from eqt_cli.base.extensions import function_for
from eqt_cli.base.process import Interrupted
from eqt_cli.base.reporting import brief
from eqt_cli.cli import options, output, run

if TYPE_CHECKING:
    from eqt_cli.base.reporting import TextTable
    from eqt_cli.extensions.search.search import Searched, Searches
    from eqt_cli.results.result import Result
    from eqt_cli.runs.executors import Executor


def tune(
    config: options.Config,
    setup: options.Setup,
    objective: Annotated[str | None, options.option("--objective")] = None,
    dry_run: options.DryRun = False,
    *,
    handling: options.HandlingOfSearch,
) -> None:
    """Find the best gains of each law and store the result in results/NAME-tuned.

    After an interruption, run the same command again to continue. The exit code is 4 if a law has
    no feasible gains.

    Options
    -------
    Experiment
        --objective NAME  A metric, or a bound proved without runs: certified_rate, push_bound.
            Same as --set tune.objective=NAME.
    """
    from eqt_cli.extensions.search.tables import tuning_answer
    from eqt_cli.extensions.search.tune import Search

    if objective:
        setup = replace(setup, set_=[*(setup.set_ or ()), f"tune.objective={objective}"])
    search = Search.read(setup.document(config, handling))
    done = _searched(search, setup, handling, dry_run=dry_run)
    laws, failed = done.record["laws"], done.judged.failed
    lost = [
        f"no feasible point of {law['label']}: "
        + (law["why"] or f"the least violation is {law['least_violation']:.3g}")
        for law in laws
        if not law["winners"]
    ]
    first = next((law["winners"][0]["config"] for law in laws if law["winners"]), None)
    causes = [*lost, *(["some held-out runs failed"] if failed else [])]
    _report(done, tuning_answer, causes, first, json=handling.json)
    if causes:
        raise typer.Exit(4 if lost else 3)


def worst(
    config: options.Config,
    setup: options.Setup,
    fail_above: Annotated[float | None, options.option("--fail-above")] = None,
    certified: Annotated[float, options.option("--certified", min=0)] = 0.0,
    dry_run: options.DryRun = False,
    *,
    handling: options.HandlingOfSearch,
) -> None:
    """Search for the worst run of each law and store the result in results/NAME-worst.

    It finds bad runs and proves nothing: worse ones may exist. After an interruption, run the same
    command again to continue.

    Options
    -------
    Result
        --fail-above X  Exit with 4 if a law has a run that failed, or whose objective is above X
            (below X where larger values are better).
        --certified ANGLE  Also try a proof at the point of each law's worst run, for large errors
            on SO(3), as by `eqt margins --from ANGLE`.
    """
    from eqt_cli.extensions.search.tables import worst_tables
    from eqt_cli.extensions.search.worst import WorstSearch

    # Before the search, which takes longer, for it refuses some angles.
    proved: Any = certified and function_for(purposes.worst_certified)(certified)
    search = WorstSearch.read(setup.document(config, handling))
    done = _searched(search, setup, handling, dry_run=dry_run)
    causes = [] if fail_above is None else list(_beyond(done.record, fail_above))
    if proved:
        for law in done.record["laws"]:
            law["certified"] = proved(done.judged.folder.path / law["config"], law["label"])
    _report(done, worst_tables, causes, done.record["laws"][0]["config"], json=handling.json)
    if causes:
        raise typer.Exit(4)


def _beyond(record: dict[str, Any], bound: float) -> Iterator[str]:
    """Yield a line for each law with a failed run, or one worse than a bound."""
    from eqt_cli.results.metrics import quantity_of

    metric = record["objective"]
    cost = quantity_of(metric).cost
    side = "above" if cost(1.0) > 0 else "below"
    for law in record["laws"]:
        if law["failed"]:
            yield f"{law['label']}: a run failed"
        elif cost(law["value"]) > cost(bound):
            yield f"{law['label']}: {metric} {brief(law['value'])} is {side} {bound:g}"


def _searched(
    search: Searches[Any], setup: options.Setup, handling: options.Handling, *, dry_run: bool
) -> Searched:
    """Search and return the outcome; for a dry run, print the plan and end the command."""
    from eqt_cli.config.study import Study
    from eqt_cli.extensions.search.search import carry_out

    out = setup.out or search.folder
    search = search if handling.force else search.begun_in(out)
    executor = run.executor_from(Study(None, search.base), setup)
    if dry_run:
        _print_search_plan(search, executor, json=handling.json)
        raise typer.Exit
    output.say(_runs_line(search))
    try:
        return carry_out(search, out, executor, force=handling.force)
    except Interrupted as error:
        raise InterruptedRun(
            f"interrupted; the search is kept in {out}: run the same command again to continue",
            error.exit_code,
            [f"  {law}, {note}" for law, note in output.notes().items()],
        ) from None


def _runs_line(search: Searches[Any]) -> str:
    """Return the line with the runs that a search will take, and what they are for."""
    runs = output.count_of(search.base.config.ensemble.runs, "run")
    cases = len(search.in_cases(search.laws[0]))
    at_point = f"{runs} in each of {cases} cases" if cases > 1 else runs
    sought = (
        f"{search.searched_runs} ({at_point} at each point), and " if search.searched_runs else ""
    )
    return f"runs     {sought}at most {search.judging_runs} {search.judging}"


def _print_search_plan(search: Searches[Any], executor: Executor, *, json: bool) -> None:
    """Print the runs and the time that a search will take."""
    from eqt_cli.extensions.search.search import expected

    if not search.searched_runs:
        return output.print_findings({"runs": search.all_runs}, _runs_line(search), json=json)
    estimate = expected(search, executor)
    lines = [
        f"{' × '.join(search.size)} = {estimate.points}",
        _runs_line(search),
        run.time_line(estimate.seconds, estimate.workers),
        *search.remarks(),
    ]
    plan = asdict(estimate) | {"remarks": search.remarks()}
    output.print_findings(plan, "\n".join(lines), json=json)


def _report(
    done: Searched,
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
        Configuration in the folder, to be run next; None if nothing was plan.
    """
    from eqt_cli.extensions.search.tables import verdict_records
    from eqt_cli.results.result import open_result

    path = done.judged.folder.path
    if json:
        counted = {"failed": done.judged.failed, "causes": list(causes)}
        with open_result(path) as result:
            pairs = verdict_records(result, done.record)
            pairs["remarks"] = [*result.described.remarks, *pairs.get("remarks", ())]
        output.print_json({"folder": str(path), **done.record, **pairs, **counted})
        return
    if done.judged.taken:
        output.say(f"{done.judged.taken} of {done.judged.runs} held-out runs were kept")
    with output.as_remark(), open_result(path) as result:
        for table in tables(result, done.record):
            output.print_text(output.laid_out(table), "")
    commands = [*([f"eqt run {path / config}"] if config else []), f"eqt show {path}"]
    output.print_text(*causes, f"results  {path}", "next     " + "\n         ".join(commands))
