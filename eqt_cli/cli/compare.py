"""`eqt compare`: paired statistics of a result, and what a paper claims."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import print_json, print_records, print_text, say
from eqt_cli.cli.shared.table_formats import as_csv, as_latex, as_text
from eqt_cli.core.errors import EqtError, suggestion

if TYPE_CHECKING:
    from eqt_cli.analysis.comparison import Comparison
    from eqt_cli.analysis.comparison.bootstrap import Resampling
    from eqt_cli.analysis.text_tables import TextTable
    from eqt_cli.results.quantity import Quantity
    from eqt_cli.results.result import Result


MAPPED = "mean_pose_error"
"""What is compared over a sweep unless a user chooses."""


class Format(StrEnum):
    """How tables are printed."""

    TEXT = "text"
    CSV = "csv"
    LATEX = "latex"


class Table(StrEnum):
    """Which table is printed."""

    CONTROLLERS = "controllers"
    PAIRS = "pairs"
    CLAIMS = "claims"
    FRONTS = "fronts"
    WINNERS = "winners"
    POINTS = "points"


def compare(
    result: options.Result,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            "--metric", "-m", metavar="NAME", help="What to compare, see --list; may be repeated."
        ),
    ] = None,
    window: Annotated[
        list[str] | None,
        typer.Option(
            "--window",
            "-w",
            metavar="A:B",
            help="Over which seconds, as 0:5 or 5: or : for all; may be repeated.",
        ),
    ] = None,
    against: Annotated[
        list[str] | None,
        typer.Option(
            "--against",
            metavar="LABEL",
            help="Show pairs with this controller only; may be repeated.",
        ),
    ] = None,
    table: Annotated[Table | None, typer.Option("--table", help="Print this table only.")] = None,
    format: Annotated[Format, typer.Option("--format", help="How to print it.")] = Format.TEXT,
    point: options.Point = None,
    confidence: Annotated[
        float, typer.Option("--confidence", help="Of every interval by itself.")
    ] = 0.95,
    resamples: Annotated[
        int, typer.Option("--resamples", metavar="N", help="Of the bootstrap.")
    ] = 9999,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the bootstrap.")] = 0,
    robust: Annotated[
        bool, options.flag("--robust", help="Of a sweep: how far each law carries.")
    ] = False,
    share: Annotated[
        float, typer.Option("--share", help="Of runs that must settle, for --robust.")
    ] = 0.9,
    list_: Annotated[
        bool, options.flag("--list", help="List what this result can be compared by.")
    ] = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Compare controllers run by run, with intervals, and test what the paper claims.

    Of a sweep: which law wins at which point, or one point with --point.
    """
    from eqt_cli import api
    from eqt_cli.analysis.comparison.bootstrap import Resampling
    from eqt_cli.analysis.comparison.records import records

    if json and format is not Format.TEXT:
        raise EqtError("--json prints one document for all tables; leave --format out")
    if list_:
        with api.open_results(result, "arrays", point) as results:
            _print_metrics(results, json)
        return
    how = Resampling(confidence, resamples, seed)
    if robust:
        _print_robustness(result, share, confidence, format, json=json)
        return
    narrowed = bool(window or against)
    if point is None and _print_whole(
        result, metric or (), table, format, how, narrowed=narrowed, json=json
    ):
        return
    _require_table_of_experiment(table)
    comparison = api.compare(
        result,
        metric or (),
        window or (),
        point=point,
        confidence=confidence,
        resamples=resamples,
        seed=seed,
    )
    _check_labels(comparison, against or ())
    if json:
        print_json(_document(comparison, result))
    elif format is Format.CSV:
        print_text(as_csv(records(comparison)[table or Table.PAIRS]))
        if table is None and not quiet:
            say("these are the pairs; --table controllers and --table claims print the others")
    else:
        _print_tables(comparison, table, against or (), format, quiet=quiet)


def _print_whole(
    path: Path,
    metrics: Sequence[str],
    table: Table | None,
    format: Format,
    how: Resampling,
    *,
    narrowed: bool,
    json: bool,
) -> bool:
    """Print what there is of a sweep or of fronts as a whole; False of any other result."""
    from eqt_cli import api

    with api.open_results(path, "arrays") as result:
        is_sweep = result.is_sweep
    if is_sweep:
        _compare_sweep(path, metrics or (MAPPED,), table, format, how, narrowed=narrowed, json=json)
        return True
    if metrics or narrowed or table not in (None, Table.FRONTS):
        return False
    return _print_fronts(path, how, format, json=json)


def _require_table_of_experiment(table: Table | None) -> None:
    if table in (Table.WINNERS, Table.POINTS):
        raise EqtError(f"--table {table}: is of a sweep as a whole, and this is one experiment")
    if table is Table.FRONTS:
        raise EqtError("--table fronts: is of `eqt tune` with two `objectives`, and this is not")


def _compare_sweep(
    path: Path,
    metrics: Sequence[str],
    table: Table | None,
    format: Format,
    how: Resampling,
    *,
    narrowed: bool,
    json: bool,
) -> None:
    """Print which law wins at which point of a sweep."""
    from eqt_cli import api
    from eqt_cli.analysis.comparison.map_tables import map_records, map_tables
    from eqt_cli.analysis.comparison.notation import Latex, Plain

    if narrowed or table not in (None, Table.WINNERS, Table.POINTS):
        raise EqtError(
            "--window, --against and the tables of pairs and claims are of one experiment; choose "
            "a point of the sweep with --point, or --table winners or points"
        )
    maps = api.compare_sweep(path, metrics, **vars(how))
    with api.open_results(path, "arrays") as result:
        records = [record for found in maps for record in map_records(found, result)]
        write = Latex() if format is Format.LATEX else Plain()
        whole = table is Table.POINTS
        made = [each for found in maps for each in map_tables(found, result, write, whole=whole)]
    shown = [each for each in made if table is None or each.name == table]
    _print_as(format, {"path": str(path), "points": records}, records, shown, json=json)


def _print_metrics(results: Result, json: bool) -> None:
    from eqt_cli.analysis.comparison.notation import Plain

    write = Plain()
    rows = [
        [measure.name, write.name(measure), _windows(measure)]
        for measure in results.comparable.values()
    ]
    print_records(["metric", "is", "window"], rows, json=json)


def _windows(measure: Quantity) -> str:
    """The windows that a measure can be taken over."""
    from eqt_cli.results.time_windows import WHOLE

    if measure.windowed:
        return "any"
    return "whole run" if measure.window == WHOLE else f"{measure.window} s"


def _check_labels(comparison: Comparison, labels: list[str] | tuple[()]) -> None:
    for label in labels:
        if label not in comparison.labels:
            hint = suggestion(label, comparison.labels)
            hint = hint or f"; the result holds: {', '.join(comparison.labels)}"
            raise EqtError(f"--against: no controller '{label}'{hint}")


def _document(comparison: Comparison, path: Path) -> dict[str, object]:
    from eqt_cli.analysis.comparison.records import records

    tables = records(comparison)
    return {
        "path": str(path),
        "title": comparison.title,
        "group": comparison.group,
        "controllers": comparison.kinds,
        "runs": comparison.runs,
        "failed": comparison.failed,
        "horizon": comparison.horizon,
        "bootstrap": {
            "method": "expanded BCa",
            "confidence": comparison.confidence,
            "resamples": comparison.resamples,
            "seed": comparison.seed,
        },
        "levels": tables[Table.CONTROLLERS],
        "pairs": tables[Table.PAIRS],
        "claims": tables[Table.CLAIMS],
        "missing": comparison.missing,
    }


def _print_tables(
    comparison: Comparison,
    table: Table | None,
    against: list[str] | tuple[()],
    format: Format,
    *,
    quiet: bool,
) -> None:
    from eqt_cli.analysis.comparison.notation import Latex, Plain
    from eqt_cli.analysis.comparison.tables import text_tables

    # A table of every pair of many controllers is long: without a wish, pairs with the first one.
    chosen = against or ((), comparison.labels[:1])[table is None and format is Format.TEXT]
    notation = Latex() if format is Format.LATEX else Plain()
    made = text_tables(comparison, notation, chosen)
    shown = [made[name] for name in ([table] if table else made) if name in made]
    print_text("\n\n".join(map(as_latex if format is Format.LATEX else as_text, shown)))
    if quiet:
        return
    for sentence in comparison.missing:
        say(textwrap.fill(sentence, 100))
    if not shown:
        say(f"nothing to show: {_why_empty(comparison)}")
    elif table is None and len(comparison.labels) > 2 and not against and format is Format.TEXT:
        say("next: --table pairs shows every pair, --list what else there is to compare")


def _print_robustness(
    path: Path, share: float, confidence: float, format: Format, *, json: bool
) -> None:
    """Print how far each law of a sweep carries along the swept number."""
    from eqt_cli import api
    from eqt_cli.analysis.comparison.notation import Latex, Plain
    from eqt_cli.analysis.comparison.robustness import robustness_table

    with api.open_results(path, "arrays") as result:
        if not result.is_sweep:
            raise EqtError(f"--robust: asks a sweep, and {path} is a single experiment")
        write = Latex() if format is Format.LATEX else Plain()
        table, rows = robustness_table(result, share, confidence, write)
    _print_as(format, {"path": str(path), "share": share, "tested": rows}, rows, [table], json=json)


def _print_fronts(path: Path, how: Resampling, format: Format, *, json: bool) -> bool:
    """Print laws at equal cost; False where the result is not of a search with two objectives."""
    from dataclasses import asdict

    from eqt_cli import api
    from eqt_cli.analysis.comparison.notation import Latex, Plain
    from eqt_cli.tuning.folder import record_beside
    from eqt_cli.tuning.fronts import at_equal_cost, equal_cost_table, fronts

    with api.open_results(path, "arrays") as result:
        record = record_beside(result)
        if record is None or len(record["objectives"]) < 2:
            return False
        write = Latex() if format is Format.LATEX else Plain()
        table = equal_cost_table(result, record, write, how)
        found = [asdict(pair) for pair in at_equal_cost(fronts(result, record), how)]
    document = {"path": str(path), "objectives": record["objectives"], "fronts": found}
    _print_as(format, document, found, [table], json=json)
    return True


def _print_as(
    format: Format,
    document: dict[str, Any],
    rows: Sequence[Mapping[str, Any]],
    tables: Sequence[TextTable],
    *,
    json: bool,
) -> None:
    """One finding in the form that is asked for."""
    if json:
        print_json(document)
    elif format is Format.CSV:
        print_text(as_csv(rows))
    else:
        write = as_latex if format is Format.LATEX else as_text
        print_text("\n\n".join(map(write, tables)))


def _why_empty(comparison: Comparison) -> str:
    if len(comparison.labels) < 2:
        return "the result holds one controller, so there are no pairs"
    return "no claim is known about these controllers"
