"""`eqt verify`: the statements of the paper, checked on a configuration or a result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli import options

if TYPE_CHECKING:
    from eqt_cli.analysis.verification import Verification
    from eqt_cli.experiment.build import Experiment


def verify(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RESULT", help="YAML configuration, or a result.")
    ],
    set_: options.Set = None,
    engine: options.Engine = None,
    runs: Annotated[
        int | None,
        typer.Option(
            "--runs", min=1, metavar="N", help="Runs per controller of a CONFIG; default: 20."
        ),
    ] = None,
    point: options.Point = None,
    workers: options.Workers = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Check the paper's theorems on an experiment; exit 4 where one does not hold."""
    from eqt_cli.analysis.verification import RUNS, verify_experiment, verify_results
    from eqt_cli.cli.output import print_json, say
    from eqt_cli.cli.progress import progress
    from eqt_cli.config.source import read_config, source_of
    from eqt_cli.core.errors import EqtError
    from eqt_cli.experiment.build import build
    from eqt_cli.experiment.point import config_at
    from eqt_cli.results.result import open_result

    is_result = target.suffix == ".h5" or target.is_dir()
    if is_result and (set_ or engine or runs):
        raise EqtError(
            f"{target}: a result is verified as it is; --set, --engine and --runs are for a "
            "configuration"
        )
    workers = workers or options.cores()
    if is_result:
        with open_result(target, point) as results:
            experiment = build(source_of(results), trust_plugins=trust_plugins)
            found = verify_results(experiment, results, workers)
    else:
        source = read_config(target, options.overrides(set_, engine))
        if point is not None:
            source = config_at(source, point)
        experiment = build(source, trust_plugins=trust_plugins)
        if source.data.get("sweep") and not quiet:
            say(f"{target}: verified without its sweep; choose one of its points with --point")
        count = min(runs or RUNS, experiment.config.ensemble.runs)
        with progress(count * len(experiment.loops), quiet=quiet) as advance:
            found = verify_experiment(experiment, count, advance, workers)
    causes = _causes(found)
    if json:
        print_json(_document(experiment, target, found, causes))
    else:
        _print(experiment, found)
    if found.failed_runs:
        raise typer.Exit(3)
    if found.failures:
        raise typer.Exit(4)


def _causes(found: Verification) -> list[str]:
    causes = ["some runs failed"] if found.failed_runs else []
    return causes + [
        f"{row.statement}: {row.name}{f' ({row.controller})' if row.controller else ''} fails"
        for row in found.failures
    ]


def _document(
    experiment: Experiment, target: Path, found: Verification, causes: list[str]
) -> dict[str, object]:
    from dataclasses import asdict

    return {
        "verified": str(target),
        "name": experiment.name,
        "group": experiment.group.name,
        "engine": experiment.engine.name,
        "runs": found.runs,
        "failed": found.failed_runs,
        "holds": not found.failures,
        "causes": causes,
        "rows": [asdict(row) for row in found.rows],
    }


def _print(experiment: Experiment, found: Verification) -> None:
    from eqt_cli.analysis.certificate_table import certificate_table, doubtful, tally
    from eqt_cli.cli.output import table

    if (made := certificate_table(found.rows)) is not None:
        for block in made.blocks:
            print(f"{block.title}\n{table(made.header, block.rows)}\n")
        if made.notes:
            print("\n".join(made.notes), end="\n\n")
    counted = f"{found.runs} runs with engine {experiment.engine.name}"
    print(f"{experiment.name} on {experiment.group.name}: {tally(found.rows)}, {counted}")
    for doubt in doubtful(found.rows):
        print(f"hypothesis {doubt}")
    for cause in _causes(found):
        print(cause)
