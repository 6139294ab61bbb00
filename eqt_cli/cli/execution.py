"""What `eqt run`, `eqt sweep` and `eqt pack` have in common: execute a study and report on it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Callable

    from eqt_cli.experiment.study import Study
    from eqt_cli.run.execute import Execution, Shard
    from eqt_cli.run.executors import Executor


def shard_from(text: str | None) -> Shard | None:
    """``2/8`` as a shard; None stays None."""
    from eqt_cli.core.errors import EqtError
    from eqt_cli.run.execute import Shard

    if text is None:
        return None
    index, slash, count = text.partition("/")
    if slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
        return Shard(int(index), int(count))
    raise EqtError(f"--shard: expected I/N with I from 1 to N, such as 2/8, got '{text}'")


def executor_from(
    study: Study, name: str | None, workers: int | None, scheduler: str | None
) -> Executor:
    """The executor asked for, or the one that suits the engine: threads, or processes."""
    from eqt_cli.cli.options import cores
    from eqt_cli.core.errors import EqtError
    from eqt_cli.run.executors import executors

    workers = workers or cores()
    if scheduler and name not in (None, "dask"):
        raise EqtError(f"--scheduler: is for --executor dask, got --executor {name}")
    if scheduler:
        make: Callable[..., Executor] = executors.get("dask")  # the only one with a scheduler
        return make(workers, scheduler)
    if name is None:
        name = "threads" if study.base.engine.threads else "auto"
    return executors.get(name)(workers)


def run_study(
    study: Study,
    out: Path | None,
    executor: Executor,
    *,
    force: bool,
    rerun_failed: bool,
    shard: Shard | None,
    json: bool,
    quiet: bool,
) -> None:
    """Execute, report on stdout, and exit as the outcome demands."""
    from eqt_cli.cli.output import say, warn
    from eqt_cli.cli.progress import progress
    from eqt_cli.run.execute import execute

    out = out or Path("results") / study.name
    try:
        with progress(study.plans.total, quiet=quiet) as advance:
            outcome = execute(
                study,
                out,
                executor=executor,
                force=force,
                rerun_failed=rerun_failed,
                shard=shard,
                progress=advance,
                resumed=advance.skip,
                remark=warn,
            )
    except KeyboardInterrupt:
        raise _interrupted(study, out) from None
    if not quiet:
        for entry in outcome.removed:
            say(f"removed {entry}")
        if outcome.was_complete:
            say(f"{out} already holds this experiment; --force runs it again")
        elif outcome.resumed:
            say(f"{outcome.resumed} of {outcome.runs} runs were there already")
    if not outcome.packed:
        _print_shard(outcome, shard, json)
    else:
        report(outcome, json=json)


def _interrupted(study: Study, out: Path) -> Exception:
    from eqt_cli.core.errors import InterruptedRun
    from eqt_cli.run.folder import ResultFolder

    parts = ResultFolder(out).parts.listed()
    done = sum(study.plans.runs_of(number) for number in parts if number < len(study.plans))
    whole = f" (whole parts of {study.plans.runs_of(0)} are)" if not done else ""
    return InterruptedRun(
        f"interrupted; {done} of {study.plans.total} runs are kept in {out}{whole}: "
        "run the same command again to continue, or with --force to start over"
    )


def _print_shard(outcome: Execution, shard: Shard | None, json: bool) -> None:
    from eqt_cli.cli.output import print_json

    if json:
        print_json(
            {
                "folder": str(outcome.folder.path),
                "runs": outcome.runs,
                "failed": outcome.failed,
                "resumed": outcome.resumed,
                "seconds": outcome.seconds,
                "causes": ["some runs failed"] if outcome.failed else [],
            }
        )
    else:
        assert shard is not None
        print(f"shard {shard.index}/{shard.count}: {outcome.runs} runs, {outcome.failed} failed")
        print(f"next     eqt pack {outcome.folder.path}  (when all shards are done)")
    if outcome.failed:
        raise typer.Exit(3)


def report(outcome: Execution, *, json: bool) -> None:
    """Print what came out, and exit with 3 or 4 where runs failed or the check did not hold."""
    from eqt_cli.cli.output import print_json
    from eqt_cli.results.result import open_result

    with open_result(outcome.folder.results) as results:
        check = results.cross_check
    if json:
        print_json(_document(outcome))
    else:
        _print_summary(outcome)
    if outcome.failed:
        raise typer.Exit(3)
    if check is not None and not check.holds:
        raise typer.Exit(4)


def _document(outcome: Execution) -> dict[str, Any]:
    from dataclasses import asdict

    from eqt_cli.results.result import open_result

    with open_result(outcome.folder.results) as results:
        rows = results.headline()
        check = results.cross_check
        points = results.dimensions.get("point")
    causes = ["some runs failed"] if outcome.failed else []
    if check and not check.holds:
        causes.append("the cross-check does not hold")
    return {
        "results": str(outcome.folder.results),
        "was_complete": outcome.was_complete,
        **({} if points is None else {"points": points}),
        "runs": outcome.runs,
        "failed": outcome.failed,
        "resumed": outcome.resumed,
        "seconds": outcome.seconds,
        "causes": causes,
        "controllers": rows,
        "cross_check": asdict(check) | {"holds": check.holds} if check else None,
    }


def _print_summary(outcome: Execution) -> None:
    from eqt_cli.cli.summary import print_accuracy, print_failures, print_headline
    from eqt_cli.results.result import open_result

    with open_result(outcome.folder.results) as results:
        points = results.dimensions.get("point")
        print_headline(results)
        print()
        print_accuracy(results)
        if outcome.failed:
            print_failures(results)
    took = "".join(f", {name} {value:.1f} s" for name, value in outcome.seconds.items())
    over = "" if points is None else f"{points} points, "
    print(f"{over}{outcome.runs} runs{took}")
    print(f"results  {outcome.folder.results}")
    if outcome.failed < outcome.runs:
        print(f"next     eqt plot {outcome.folder.path}")
    else:
        print(f"next     eqt show {outcome.folder.path} --failed")
