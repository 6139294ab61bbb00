"""`eqt export`: control laws as C, for a vehicle."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.help import OUTPUT, SELECTION
from eqt_cli.cli.shared.output import print_found, say, table
from eqt_cli.core.errors import EqtError

if TYPE_CHECKING:
    from eqt_cli.api import ExportedFiles

REALS = ("double", "float")


def export(
    target: Annotated[
        Path,
        typer.Argument(metavar="CONFIG|RESULT", help="YAML configuration, or a result."),
    ],
    controller: Annotated[
        list[str] | None,
        options.valued(
            "--controller", "LABEL", "Law to export. Repeatable. Default: all.", SELECTION
        ),
    ] = None,
    real: Annotated[
        str,
        options.named(
            "--real",
            completion.words(*REALS),
            "Type of all numbers: double or float.",
            OUTPUT,
        ),
    ] = "double",
    out: Annotated[Path | None, options.out("Folder to write. Default: exported/NAME.")] = None,
    reference: Annotated[
        bool,
        options.flag(
            "--reference", "Also export the reference, which must be in closed form.", OUTPUT
        ),
    ] = False,
    set_: options.Set = None,
    point: options.Point = None,
    workers: options.Workers = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write control laws as C: header, source, a program that checks them, and a README.

    The header says how far rounding can move the torque. It replaces only what eqt has exported.
    """
    from eqt_cli import api
    from eqt_cli.config.source import read_config
    from eqt_cli.experiment.config_at_point import config_at, without_sweep
    from eqt_cli.experiment.read_study import study

    if real not in REALS:
        raise EqtError(f"--real: expected double or float, got '{real}'")
    source = read_config(target, options.overrides(set_))
    if point is None and source.data.get("sweep"):
        say(f"{target}: exported without its sweep; choose one of its points with --point")
    source = without_sweep(source) if point is None else config_at(source, point)
    found = api.export(
        study(source, trust_plugins=trust_plugins),
        out,
        controllers=controller or (),
        real="float" if real == "float" else "double",
        reference=reference,
        workers=workers or options.cores(),
    )
    _report(found, json=json)


def _report(found: ExportedFiles, *, json: bool) -> None:
    from eqt_cli.analysis.comparison.notation import significant

    header = ["law", "file", "operations", "largest error", "apart", "flash", "stack"]
    rows = []
    for law in found.laws:
        cost = [f"{law[name]}" if law[name] is not None else "-" for name in ("flash", "stack")]
        bound = law["bound"]
        assert isinstance(bound, list)
        largest = significant(max(bound), 2) if bound else "-"
        told = [law["label"], f"{law['name']}.c", law["operations"], largest, law["singular"]]
        rows.append([*map(str, told), *cost])
    document = {"folder": str(found.folder), "files": found.files, "laws": found.laws}
    print_found(document, table(header, rows), f"\nexported  {found.folder}", json=json)
