"""`eqt run`, `eqt sweep` and `eqt pack`: what computes."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base.errors import EqtError, InterruptedRun
from eqt_cli.base.process import Interrupted
from eqt_cli.cli import completion, options, output
from eqt_cli.cli.output import print_findings, say

if TYPE_CHECKING:
    from eqt_cli.api import StoredResult
    from eqt_cli.config.study import Study
    from eqt_cli.results.result import Result
    from eqt_cli.runs.executors import Executor
    from eqt_cli.runs.run_study import Shard


# `eqt run`, `eqt sweep` and `eqt pack`: integrate an experiment, whole or in shards ---------------


def run(config: options.Config, setup: options.Setup, handling: options.Handling) -> None:
    """Simulate every run of every law and store the result in results/NAME.

    After an interruption, run the same command again to continue.
    """
    from eqt_cli.config.study import study

    document = setup.document(config, handling)
    if document.data.get("sweep"):
        place = document.place(("sweep",))
        raise EqtError(f"{place}: defines a sweep; use `eqt sweep {document.path}`")
    run_experiment(study(document), setup, handling)


FIRST_POINTS = 5
"""Number of points shown by --dry-run."""

MOST_CHECKED = 300
"""Maximum number of points checked by --dry-run; each takes some milliseconds."""


def sweep(
    config: options.Config,
    grid: Annotated[
        list[str] | None, options.option("--grid", autocompletion=completion.settings)
    ] = None,
    points: Annotated[str | None, options.option("--points")] = None,
    where: Annotated[list[str] | None, options.option("--where")] = None,
    dry_run: options.DryRun = False,
    *,
    setup: options.Setup,
    handling: options.Handling,
) -> None:
    """Simulate every run at every point of a sweep and store the result in results/NAME.

    After an interruption, run the same command again to continue.

    Options
    -------
    Experiment
        --grid KEY=A,B,…  Sweep a key over values, such as gains.kd=0.25,0.5,1, or over a range,
            LOW:HIGH:POINTS or LOW:HIGH:POINTS:log. Repeatable: every
            combination is one point.
        --points 3,5:8  Only these points, by their numbers from 0; 5:8 is 5, 6, 7.
        --where CONDITION  Only points at which this holds, such as 'gains.kp > 1'. Repeatable.
    Computing
        --dry-run  Print the points, the expected time and size only.
    """
    from eqt_cli.config.study import add_grids, study, with_block

    document = add_grids(setup.document(config, handling), options.placed("--grid", grid))
    if not document.data.get("sweep"):
        raise EqtError(
            f"{document.source.name}: defines no sweep; add a `sweep` section or --grid KEY=A,B, "
            f"or use `eqt run {document.path}`"
        )
    for condition in where or []:
        document = with_block(document, {"where": condition}, "--where")
    if points is not None:
        document = with_block(document, {"points": points}, "--points")
    sweep_study = study(document, most_checked=MOST_CHECKED if dry_run else None)
    if dry_run:
        count = len(sweep_study)
        if count > MOST_CHECKED:
            checked = f"{MOST_CHECKED} of its {count} points were checked"
            say(f"{config}: {checked}; a run checks all")
        _print_plan(sweep_study, executor_from(sweep_study, setup), handling.json)
        return
    run_experiment(sweep_study, setup, handling)


def _print_plan(study: Study, executor: Executor, json: bool) -> None:
    from eqt_cli.runs.preflight import check_memory, estimate, size

    assert study.sweep is not None
    check_memory(study)
    expected = estimate(study, executor)
    rules, shown = study.sweep.rules, range(min(FIRST_POINTS, len(study)))
    first = [study.sweep.point(k) for k in shown]
    if rules:
        first = [first[k] | rules.derived(study.sweep.settings_of_blocks(k)) for k in shown]
    plan, points = study.plan, len(study)
    document: dict[str, Any] = {"points": points, "runs": plan.total, "first": first}
    document |= {"dropped": rules.dropped} if rules else {}
    document |= {"seconds": expected.seconds, "workers": expected.workers, "bytes": expected.size}
    lines = [f"{points} points × {plan.controllers} controllers × {plan.runs} runs = {plan.total}"]
    for index, point in enumerate(first):
        values = ", ".join(f"{key} = {value}" for key, value in point.items())
        lines.append(f"  {index}  {values}")
    if points > FIRST_POINTS:
        lines.append("  …")
    if rules and rules.dropped:
        lines.append(f"dropped  {rules.dropped} of {points + rules.dropped} points, {rules.why}")
    stored = f"{study.trajectories} trajectories each" if study.trajectories else "metrics only"
    lines.append(time_line(expected.seconds, expected.workers))
    lines.append(f"size     {size(expected.size)}, {stored}")
    print_findings(document, "\n".join(lines), json=json)


def pack(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Result folder to which all shards wrote.")
    ],
    others: Annotated[
        list[Path] | None, typer.Argument(metavar="OTHER", help="Results to join with the first.")
    ] = None,
    out: options.Out = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Join the parts of all shards to one results.h5; with --out, several results to one.

    Results may differ in points, laws and seeds.
    """
    from eqt_cli import api

    done = api.pack(folder, *(others or ()), out=out, trust_plugins=trust_plugins)
    if done.outcome.was_complete:
        say(f"{folder} already holds the complete result; there is nothing to pack")
    report(done, json=json)


# What these commands share: executors, the execution of studies, and the report on it -------------


def shard_from(text: str | None) -> Shard | None:
    """Parse a shard such as ``2/8``; None stays None."""
    from eqt_cli.runs.run_study import Shard

    if text is None:
        return None
    index, slash, count = text.partition("/")
    if slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
        return Shard(int(index), int(count))
    raise EqtError(f"--shard: expected I/N with I from 1 to N, such as 2/8, got '{text}'")


def executor_from(experiment: Study, setup: options.Setup) -> Executor:
    """Return the requested executor, ``NAME`` or ``NAME:KEY=VALUE,KEY=VALUE``, or a default."""
    from eqt_cli.api import choose_executor
    from eqt_cli.base.option_types import option_names
    from eqt_cli.base.yaml_source import parse_value
    from eqt_cli.runs.executors import executors

    name, _, listed = (setup.executor or "").partition(":")
    values = dict[str, Any]()
    for number, option in enumerate(filter(None, listed.split(","))):
        key, equals, value = option.partition("=")
        if not equals and number == 0 and "at" in option_names(executors.get(name)):
            values["at"] = option
            continue
        if not equals:
            raise EqtError(f"--executor: expected NAME:KEY=VALUE, got '{setup.executor}'")
        values[key.strip()] = parse_value(value, "--executor")
    count = setup.workers or options.cores()
    return choose_executor(experiment, count, name or "auto", values)


def run_experiment(experiment: Study, setup: options.Setup, handling: options.Handling) -> None:
    """Run an experiment, report on stdout, and exit with the code of the outcome."""
    from eqt_cli import api
    from eqt_cli.runs.folder import ResultFolder

    out = setup.out or Path("results") / experiment.name
    experiment = experiment if handling.force else ResultFolder(out).begun(experiment)
    shard, plans = shard_from(handling.shard), experiment.plans
    try:
        done = api.run(
            experiment,
            out,
            executor=executor_from(experiment, setup),
            force=handling.force,
            rerun_failed=handling.rerun_failed,
            grow=handling.grow,
            shard=shard,
        )
    except Interrupted as error:
        from eqt_cli.base.files import FILE_NAME
        from eqt_cli.runs.part_files import unfinished

        begun = unfinished(out)
        # Written just before; of a run that --force starts anew, it may be the old one.
        is_whole = begun is None and (out / FILE_NAME).exists() and not handling.force
        finished = begun.done if begun else plans.total * is_whole
        whole = "" if finished else f" (whole parts of {plans.runs_of(0)} are)"
        raise InterruptedRun(
            f"interrupted; {finished} of {plans.total} runs are kept in {out}{whole}: "
            "run the same command again to continue",
            error.exit_code,
        ) from None
    for entry in done.outcome.removed:
        output.say(f"removed {entry}")
    if done.outcome.was_complete:
        output.say(f"{out} already holds this experiment; --force runs it again")
    elif handling.grow:
        new = done.runs - done.outcome.taken - done.outcome.resumed
        output.say(f"{done.outcome.taken} of {done.runs} runs were kept, {new} computed")
    elif done.outcome.resumed:
        output.say(f"{done.outcome.resumed} of {done.runs} runs were already computed")
    report(done, shard, json=handling.json, with_plugins=bool(experiment.base.plugins))


def report(
    done: StoredResult, shard: Shard | None = None, *, json: bool, with_plugins: bool = False
) -> None:
    """Print the outcome; exit with 3 if runs failed, or 4 if the cross-check does not hold."""
    from eqt_cli.cli.result_tables import drift_beyond, outcome_record
    from eqt_cli.results.result import open_result

    causes = ["some runs failed"] if done.failed else []
    counted: dict[str, Any] = {"runs": done.runs, "failed": done.failed}
    counted |= {"resumed": done.outcome.resumed, "kept": done.outcome.taken}
    counted |= {"seconds": done.outcome.seconds, "causes": causes}
    disagrees = False
    if shard is not None:
        trust = " --trust-plugins" if with_plugins else ""
        text = (
            f"shard {shard.index}/{shard.count}: {done.runs} runs, {done.failed} failed\n"
            f"next     eqt pack {done.path}{trust}  (when all shards are done)"
        )
        with nullcontext() if json else output.as_remark():
            output.print_findings({"folder": str(done.path), **counted}, text, json=json)
    else:
        with open_result(done.file) as results:
            check = results.cross_check
            disagrees = check is not None and not check.holds
            if disagrees:
                causes.append("the cross-check does not hold")
            elif drift := drift_beyond(results):
                disagrees = True
                causes.append(f"poses leave the group by {drift:.2g}")
            if json:
                points = results.points if results.is_sweep else None
                document = {
                    "results": str(done.file),
                    "was_complete": done.outcome.was_complete,
                    **({} if points is None else {"points": points}),
                    **counted,
                    **outcome_record(results),
                    "cross_check": asdict(check) | {"holds": check.holds} if check else None,
                }
                output.print_json(document)
            else:
                with output.as_remark():
                    _print_summary(done, results)
    if done.failed:
        raise typer.Exit(3)
    if disagrees:
        raise typer.Exit(4)


def _print_summary(done: StoredResult, results: Result) -> None:
    from eqt_cli.cli.result_tables import print_outcome

    print_outcome(results, [_about(done, results), ""])
    following = f"eqt compare {done.path}   tells which law is better (or plot, report)"
    if len(results.labels) < 2:
        following = f"eqt plot {done.path}   (or report)"
    if done.failed == done.runs:
        following = f"eqt show {done.path} --failed"
    output.print_text(f"results  {done.file}", f"next     {following}")


def _about(done: StoredResult, results: Result) -> str:
    """``✓ paper: 800 runs of 20 s in 5.1 s``, and stages that took more than a tenth of that."""
    points = results.points if results.is_sweep else None
    seconds = done.outcome.seconds
    over = "" if points is None else f"{output.count_of(points, 'point')}, "
    runs = output.count_of(done.runs, "run")
    lasting = f" of {results.horizon:g} s" if results.horizon else ""
    total = sum(seconds.values())
    took = f" in {output.duration(total)}" if seconds else ""
    slow = [
        f"{name} {output.duration(value)}"
        for name, value in seconds.items()
        if name != "simulation" and value > total / 10
    ]
    stages = f" ({', '.join(slow)})" if slow else ""
    tick = "✓ " if not done.failed and output.room() is not None else ""
    return f"{tick}{results.title}: {over}{runs}{lasting}{took}{stages}"


def time_line(seconds: float | None, workers: int) -> str:
    """Return the line of a dry run with the expected time."""
    if seconds is None:
        return "time     not known: the loop is too fast or too stiff to be timed in a moment"
    return f"time     about {output.duration(seconds)} with {output.count_of(workers, 'worker')}"
