"""`eqt run`, `eqt sweep` and `eqt pack`: integrate an experiment, whole or in shards."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.output import print_found, say
from eqt_cli.cli.shared.run_and_report import executor_from, report, run_experiment, time_line
from eqt_cli.core.errors import EqtError

if TYPE_CHECKING:
    from eqt_cli.execution.executors import Executor
    from eqt_cli.experiment.study import Study


def run(
    config: options.Config,
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    device: options.Device = None,
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

    source = options.source_of(config, set_, engine, device)
    if source.data.get("sweep"):
        place = source.place(("sweep",))
        raise EqtError(f"{place}: defines a sweep; use `eqt sweep {source.path}`")
    found = study(source, trust_plugins=trust_plugins)
    chosen = executor_from(found, executor, workers, scheduler)
    run_experiment(found, out, chosen, shard, force=force, rerun_failed=rerun_failed, json=json)


FIRST_POINTS = 5
"""Number of points shown by --dry-run."""

MOST_CHECKED = 300
"""Maximum number of points checked by --dry-run; each takes some milliseconds."""


def sweep(
    config: options.Config,
    grid: Annotated[
        list[str] | None, options.option("--grid", autocompletion=completion.settings)
    ] = None,
    dry_run: Annotated[bool, options.option("--dry-run")] = False,
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    device: options.Device = None,
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
    """Simulate every run at every point of a sweep and store the result in results/NAME.

    After an interruption, run the same command again to continue.

    Options
    -------
    Experiment
        --grid KEY=A,B,…  Sweep a key over values, such as gains.kd=0.25,0.5,1. Repeatable: every
            combination is one point.
    Computing
        --dry-run  Print the points, the expected time and size only.
    """
    from eqt_cli.experiment.read_study import add_grids, study

    source = options.source_of(config, set_, engine, device)
    add_grids(source, options.placed("--grid", grid))
    if not source.data.get("sweep"):
        raise EqtError(
            f"{source.source.name}: defines no sweep; add a `sweep` section or --grid KEY=A,B, "
            f"or use `eqt run {source.path}`"
        )
    found = study(
        source, trust_plugins=trust_plugins, most_checked=MOST_CHECKED if dry_run else None
    )
    chosen = executor_from(found, executor, workers, scheduler)
    if dry_run:
        points = len(found)
        if points > MOST_CHECKED:
            checked = f"{MOST_CHECKED} of its {points} points were checked"
            say(f"{config}: {checked}; a run checks all")
        _print_plan(found, chosen, json)
        return
    run_experiment(found, out, chosen, shard, force=force, rerun_failed=rerun_failed, json=json)


def _print_plan(study: Study, executor: Executor, json: bool) -> None:
    from eqt_cli.execution.cost import check_memory, estimate, size

    assert study.sweep is not None
    check_memory(study)
    expected = estimate(study, executor)
    first = [study.sweep.point(k) for k in range(min(FIRST_POINTS, len(study)))]
    plan = study.plan
    document = {
        "points": len(study),
        "runs": plan.total,
        "first": first,
        "seconds": expected.seconds,
        "workers": expected.workers,
        "bytes": expected.size,
    }
    lines = [
        f"{len(study)} points × {plan.controllers} controllers × {plan.runs} runs = {plan.total}"
    ]
    for index, point in enumerate(first):
        values = ", ".join(f"{key} = {value}" for key, value in point.items())
        lines.append(f"  {index}  {values}")
    if len(study) > FIRST_POINTS:
        lines.append("  …")
    kept = f"{study.kept} trajectories each" if study.kept else "metrics only"
    lines.append(time_line(expected.seconds, expected.workers))
    lines.append(f"size     {size(expected.size)}, {kept}")
    print_found(document, "\n".join(lines), json=json)


def pack(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Result folder to which all shards wrote.")
    ],
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Join the parts of all shards to one results.h5."""
    from eqt_cli import api

    done = api.pack(folder, trust_plugins=trust_plugins)
    if done.was_complete:
        say(f"{folder} already holds the complete result; there is nothing to pack")
    report(done, json=json)
