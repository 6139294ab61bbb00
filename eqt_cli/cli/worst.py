"""`eqt worst`: search for the worst run of each law within ranges of keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.help import RESULT
from eqt_cli.cli.shared.output import as_remark, laid_out, print_json, print_text, warn
from eqt_cli.cli.shared.progress import progress
from eqt_cli.cli.shared.run_and_report import executor_from
from eqt_cli.core.errors import InterruptedRun
from eqt_cli.core.interruptions import Interrupted

if TYPE_CHECKING:
    from eqt_cli.tuning.evolution import Population
    from eqt_cli.tuning.law_search import LawSearch
    from eqt_cli.tuning.worst import Worst


def worst(
    config: options.Config,
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    workers: options.Workers = None,
    executor: options.ExecutorName = None,
    scheduler: options.Scheduler = None,
    fail_above: Annotated[
        float | None,
        options.valued(
            "--fail-above",
            "X",
            "Exit with 4 if a law has a run that failed, or whose objective is above X (below X "
            "where larger values are better).",
            RESULT,
        ),
    ] = None,
    dry_run: options.DryRun = False,
    force: options.Force = False,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Search for the worst run of each law and store the result in results/NAME-worst.

    It finds bad runs and proves nothing: worse ones may exist. After an interruption, run the same
    command again to continue.
    """
    from eqt_cli import api
    from eqt_cli.cli.shared.search_plan import print_search_plan
    from eqt_cli.config.source import read_config
    from eqt_cli.experiment.study import Study
    from eqt_cli.results.quantity_table import QUANTITIES
    from eqt_cli.tuning.tables import values_text
    from eqt_cli.tuning.worst import folder_of
    from eqt_cli.tuning.worst_search import worst_search_from

    source = read_config(config, options.overrides(set_, engine))
    search = worst_search_from(source, trust_plugins=trust_plugins)
    base = api.LoadedExperiment(Study(None, search.base))
    if dry_run:
        print_search_plan(search, executor_from(base, executor, workers, scheduler), json=json)
        return
    out = out or folder_of(search)
    quantity = QUANTITIES[search.objective]
    found: dict[str, str] = {}
    try:
        with progress(search.all_runs) as advance:

            def told(law: LawSearch, generation: int, population: Population) -> None:
                values = values_text(law.values(population.shares[population.best].tolist()))
                value = quantity.cost(-population.scores.objectives[population.best, 0])
                found[law.label] = f"{search.objective} {value:.4g} at {values}"
                of = f"{law.label}, generation {generation} of {search.all_generations}"
                advance.note = f"{of}: {found[law.label]}"

            done = api.worst(
                search,
                out,
                executor=executor_from(base, executor, workers, scheduler),
                force=force,
                progress=advance,
                resumed=advance.skip,
                remark=warn,
                told=told,
            )
    except Interrupted as error:
        raise InterruptedRun(
            f"interrupted; what was found is kept in {out}: run the same command again to "
            "continue, or with --force to start over",
            error.exit_code,
            [f"  worst so far, {label}: {text}" for label, text in found.items()],
        ) from None
    _report(done, fail_above, json=json)


def _report(done: Worst, fail_above: float | None, *, json: bool) -> None:
    """Print what came out, and exit with 4 where it is worse than what was asked for."""
    from eqt_cli.results.result import open_result
    from eqt_cli.tuning.worst_tables import worst_table

    path = done.along.folder.path
    causes = [] if fail_above is None else list(_beyond(done, fail_above))
    if json:
        print_json({"folder": str(path), **done.record, "causes": causes})
    else:
        with as_remark(), open_result(path) as result:
            print_text(laid_out(worst_table(result, done.record)), "")
        print_text(*causes, f"results  {path}")
        print_text(f"next     eqt run {path / done.record['laws'][0]['config']}")
    if causes:
        raise typer.Exit(4)


def _beyond(done: Worst, bound: float) -> Any:
    """The laws with a run that is worse than a bound."""
    from eqt_cli.results.quantity_table import QUANTITIES

    metric = done.record["objective"]
    cost = QUANTITIES[metric].cost
    side = "above" if cost(1.0) > 0 else "below"
    for law in done.record["laws"]:
        if law["failed"]:
            yield f"{law['label']}: a run failed"
        elif cost(law["value"]) > cost(bound):
            yield f"{law['label']}: {metric} {law['value']:.4g} is {side} {bound:g}"
