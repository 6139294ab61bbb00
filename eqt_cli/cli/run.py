"""`eqt run`: integrate an experiment and store it."""

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.run_and_report import executor_from, run_experiment
from eqt_cli.core.errors import EqtError


def run(
    config: options.Config,
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
    """Simulate every run of every controller and store the result in results/NAME.

    After an interruption, run the same command again to continue.
    """
    from eqt_cli.experiment.read_study import study

    source = options.source_of(config, set_, engine)
    if source.data.get("sweep"):
        place = source.place(("sweep",))
        raise EqtError(f"{place}: defines a sweep; use `eqt sweep {source.path}`")
    found = study(source, trust_plugins=trust_plugins)
    run_experiment(
        found,
        out,
        executor_from(found, executor, workers, scheduler),
        shard,
        force=force,
        rerun_failed=rerun_failed,
        json=json,
    )
