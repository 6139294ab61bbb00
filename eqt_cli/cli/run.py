"""`eqt run`: integrate an experiment and store it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli import options


def run(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result to run again.")
    ],
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    workers: options.Workers = None,
    executor: options.ExecutorName = None,
    scheduler: options.Scheduler = None,
    shard: options.ShardOf = None,
    force: options.Force = False,
    rerun_failed: options.RerunFailed = False,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Integrate every run of every controller; results go to results/NAME.

    Run it again after an interruption: it continues.
    """
    from eqt_cli.api import LoadedExperiment
    from eqt_cli.cli.execution import executor_from, run_experiment, shard_from
    from eqt_cli.config.source import read_config
    from eqt_cli.core.errors import EqtError
    from eqt_cli.experiment.sweeping import study

    source = read_config(config, options.overrides(set_, engine))
    if source.data.get("sweep"):
        place = source.place(("sweep",))
        raise EqtError(f"{place}: the configuration sweeps; use: eqt sweep {source.path}")
    found = LoadedExperiment(study(source, trust_plugins=trust_plugins))
    run_experiment(
        found,
        out,
        executor_from(found, executor, workers, scheduler),
        force=force,
        rerun_failed=rerun_failed,
        shard=shard_from(shard),
        json=json,
        quiet=quiet,
    )
