"""`eqt verify`: the statements of the paper, checked on a configuration or a result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.analysis.text_tables import Block
from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.output import complain, laid_out, print_found
from eqt_cli.core.errors import EqtError

if TYPE_CHECKING:
    from rich.text import Text

    from eqt_cli.analysis.certificates.base import Row
    from eqt_cli.analysis.verification import Verification
    from eqt_cli.experiment.study import Study


def verify(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RESULT", help="YAML configuration, or a result.")
    ],
    set_: options.Set = None,
    engine: options.Engine = None,
    runs: Annotated[int | None, options.option("--runs", min=1)] = None,
    exact: Annotated[bool, options.option("--exact")] = False,
    code: Annotated[Path | None, options.option("--code")] = None,
    as_: Annotated[
        str | None, options.option("--as", autocompletion=completion.names("controllers"))
    ] = None,
    point: options.Point = None,
    workers: options.Workers = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    verbose: options.Verbose = False,
    quiet: options.Quiet = False,
) -> None:
    """Test the paper's theorems on an experiment; exit 4 if one fails.

    This prints the totals and every statement that does not hold; --verbose prints all statements.

    Options
    -------
    Experiment
        --runs N  Runs per law of a CONFIG. Default: 20.
        --exact  Also prove identities, by exact numbers at random states.
        --code FILE  Judge the control law in this C file instead of the controllers of a CONFIG.
        --as NAME  The control law that the C file claims to be.
    """
    from eqt_cli import api
    from eqt_cli.analysis.certificate_table import with_titles
    from eqt_cli.config.source import overridden
    from eqt_cli.experiment.laws_in_code import with_code

    subject: Path | Study
    is_result = target.suffix == ".h5" or target.is_dir()
    _check_options(target, is_result, set_ or engine or runs, code, as_)
    if is_result:
        subject = target
    else:
        source = options.source_of(target, None)
        if code:
            source = with_code(source, code, as_)
        source = overridden(source, options.overrides(set_, engine=engine))
        doing = "verified without"
        subject = options.study_at(source, point, trust_plugins=trust_plugins, doing=doing)
        point = None  # the configuration is already that of the point
    found = api.verify(
        subject,
        runs=runs,
        point=point,
        trust_plugins=trust_plugins,
        workers=workers or options.cores(),
        exact=exact,
    )
    print_found(_document(target, found), *_pieces(found, verbose=verbose), json=json)
    if quiet and not json:
        for cause in _causes(with_titles(found.rows, found.experiment.titles), found.failed_runs):
            complain(f"eqt: {target}: {cause}")
    if found.failed_runs:
        raise typer.Exit(3)
    if found.failures:
        raise typer.Exit(4)


def _check_options(
    target: Path, is_result: bool, changes: object, code: Path | None, as_: str | None
) -> None:
    """Raise an `EqtError` for options that do not go together."""
    if is_result and (changes or code):
        raise EqtError(
            f"{target}: a result is verified as it is; --set, --engine, --runs and --code are for "
            "a configuration"
        )
    if as_ and not code:
        raise EqtError("--as names the law that a C file claims to be; give the file with --code")
    if code and not code.is_file():
        raise EqtError(f"{code}: not found; give a C file with --code")


def _causes(rows: Sequence[Row], failed_runs: int) -> list[str]:
    """Return the reasons why the exit code is not 0."""
    causes = ["some runs failed"] if failed_runs else []
    for row in rows:
        if row.verdict is row.verdict.FAILS:
            law = f" ({row.controller})" if row.controller else ""
            causes.append(f"{row.statement}: {row.name}{law} fails")
    return causes


def _document(target: Path, found: Verification) -> dict[str, object]:

    return {
        "verified": str(target),
        "name": found.experiment.name,
        "group": found.experiment.group.name,
        "engine": found.experiment.engine.name,
        "runs": found.runs,
        "failed": found.failed_runs,
        "holds": not found.failures,
        "causes": _causes(found.rows, found.failed_runs),
        "rows": [asdict(row) for row in found.rows],
    }


def _pieces(found: Verification, *, verbose: bool) -> Iterator[str | Text]:
    """Yield the printed text: the rows that do not hold, or all; then totals, doubts and causes."""
    from eqt_cli.analysis.certificate_table import certificate_table, doubtful, tally, with_titles

    rows = with_titles(found.rows, found.experiment.titles)
    if (made := certificate_table(rows, brief=not verbose)) is not None:
        for block in made.blocks:
            notes = made.notes if block is made.blocks[-1] else []
            yield block.title
            yield laid_out(replace(made, caption="", blocks=[Block("", block.rows)], notes=notes))
            yield ""
    experiment = found.experiment
    counted = f"{found.runs} runs with engine {' and '.join(found.engines)}"
    yield f"{experiment.name} on {experiment.group.name}: {tally(rows)}, {counted}"
    yield from (f"hypothesis {doubt}" for doubt in doubtful(rows))
    yield from _causes(rows, found.failed_runs)
    if not verbose:
        assumed = sum(row.kind == "hypothesis" for row in rows)
        checked = f"{len(rows) - assumed} statements and {assumed} hypotheses were checked"
        yield f"{checked}; --verbose lists them all"
