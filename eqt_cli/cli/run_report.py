"""Execution of studies, and the report on them: what the commands that compute share."""

from __future__ import annotations

from contextlib import nullcontext, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from eqt_cli.base.errors import EqtError, InterruptedRun
from eqt_cli.base.files import new_file
from eqt_cli.base.process import Interrupted
from eqt_cli.cli import options, output
from eqt_cli.runs.lock import unfinished

if TYPE_CHECKING:
    from eqt_cli.api import StoredResult
    from eqt_cli.config.study import Study
    from eqt_cli.results.result import Result
    from eqt_cli.runs.executors import Executor
    from eqt_cli.runs.run_study import Shard


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
    from eqt_cli.base.yaml_source import parse_value

    name, _, listed = (setup.executor or "").partition(":")
    if setup.scheduler and name not in ("", "dask"):
        raise EqtError(f"--scheduler: is for --executor dask, got --executor {name}")
    values = {}
    for option in filter(None, listed.split(",")):
        key, equals, value = option.partition("=")
        if not equals:
            raise EqtError(f"--executor: expected NAME:KEY=VALUE, got '{setup.executor}'")
        values[key.strip()] = parse_value(value, "--executor")
    count = setup.workers or options.cores()
    return choose_executor(experiment, count, name or None, setup.scheduler, values)


LONG = 5.0
"""s of simulation after which the command names a faster engine."""


def run_experiment(
    experiment: Study, executor: Executor, out: Path | None, handling: options.Handling
) -> None:
    """Run an experiment, report on stdout, and exit with the code of the outcome."""
    from eqt_cli import api

    shard, plans = shard_from(handling.shard), experiment.plans
    out = out or Path("results") / experiment.name
    try:
        done = api.run(
            experiment,
            out,
            executor=executor,
            force=handling.force,
            rerun_failed=handling.rerun_failed,
            shard=shard,
        )
    except Interrupted as error:
        begun = unfinished(out)
        finished = begun.done if begun else 0
        whole = "" if finished else f" (whole parts of {plans.runs_of(0)} are)"
        raise InterruptedRun(
            f"interrupted; {finished} of {plans.total} runs are kept in {out}{whole}: "
            "run the same command again to continue",
            error.exit_code,
        ) from None
    for entry in done.removed:
        output.say(f"removed {entry}")
    if done.was_complete:
        output.say(f"{out} already holds this experiment; --force runs it again")
    elif done.resumed:
        output.say(f"{done.resumed} of {done.runs} runs were already computed")
    if experiment.base.engine.calls_laws and done.seconds.get("simulation", 0) > LONG:
        _say_faster()
    report(done, shard, json=handling.json, with_plugins=bool(experiment.base.plugins))


def _say_faster() -> None:
    """Say what compiled laws save, where a compiler is at hand; once to a user."""
    from eqt_cli.engines.compiler import caches_of_user
    from eqt_cli.engines.native import Native

    if Native.unavailable():
        return
    with suppress(OSError, RuntimeError):  # no folder: it is said again
        marker = caches_of_user() / "eqt" / "told_of_native"
        marker.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            new_file(marker, b"")
        except FileExistsError:
            return
    output.say(
        "faster: --engine native, which took a seventh of the time of solve_ivp for "
        f"configs/paper.yaml; {options.ENGINE}=native makes it your default"
    )


def report(
    done: StoredResult, shard: Shard | None = None, *, json: bool, with_plugins: bool = False
) -> None:
    """Print the outcome; exit with 3 if runs failed, or 4 if the cross-check does not hold."""
    from eqt_cli.results.result import open_result

    causes = ["some runs failed"] if done.failed else []
    counted: dict[str, Any] = {
        "runs": done.runs,
        "failed": done.failed,
        "resumed": done.resumed,
        "seconds": done.seconds,
        "causes": causes,
    }
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
            if json:
                output.print_json(_document(done, results, counted))
            else:
                with output.as_remark():
                    _print_summary(done, results)
    if done.failed:
        raise typer.Exit(3)
    if disagrees:
        raise typer.Exit(4)


def _document(done: StoredResult, results: Result, counted: dict[str, Any]) -> dict[str, Any]:
    from eqt_cli.cli.result_tables import outcome_record

    check, points = results.cross_check, results.dimensions.get("point")
    return {
        "results": str(done.file),
        "was_complete": done.was_complete,
        **({} if points is None else {"points": points}),
        **counted,
        **outcome_record(results),
        "cross_check": asdict(check) | {"holds": check.holds} if check else None,
    }


def _print_summary(done: StoredResult, results: Result) -> None:
    from eqt_cli.cli.result_tables import print_outcome

    points = results.dimensions.get("point")
    print_outcome(results)
    took = "".join(f", {name} {value:.1f} s" for name, value in done.seconds.items())
    over = "" if points is None else f"{output.count_of(points, 'point')}, "
    output.print_text(f"{over}{output.count_of(done.runs, 'run')}{took}", f"results  {done.file}")
    output.print_text(f"next     eqt {_next(done, len(results.labels))}")


def _next(done: StoredResult, laws: int) -> str:
    """Return the next command: the failures if all runs failed, else a comparison or a figure."""
    if done.failed == done.runs:
        return f"show {done.path} --failed"
    return f"{'compare' if laws > 1 else 'plot'} {done.path}"


def time_line(seconds: float | None, workers: int) -> str:
    """Return the line of a dry run with the expected time."""
    if seconds is None:
        return "time     not known: the loop is too fast or too stiff to be timed in a moment"
    return f"time     about {output.duration(seconds)} with {output.count_of(workers, 'worker')}"
