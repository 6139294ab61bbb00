"""`eqt worst`: search for the worst run of each law within ranges of keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.run_and_report import report_search, searched


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
    done = searched(search, api.worst, out, computing, dry_run=dry_run, force=force, json=json)
    if done is None:
        return
    causes = [] if fail_above is None else list(_beyond(done.record, fail_above))
    report_search(done, worst_tables, causes, done.record["laws"][0]["config"], json=json)
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
