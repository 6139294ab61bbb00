"""`eqt tune`: search for the best gains of each law, and compare the winners on held-out runs."""

from __future__ import annotations

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.run_and_report import report_search, searched


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
    done = searched(search, api.tune, out, computing, dry_run=dry_run, force=force, json=json)
    if done is None:
        return
    laws, failed = done.record["laws"], done.judged.failed
    lost = [
        f"no feasible point of {law['label']}: the least violation is {law['least_violation']:.3g}"
        for law in laws
        if not law["winners"]
    ]
    first = next((law["winners"][0]["config"] for law in laws if law["winners"]), None)
    causes = [*lost, *(["some held-out runs failed"] if failed else [])]
    report_search(done, tuning_tables, causes, first, json=json)
    if causes:
        raise typer.Exit(4 if lost else 3)
