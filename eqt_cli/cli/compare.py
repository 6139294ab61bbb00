"""`eqt compare`: paired statistics and claims."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.cli import completion, options, output
from eqt_cli.cli.tables import as_csv, as_latex

if TYPE_CHECKING:
    from eqt_cli.analysis.comparison import Comparison
    from eqt_cli.analysis.intervals import Resampling
    from eqt_cli.base.reporting import TextTable
    from eqt_cli.results.quantity import Plain
    from eqt_cli.results.result import Result

TableFormat = StrEnum("TableFormat", "TEXT CSV LATEX")
TableName = StrEnum("TableName", "CONTROLLERS PAIRS CLAIMS ALL FRONTS WINNERS POINTS")
Rows = StrEnum("Rows", "MEASURES CONTROLLERS")
Undecided = StrEnum("Undecided", "FAIL PASS")
"""Formats of printed tables, the tables, rows of that of means, and what a gate does where the
outcome is not shown: words in lower case."""

REQUIREMENTS = "requirements"
"""The rule of a gate that the requirements of a result are met."""

_NEEDS = {
    TableName.WINNERS: "a whole sweep; this is a single experiment",
    TableName.POINTS: "a whole sweep; this is a single experiment",
    TableName.FRONTS: "a result of `eqt tune` with two `objectives`",
}


@dataclass(frozen=True)
class Gate:
    """What the second of two results must not have."""

    fail_on: Annotated[list[str] | None, options.option("--fail-on")] = None
    undecided: Annotated[Undecided, options.option("--undecided")] = Undecided.FAIL
    law: Annotated[list[str] | None, options.option("--law")] = None
    same: Annotated[str | None, options.option("--same")] = None

    def arguments(self, other: Path | None) -> dict[str, Any]:
        """Return the arguments of `api.compare`."""
        rules = [rule for rule in self.fail_on or () if rule.strip() != REQUIREMENTS]
        if other is None and any((rules, self.law, self.same)):
            raise EqtError(
                "--fail-on, --law and --same compare two results; name OTHER, too (one result may "
                "have `--fail-on requirements`)"
            )
        if self.undecided is Undecided.PASS and not self.fail_on:
            raise EqtError("--undecided pass applies to --fail-on; add a rule")
        same = [name.strip() for name in (self.same or "").split(",") if name.strip()]
        laws = options.pairs("--law", self.law, "NEW=OLD")
        return {"other": other, "fail_on": rules or None, "law": laws, "same": same}

    def required(self, records: Sequence[Mapping[str, Any]]) -> tuple[bool, list[str]]:
        """Return whether a result passes by its requirements, and the line that says so.

        Raises
        ------
        EqtError
            If it has none.
        """
        if REQUIREMENTS not in [rule.strip() for rule in self.fail_on or ()]:
            return True, []
        if not records:
            raise EqtError("--fail-on requirements: the result has none; add `require` and run it")
        broken = ("fails", *(["not shown"] if self.undecided is Undecided.FAIL else []))
        passes = all(record["verdict"] not in broken for record in records)
        counts = Counter(str(record["verdict"]) for record in records)
        said = ", ".join(f"{count} of {len(records)} {word}" for word, count in counts.items())
        return passes, [f"{'passes' if passes else 'FAILS'}  requirements: {said}", ""]


def compare(
    result: options.Result,
    other: Annotated[
        Path | None,
        typer.Argument(metavar="OTHER", help="Another result, to compare with the first."),
    ] = None,
    metric: Annotated[
        list[str] | None, options.option("--metric", "-m", autocompletion=completion.metrics)
    ] = None,
    window: Annotated[list[str] | None, options.option("--window", "-w")] = None,
    controller: options.Controllers = None,
    without_start: Annotated[bool, options.option("--without-start")] = False,
    rows: Annotated[Rows | None, options.option("--rows")] = None,
    against: Annotated[
        list[str] | None, options.option("--against", autocompletion=completion.laws)
    ] = None,
    columns: Annotated[int, options.option("--columns", min=1, max=2)] = 2,
    table: Annotated[TableName | None, options.option("--table")] = None,
    format: Annotated[TableFormat, options.option("--format")] = TableFormat.TEXT,
    point: options.Point = None,
    unit: options.Units = None,
    confidence: Annotated[float, options.option("--confidence")] = 0.95,
    resamples: Annotated[int, options.option("--resamples")] = 9999,
    seed: Annotated[int, options.option("--seed", min=0)] = 0,
    share: Annotated[float, options.option("--share")] = 0.9,
    measured: options.Measured = None,
    mapping: options.Mapping = None,
    log_format: options.LogFormat = "csv",
    run: Annotated[int, options.option("--run")] = 0,
    list_: Annotated[bool, options.option("--list")] = False,
    json: options.Json = False,
    negligible: Annotated[float, options.option("--negligible", min=0.0)] = 0.01,
    pooled: Annotated[bool, options.option("--pooled")] = False,
    sequential: Annotated[bool, options.option("--sequential")] = False,
    quiet: options.Quiet = False,
    *,
    gate: Gate,
) -> None:
    """Compare the laws of a result run by run, with confidence intervals.

    Of two results, such as before and after a change of gains, this compares each law of the second
    with the same law of the first. With --fail-on, it exits with 4 if a law became worse by more
    than a margin, or if the runs do not show that it did not.

    This prints a row per law: its error, effort and settled runs against the first law, each with
    an interval and a mark: ✓ better, ✗ worse, = no difference, ? undecided. --table prints the
    numbers behind it.

    For a sweep, this shows which law is best at each point; --point selects one point.

    With --measured, it shows how much of the tracking error in a recording one run of each
    law explains.

    Options
    -------
    What to show
        --metric NAME  Metric to compare; --list shows all. Repeatable.
        --window A:B  Time window in seconds, such as 0:5, 5: or : for the whole run. Repeatable.
        --without-start  For a tuning: omit the starting gains.
        --against LAW  Compare with this law instead of the first, or with --measured only
            its run. Repeatable for tables.
        --table NAME  Print only this table: `controllers` (the default of LaTeX), pairs, claims,
            fronts, winners, points; or all of them.
        --pooled  For a sweep: each law against the first one over all points together.
        --run K  Run for --measured, counted from 0.
        --list  List the metrics of this result.
    Two results
        --fail-on RULE  What must not be: 'effort worse by 5 %', 'settled worse by 2 points', worse
            (by the words of the comparison); failed, which is always tested. Repeatable. Of
            one result: requirements, those of its `require`.
        --undecided WORD  fail or pass, where a rule is not shown to hold.
        --law NEW=OLD  The law of the first result with which a law of the second is compared.
            Repeatable.
        --same SECTIONS  Sections of the configuration that must be equal: reference,initial.
    Output
        --rows NAME  Rows of the table of means: measures or `controllers`. Default:
            `controllers` in LaTeX that spans two columns of text.
        --columns N  Columns of text that a table in LaTeX spans: 1 or 2.
        --format NAME  text, csv or latex.
    Statistics
        --confidence P  Confidence level of each interval.
        --negligible X  Relative difference that counts as none, such as 0.01.
        --sequential  Words and gates hold at every look, so that you may add runs until they
            decide.
        --resamples N  Number of bootstrap resamples.
        --seed N  Random seed of the bootstrap.
        --share P  At a point of a sweep, a law that settles in fewer than 1 − P of the runs where
            another one settles in P is not ranked.
    """
    from eqt_cli.analysis.intervals import Resampling
    from eqt_cli.api.loading import open_at
    from eqt_cli.results.conclusion import answers_of
    from eqt_cli.results.quantity import Latex, Plain

    of_two = gate.arguments(other)
    if other and any((without_start, measured, against)):
        raise EqtError(
            "--without-start, --measured and --against apply to one result; leave them out with two"
        )
    if json and format is not TableFormat.TEXT:
        raise EqtError("--json prints one document for all tables; leave --format out")
    if list_:
        with open_at(result, point) as results:
            _print_metrics(results, json)
        return
    write = Latex() if format is TableFormat.LATEX else Plain()
    how, shown = Resampling(confidence, resamples, seed, sequential), None
    chosen = {"metrics": metric or (), "controllers": controller or (), "units": unit or ()}
    narrow = bool(window or against or without_start)
    if measured is not None:
        if metric or window or table not in (None, TableName.ALL):
            raise EqtError(
                "--measured compares with a recording; leave --metric, --window and other tables "
                "out"
            )
        explained = function_for(purposes.compare_measured)(
            result,
            measured,
            mapping,
            format=log_format,
            run=run,
            controllers=against or (),
            point=point,
            units=unit or (),
        )
        tell = function_for(purposes.findings_on_a_recording)
        shown = _Shown(*tell(explained, measured, write, table is TableName.ALL))
    else:
        options.require_measured(mapping, log_format, run)
        if pooled:
            alone = not (narrow or other or table or sequential) and point is None
            shown = _pooled(result, chosen, write, how, negligible, alone=alone)
        elif point is None and other is None:
            shown = _of_whole(result, chosen, table, narrow, write, how, share)
    if shown is None:
        more: dict[str, Any] = {"windows": window or (), "without_start": without_start}
        more |= {"point": point, "negligible": negligible, **vars(how)}
        is_wide = format is TableFormat.LATEX and columns > 1
        as_rows = rows is Rows.CONTROLLERS or (rows is None and is_wide)
        look = _Look(table, against or (), format, write, as_rows, json)
        shown = _of_experiment(result, chosen | of_two | more, look, gate)
    with ExitStack() as opened:
        both = [opened.enter_context(open_at(path)) for path in (result, other) if path]
        remarked = output.remarked(*both)
        document, answers = answers_of(both[-1] if point is None else both[-1].point(point))
    passes, gated = gate.required(document.get(REQUIREMENTS, ()))
    is_plain = table is None and format is TableFormat.TEXT
    shown = shown._replace(
        document={**document, **shown.document},
        tables=[*(answers if is_plain and not pooled else ()), *shown.tables],
        gate=[*gated, *shown.gate],
        passes=passes and shown.passes,
    )
    with suppress(BrokenPipeError):  # the exit code is also for those whose reader has left
        _print(shown, result, format, json, columns, remarked)
    if not shown.passes:
        raise typer.Exit(4)


def _pooled(
    path: Path,
    chosen: Mapping[str, Any],
    write: Plain,
    how: Resampling,
    negligible: float,
    *,
    alone: bool,
) -> _Shown:
    from eqt_cli.api.loading import open_at

    if not alone:
        raise EqtError(
            "--pooled is one answer about all points of one sweep; leave --window, "
            "--against, --without-start, --table, --point, --sequential and OTHER out"
        )
    with open_at(path) as result:
        of = chosen["metrics"], chosen["controllers"]
        return _Shown(*function_for(purposes.compare_pooled)(result, how, write, *of, negligible))


class _Shown(NamedTuple):
    """What is printed: a document for programs, rows, tables, and what comes before them.

    Of a gate, its lines and whether it passes.
    """

    document: Mapping[str, Any] = {}
    records: Sequence[Mapping[str, Any]] = ()
    tables: Sequence[TextTable] = ()
    remarks: Sequence[str] = ()
    premises: Sequence[str] = ()
    gate: Sequence[str] = ()
    passes: bool = True


def _print(
    shown: _Shown,
    result: Path,
    format: TableFormat,
    json: bool,
    columns: int,
    remarked: Sequence[str],
) -> None:
    if json:
        output.print_json({"path": str(result), "remarks": remarked, **shown.document})
        return
    is_text = format is TableFormat.TEXT
    for line in shown.gate:
        (output.print_text if is_text else output.say)(line)
    if format is TableFormat.CSV:
        output.print_verbatim(as_csv(shown.records))
    elif format is TableFormat.LATEX:
        output.print_verbatim("\n\n".join(as_latex(table, columns) for table in shown.tables))
    else:
        if shown.premises:
            output.print_text(*shown.premises)
        for number, table in enumerate(shown.tables):
            blank = [""] if number > 0 or shown.premises else []
            output.print_text(*blank, output.laid_out(table))
        if remarked:
            output.print_text("", *(f"remark: {text}" for text in remarked))
        _print_timing(result if result.is_dir() else result.parent, result)
    for remark in shown.remarks:
        output.say(remark)


def _print_timing(folder: Path, result: Path) -> None:
    if (folder / "timing.json").exists():
        from eqt_cli.api.loading import open_at
        from eqt_cli.results.timing import timing_lines

        with open_at(result) as results:
            output.print_text("", *timing_lines(results))


def _print_metrics(results: Result, json: bool) -> None:
    from eqt_cli.results.quantity import WHOLE, Plain

    write, rows = Plain(), []
    for quantity in results.comparable.values():
        window = "whole run" if quantity.window == WHOLE else f"{quantity.window} s"
        rows.append([quantity.name, write.name(quantity), "any" if quantity.windowed else window])
    output.print_records(["metric", "is", "window"], rows, json=json)


def _of_whole(
    path: Path,
    chosen: Mapping[str, Any],
    table: TableName | None,
    narrowed: bool,
    write: Plain,
    how: Resampling,
    share: float,
) -> _Shown | None:
    """Return the findings on a sweep, or those of an extension; None for other results.

    Extensions have functions for the purpose ``answer of compare``. Each takes an open result, a
    `Resampling`, a `Plain`, and the chosen metrics and laws, and returns a document for JSON, rows
    for CSV, and tables; or None for results about which it has no answer. The answer takes the
    place of all others where no windows are chosen.
    """
    from eqt_cli import api
    from eqt_cli.api.loading import open_at

    with open_at(path) as opened:
        result = opened.in_units(chosen["units"])
        of = chosen["metrics"], chosen["controllers"]
        if not (narrowed or how.sequential) and table in (None, TableName.FRONTS):
            for answers in functions_for(purposes.answer_of_compare, result.path.parent):
                if answer := answers(result, how, write, *of):
                    return _Shown(*answer)
        if not result.is_sweep:
            return None
        from eqt_cli.analysis.maps import map_records, map_tables
        from eqt_cli.results.summary import compared_first

        if narrowed or how.sequential or table not in (None, TableName.WINNERS, TableName.POINTS):
            raise EqtError(
                "--window, --against, --without-start, --sequential and the tables of pairs and "
                "claims apply to one experiment; choose a point of the sweep with --point, or "
                "--table winners or points"
            )
        first = compared_first(result)
        mapped = first[: 2 if first[:1] == ["position_rms"] else 1]  # and the attitude's
        metrics = chosen["metrics"] or mapped
        of_maps = {**vars(how), **chosen, "metrics": metrics, "share": share}
        del of_maps["sequential"]
        maps = api.compare_sweep(path, **of_maps)
        records = [record for one in maps for record in map_records(one, result)]
        whole = table is TableName.POINTS
        tables = [
            map_table for one in maps for map_table in map_tables(one, result, write, whole=whole)
        ]
        tables.sort(key=lambda map_table: map_table.name != TableName.WINNERS)  # the answers first
        shown = [map_table for map_table in tables if table is None or map_table.name == table]
        notes = dict.fromkeys(note for map_table in shown for note in map_table.notes)
        # Notes stand once, at the end.
        shown = [replace(map_table, notes=[]) for map_table in shown]
        shown[-1:] = [replace(map_table, notes=list(notes)) for map_table in shown[-1:]]
        return _Shown({"points": records}, records, shown)


def _labels(comparison: Comparison, names: Sequence[str]) -> list[str]:
    """Return the labels of controllers named by their label or by their title in tables."""
    from eqt_cli.results.origin import label_named

    labels = [label_named(name, comparison.titles) for name in names]
    for label in labels:
        if label not in comparison.labels:
            hint = suggestion(label, comparison.labels)
            hint = hint or f"; the result holds: {', '.join(comparison.labels)}"
            raise EqtError(f"--against: no controller '{label}'{hint}")
    return labels


class _Look(NamedTuple):
    """How the findings on an experiment are shown: the options of `compare` of these names."""

    table: TableName | None
    against: Sequence[str]
    format: TableFormat
    write: Plain
    laws_as_rows: bool
    json: bool


def _of_experiment(path: Path, chosen: Mapping[str, Any], look: _Look, gate: Gate) -> _Shown:
    from eqt_cli import api

    if look.table in _NEEDS:
        raise EqtError(f"--table {look.table} needs {_NEEDS[look.table]}")
    comparison = api.compare(path, **chosen)
    look = look._replace(against=_labels(comparison, look.against))
    if look.json:
        shown = _Shown(_document(comparison, look.against))
    elif look.format is TableFormat.TEXT and look.table is None:
        shown = _answer(comparison, look.against, bool(chosen["metrics"] or chosen["windows"]))
    else:
        shown = _tables(comparison, look)
    if comparison.gate is None:
        return shown
    from eqt_cli.analysis.gate import outcome

    is_open = gate.undecided is Undecided.PASS
    passes, record, lines = outcome(comparison.gate, undecided=is_open)
    document = {"gate": record, **shown.document}
    return shown._replace(document=document, passes=passes, gate=[*lines, ""])


def _answer(comparison: Comparison, against: Sequence[str], chosen: bool) -> _Shown:
    """Return the answer against the first law; of chosen metrics and windows also the means."""
    from eqt_cli.analysis import comparison_tables
    from eqt_cli.results.quantity import Plain

    base = against[0] if against else ""
    matrix = comparison_tables.matrix(comparison, base, whole=chosen)
    notes = [*comparison_tables.remarks(comparison, base, whole=chosen), *matrix.notes]
    shown = [replace(matrix, notes=notes)] if matrix.blocks else []
    remarks = _missing(comparison)
    if chosen:
        tables = comparison_tables.text_tables(comparison, Plain(), against)
        shown += [tables[name] for name in (TableName.CONTROLLERS,) if name in tables]
    elif len(comparison.labels) < 2:
        remarks.append("one law, so nothing to compare; `eqt show` has its numbers")
    else:
        remarks.append("next: --table pairs, controllers, claims or all; --list for all metrics")
    room = output.room_of_tables() or output.PIPED
    premises = comparison_tables.premises(comparison)
    folded = [output.folded(line, room, "    ") for line in premises]
    return _Shown(tables=shown, remarks=remarks, premises=folded)


def _tables(comparison: Comparison, look: _Look) -> _Shown:
    """Return one table, or all; as CSV the rows of one, by default of the pairs."""
    from eqt_cli.analysis.comparison_tables import records, text_tables

    name = None if look.table is TableName.ALL else look.table
    if look.format is TableFormat.CSV:
        more = "these are the pairs; --table controllers and --table claims print the others"
        rows = records(comparison, *look.against)[name or TableName.PAIRS]
        return _Shown(records=rows, remarks=[more] if look.table is None else [])
    as_rows, remarks = look.laws_as_rows, _missing(comparison)
    if look.format is TableFormat.LATEX and look.table is None:
        name = TableName.CONTROLLERS
        remarks.append("this is --table controllers; --table pairs, claims or all print others")
    tables = text_tables(comparison, look.write, look.against, laws_as_rows=as_rows)
    shown = [tables[x] for x in tables if name in (None, x)]
    if not shown:
        alone = "the result holds one law, so there are no pairs"
        none = "no claim is known about these laws"
        remarks.append(f"nothing to show: {alone if len(comparison.labels) < 2 else none}")
    return _Shown(tables=shown, remarks=remarks)


def _missing(comparison: Comparison) -> list[str]:
    return [output.folded(sentence, output.PIPED) for sentence in comparison.missing]


def _document(comparison: Comparison, against: Sequence[str]) -> dict[str, Any]:
    """Return the numbers behind a comparison for programs."""
    from eqt_cli.analysis.comparison_tables import records

    rows = records(comparison, *against)
    return {
        "title": comparison.title,
        "group": comparison.group,
        "controllers": comparison.kinds,
        **{name: getattr(comparison, name) for name in ("runs", "failed", "horizon")},
        "bootstrap": {"method": "expanded BCa", **vars(comparison.how)},
        "levels": rows[TableName.CONTROLLERS],
        "pairs": rows[TableName.PAIRS],
        "claims": rows[TableName.CLAIMS],
        "missing": comparison.missing,
        **({"between": comparison.between} if comparison.between else {}),
    }
