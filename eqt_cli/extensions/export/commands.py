"""`eqt export`: control laws as C, for a vehicle."""

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.base.errors import EqtError
from eqt_cli.cli import options
from eqt_cli.cli.output import print_findings, table

REALS = ("double", "float")


def export(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RESULT", help="YAML configuration, or a result.")
    ],
    controller: Annotated[list[str] | None, options.option("--controller")] = None,
    real: Annotated[str, options.option("--real", names=REALS)] = "double",
    out: Annotated[Path | None, options.option("--out", parser=options.folder)] = None,
    reference: Annotated[bool, options.option("--reference")] = False,
    adapter: Annotated[Path | None, options.option("--adapter")] = None,
    set_: options.Set = None,
    point: options.Point = None,
    workers: options.Workers = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write control laws as C: header, source, a program that checks them, and a README.

    The header states a bound on the rounding error of the torque. Only exported files are replaced.

    Options
    -------
    What to show
        --controller LABEL  Law to export. Repeatable. Default: all.
    Output
        --real NAME  Type of all numbers: double or float.
        --reference  Also export the reference, which must be in closed form.
        --adapter FILE  YAML with the vehicle's conventions for the inputs and outputs of the
            law, as for `eqt verify`.
    Result
        --out DIR  Folder to write. Default: exported/NAME.
    """
    from eqt_cli import api
    from eqt_cli.base.reporting import significant

    if real not in REALS:
        raise EqtError(f"--real: expected double or float, got '{real}'")
    experiment = options.document_of(target, set_, trust_plugins=trust_plugins)
    exported = api.export(
        options.study_at(experiment, point, "exported without"),
        out,
        controllers=controller or (),
        real="float" if real == "float" else "double",
        reference=reference,
        adapter=adapter,
        workers=workers or options.cores(),
    )
    header = ["law", "file", "operations", "largest error", "apart"]
    rows = []
    for law in exported.laws:
        bound = law["bound"]
        assert isinstance(bound, list)
        largest = significant(max(bound), 2) if bound else "-"
        row = [law["label"], f"{law['name']}.c", law["operations"], largest, law["singular"]]
        rows.append([*map(str, row)])
    document = {"folder": str(exported.folder), "files": exported.files, "laws": exported.laws}
    print_findings(document, table(header, rows), f"\nexported  {exported.folder}", json=json)
