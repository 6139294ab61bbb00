"""`eqt verify`: the statements of the paper, checked on a configuration or a result."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.output import print_found, say, table
from eqt_cli.cli.shared.progress import progress
from eqt_cli.core.errors import EqtError

if TYPE_CHECKING:
    from eqt_cli.analysis.verification import Verification


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
    oracle: Annotated[
        list[str] | None,
        options.named(
            "--oracle",
            completion.words("mujoco", "pinocchio"),
            "Also compare the plant with that of mujoco or pinocchio; may be repeated.",
        ),
    ] = None,
    point: options.Point = None,
    workers: options.Workers = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Check the paper's theorems on an experiment; exit 4 where one does not hold."""
    from eqt_cli import api
    from eqt_cli.analysis.verification import RUNS
    from eqt_cli.config.source import read_config
    from eqt_cli.experiment.config_at_point import config_at, without_sweep
    from eqt_cli.experiment.read_study import study

    workers, oracles = workers or options.cores(), oracle or ()
    if target.suffix == ".h5" or target.is_dir():
        if set_ or engine or runs:
            raise EqtError(
                f"{target}: a result is verified as it is; --set, --engine and --runs are for a "
                "configuration"
            )
        found = api.verify(
            target, point=point, trust_plugins=trust_plugins, workers=workers, oracle=oracles
        )
    else:
        source = read_config(target, options.overrides(set_, engine))
        is_sweep = point is None and source.data.get("sweep")
        source = without_sweep(source) if point is None else config_at(source, point)
        loaded = api.LoadedExperiment(study(source, trust_plugins=trust_plugins))
        if is_sweep and not quiet:
            say(f"{target}: verified without its sweep; choose one of its points with --point")
        count = min(runs or RUNS, loaded.experiment.config.ensemble.runs)
        with progress(count * len(loaded.controllers), quiet=quiet) as advance:
            found = api.verify(loaded, runs=runs, workers=workers, progress=advance, oracle=oracles)
    causes = ["some runs failed"] if found.failed_runs else []
    for row in found.failures:
        law = f" ({row.controller})" if row.controller else ""
        causes.append(f"{row.statement}: {row.name}{law} fails")
    print_found(_document(target, found, causes), _text(found, causes), json=json)
    if found.failed_runs:
        raise typer.Exit(3)
    if found.failures:
        raise typer.Exit(4)


def _document(target: Path, found: Verification, causes: list[str]) -> dict[str, object]:

    return {
        "verified": str(target),
        "name": found.experiment.name,
        "group": found.experiment.group.name,
        "engine": found.experiment.engine.name,
        "runs": found.runs,
        "failed": found.failed_runs,
        "holds": not found.failures,
        "causes": causes,
        "rows": [asdict(row) for row in found.rows],
    }


def _text(found: Verification, causes: list[str]) -> str:
    from eqt_cli.analysis.certificate_table import certificate_table, doubtful, tally

    lines = []
    if (made := certificate_table(found.rows)) is not None:
        for block in made.blocks:
            lines += [block.title, table(made.header, block.rows), ""]
        if made.notes:
            lines += [*made.notes, ""]
    experiment = found.experiment
    counted = f"{found.runs} runs with engine {experiment.engine.name}"
    lines.append(f"{experiment.name} on {experiment.group.name}: {tally(found.rows)}, {counted}")
    lines += [f"hypothesis {doubt}" for doubt in doubtful(found.rows)]
    return "\n".join([*lines, *causes])
