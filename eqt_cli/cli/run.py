"""`eqt run`: integrate an experiment and store it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli import options

if TYPE_CHECKING:
    from eqt_cli.experiment.execute import Outcome


def run(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result to run again.")
    ],
    out: options.Out = None,
    set_: options.Set = None,
    engine: Annotated[
        str | None, typer.Option("--engine", metavar="NAME", help="Engine, as solver.engine.")
    ] = None,
    workers: options.Workers = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start over, removing what the folder holds.")
    ] = False,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Integrate every run of every controller; results go to results/NAME."""
    from eqt_cli.cli.options import cores
    from eqt_cli.cli.output import print_json, say
    from eqt_cli.cli.progress import progress
    from eqt_cli.experiment.build import build
    from eqt_cli.experiment.execute import execute
    from eqt_cli.experiment.source import read_config

    overrides = [*(set_ or ()), *([f"solver.engine={engine}"] if engine else ())]
    source = read_config(config, overrides)
    experiment = build(source, trust_plugins=trust_plugins)
    out = out or Path("results") / experiment.name
    total = experiment.config.ensemble.runs * len(experiment.loops)
    with progress(total, quiet=quiet) as advance:
        outcome = execute(
            experiment, source, out, force=force, progress=advance, workers=workers or cores()
        )
    if not quiet:
        for entry in outcome.removed:
            say(f"removed {entry}")
        if outcome.was_complete:
            say(f"{out} already holds this experiment; --force runs it again")
    if json:
        print_json(_document(outcome))
    else:
        _print_summary(outcome)
    if outcome.failed:
        raise typer.Exit(3)
    if _cross_check_failed(outcome):
        raise typer.Exit(4)


def _document(outcome: Outcome) -> dict[str, object]:
    from dataclasses import asdict

    from eqt_cli.analysis.headline import headline
    from eqt_cli.cli.summary import cross_check
    from eqt_cli.store.reader import open_results

    with open_results(outcome.folder.results) as results:
        rows = [asdict(row) for row in headline(results)]
        check = cross_check(results)
    causes = ["some runs failed"] if outcome.failed else []
    if check and not check["holds"]:
        causes.append("the cross-check does not hold")
    return {
        "results": str(outcome.folder.results),
        "was_complete": outcome.was_complete,
        "runs": outcome.runs,
        "failed": outcome.failed,
        "seconds": outcome.seconds,
        "causes": causes,
        "controllers": rows,
        "cross_check": check,
    }


def _cross_check_failed(outcome: Outcome) -> bool:
    from eqt_cli.cli.summary import cross_check
    from eqt_cli.store.reader import open_results

    with open_results(outcome.folder.results) as results:
        check = cross_check(results)
    return check is not None and not check["holds"]


def _print_summary(outcome: Outcome) -> None:
    from eqt_cli.cli.summary import print_accuracy, print_failures, print_headline
    from eqt_cli.store.reader import open_results

    with open_results(outcome.folder.results) as results:
        print_headline(results)
        print()
        print_accuracy(results)
        if outcome.failed:
            print_failures(results)
    took = "".join(f", {name} {value:.1f} s" for name, value in outcome.seconds.items())
    print(f"{outcome.runs} runs{took}")
    print(f"results  {outcome.folder.results}")
    print(f"next     eqt plot {outcome.folder.path}")
