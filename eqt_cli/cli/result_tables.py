"""Summary tables and remarks on a result, shared by several commands."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import Block, TextTable, listed, percent, significant
from eqt_cli.cli import output
from eqt_cli.cli.tables import csv_cell
from eqt_cli.results import summary
from eqt_cli.results.conclusion import answers_of
from eqt_cli.results.result import Result, mean_over_runs, window_of
from eqt_cli.results.timing import timing_lines

if TYPE_CHECKING:
    from rich.text import Text


FAR_ABOVE = 1000.0
"""Multiple of solver.rtol above which an error estimate is warned of, as a failed cross-check is.

In 13 shipped configurations it is at most 64, and 433 where a limit or a jump of the law hampers
`solve_ivp`."""

IN_WORDS = {
    "of ‖p − p_d‖": "position error",
    "‖p − p_d‖": "position error",
    "‖τ‖": "torque",
    "‖f‖": "force",
}
"""Symbols of headings, and what they are."""

MANY, RARE = 1000, 0.01
"""Minimum runs, and maximum share of unsettled runs, for exact intervals of that share."""

MOST_FAILURES = 10
"""Maximum number of different messages of failed runs that are shown."""

MOST_READ = 500
"""Maximum number of failed runs whose messages are read."""


def print_outcome(result: Result, heading: Sequence[str] = ()) -> None:
    """Print the outcome below a heading, and doubts about it and failures on stderr.

    The result is read before anything is printed, so that a damaged file leaves no partial output.
    """
    lines: list[str | Text] = [*heading]
    for answer in answers_of(result)[1]:
        lines += [output.laid_out(answer), ""]
    rows = summary.headline(result)
    if result.is_sweep:  # no table over all points, since that means little
        from eqt_cli.analysis.maps import sweep_tables

        for table in sweep_tables(result):
            lines += [output.laid_out(table), ""]
    else:
        lines += [_headline(result, rows), "", *_shares(result, rows), *timing_lines(result)]
    checked = ", ".join(_accuracy(result, rows))
    if checked:
        lines += [f"checked  {checked}"]
    if result.described.exact:
        lines.append(f"exact    {result.described.exact}: no sensor measures it with errors")
    lines += [
        f"solver   {x}"
        for tell in functions_for(purposes.remarks_on_a_result)
        for x in tell(result)
    ]
    doubts, failures = [*_doubts(result)], [*_failures(result)] if result.status.any() else []
    output.print_text(*lines)
    for doubt in doubts:
        output.complain(doubt, "warning")
    for failure in failures:
        output.complain(failure)


def outcome_record(result: Result) -> dict[str, Any]:
    """Return the outcome for programs: each law's headline, or the points that it wins."""
    from eqt_cli.analysis.maps import winners

    about = {"window": str(window_of(result)), **answers_of(result)[0]}
    if not result.is_sweep:
        return about | {"controllers": summary.headline(result)}
    won = {
        winner_map.quantity.name: {
            **{label: winner_map.wins(law) for law, label in enumerate(winner_map.labels)},
            **winner_map.without_winners(),
        }
        for winner_map in winners(result)
    }
    return about | {"points_won": won}


def _headline(result: Result, laws: list[dict[str, Any]]) -> Text:
    """Return a line per law: how many runs settle, and the means of errors and torque.

    Parts with units of their own have columns of their own. No law is marked as the best, since a
    smaller mean may be luck: `eqt compare` tests that.
    """
    names = list(_shown(result))
    titles = [result.title_of[row["controller"]] for row in laws]
    columns = [titles, [_ended(row) for row in laws]]
    for name in names:
        columns.append([significant(row.get(name, np.nan)) for row in laws])
    settled = "settled" if all("settled" in row for row in laws) else "runs"
    header = ["law", settled, *(_heading(result, name) for name in names)]
    spare = tuple(head for head in reversed(header) if head.startswith("final"))
    rows = [list(row) for row in zip(*columns, strict=True)]
    return output.laid_out(TextTable("headline", "", header, [Block("", rows)], [], spare))


def _shown(result: Result) -> Iterator[str]:
    """Yield metrics of the user, and the numbers by which laws are compared first, also finally."""
    headlines = summary.headlines(result)
    for name in dict.fromkeys([*summary.own_metrics(result), *summary.compared_first(result)]):
        yield name
        final = name.replace("mean", "final").replace("position_rms", "final_position_error")
        if final != name and final in headlines:
            yield final


def _ended(row: dict[str, Any]) -> str:
    """Return how many runs settled, or did not fail."""
    if "settled" in row:
        return f"{row['settled']}/{row['runs'] - row['by_rounding']}"
    return str(row["runs"] - row["failed"])


def _heading(result: Result, name: str) -> str:
    """``mean attitude error, deg``: in words that need no note."""
    words, unit = result.quantity(name).plain, summary.unit_in_words(result, name)
    for symbol, plain in IN_WORDS.items():
        words = words.replace(symbol, plain)
    return f"{words}, {unit}" if unit else words


def _shares(result: Result, laws: list[dict[str, Any]]) -> Iterator[str]:
    """Yield rare unsettled runs, time at a limit, and errors by sampling."""
    rows = [(result.title_of[row["controller"]], row) for row in laws]
    if all("settled" in row for _, row in rows):
        counted = {title: row["runs"] - row["by_rounding"] for title, row in rows}
        yield from _rare(result, {title: counted[title] - row["settled"] for title, row in rows})
    if all("saturated_share" in row for _, row in rows):
        shares = ", ".join(f"{title} {100 * row['saturated_share']:.2f} %" for title, row in rows)
        yield f"time at a limit: {shares}"
        yield from _cut(result)
    quantities = result.comparable
    shown = [*summary.headlines(result), *result.in_parts("saturated_share")]
    for quantity in (quantities[name] for name in shown if name in quantities):
        if quantity.hold(result.described.holds) and len(result.times) > 1:
            number = result.per_run(quantity)
            least = 1e-3 * float(np.nan_to_num(mean_over_runs(number.values)).min())
            yield from number.sampling_note(least, summary.unit_in_words(result, quantity.name))


def _cut(result: Result) -> Iterator[str]:
    """Yield the directions in which limits change the commands, and their shares of the time."""
    laws = []
    for c, title in enumerate(result.titles):
        good, shares = result.good[..., c, :], []
        for name in result.metrics:
            if name.startswith("cut_share_"):
                direction = name.removeprefix("cut_share_").replace("_", " ")
                share = result.metric(name, c)[good].sum() / max(1, good.sum())
                shares += [f"{direction} {100 * share:.2f} %"] if share else []
        if shares:
            laws.append(f"{title} {listed(shares)}")
    if laws:
        yield f"commands cut by limits: {'; '.join(laws)}"


def _rare(result: Result, unsettled: dict[str, int]) -> Iterator[str]:
    """Yield the shares of unsettled runs, for laws where few of many did not settle."""
    runs = result.good[..., 0, :].size
    few = {title: count for title, count in unsettled.items() if count < RARE * runs}
    if runs < MANY or not few:
        return
    from eqt_cli.analysis.intervals import Resampling, share

    level = Resampling.confidence
    shares = {title: share(count, runs, level, exact=True) for title, count in few.items()}
    words = "; ".join(
        f"{title} {few[title]} of {runs}, {value:.2g} [{low:.2g}, {high:.2g}]"
        for title, (value, low, high) in shares.items()
    )
    yield f"not settled: {words} (exact {100 * level:g} % intervals)"
    if any(few.values()):
        yield f"`eqt show {result.path.parent} --table unsettled` lists their starts"


def _accuracy(result: Result, laws: list[dict[str, Any]]) -> Iterator[str]:
    """Yield how accurate the numbers are: energy balance, error estimates, and cross-check."""
    residuals = {
        result.title_of[row["controller"]]: row["energy_residual"]
        for row in laws
        if np.isfinite(row.get("energy_residual", np.nan))
    }
    if residuals:
        some = f" of {listed([*residuals])}" if len(residuals) < len(result.titles) else ""
        yield f"energy balance{some} to {max(residuals.values()):.0e}"
    estimates = result.metric("error_estimate")
    if np.isfinite(estimates).any():
        yield f"errors to {np.nanmax(estimates):.0e}"
    check = result.cross_check
    if check and (np.isnan(check.difference) or not check.holds):
        yield check.described
    elif check:
        method, _, beginning = check.method.partition(" over the ")
        yield f"{method} to {check.difference:.0e}" + (f" ({beginning})" if beginning else "")


def drift_beyond(result: Result) -> float:
    """Return how far poses leave the group, if that is more than the cross-check allows; else 0."""
    check = result.cross_check
    drift = float(result["group_drift"][result.good].max(initial=0.0))
    return drift if check and drift > check.bound else 0.0


def _doubts(result: Result) -> Iterator[str]:
    """Yield remarks on a check that does not hold, and on estimates above the tolerance."""
    check, drift = result.cross_check, drift_beyond(result)
    if check and not check.holds:
        where = f"'{check.law}'" if check.law else "the laws"
        yield (
            f"the two integrators differ by more than the bound, most in {where}; tighten "
            "solver.rtol, or look for kinks and discontinuities there; or, in code, for what it "
            "keeps from call to call and `memory` does not name"
        )
    elif check and drift:
        yield (
            f"poses leave the group by {drift:.2g}, more than the bound of the "
            f"cross-check, {check.bound:.1g}; tighten solver.rtol"
        )
    error, name, law, samples = (
        result.attributes.get(f"row_{key}") for key in ("error", "metric", "law", "samples")
    )
    if error is not None and samples is not None and str(law) in result.title_of:
        metric = result.quantity(str(name)).plain
        yield (
            f"samples are too far apart: {metric} of {result.title_of[str(law)]} is wrong by "
            f"{percent(float(error))}; with time.samples {float(samples):.0f} no metric is "
            "by more than 1 %"
        )
    estimates, rtol = result.metric("error_estimate"), result.described.rtol
    if above := 0 if rtol is None else int(np.count_nonzero(estimates > FAR_ABOVE * rtol)):
        yield (
            f"the error estimates of {output.count_of(above, 'run')} exceed {FAR_ABOVE:g} "
            f"times solver.rtol = {rtol:g}; the largest is {np.nanmax(estimates):.2g}; tighten "
            "solver.rtol, or set solver.max_error to count such runs as failed"
        )


def _failures(result: Result) -> Iterator[str]:
    """Yield the number of failed runs by ending, and each message with its first run."""
    failures = result.failures
    total, first = len(failures), failures[:MOST_READ]
    listed = ", ".join(f"{count} {ending}" for ending, count in summary.endings(result).items())
    yield f"\n{output.count_of(total, 'run')} failed: {listed}"
    places: dict[str, list[str]] = {}
    for where, message in zip(first, result.messages(first), strict=True):
        places.setdefault(message, []).append(result.place(where))
    for message, runs in list(places.items())[:MOST_FAILURES]:
        others = f" and {len(runs) - 1} more" if len(runs) > 1 else ""
        yield f"  {runs[0]}{others}: {message}"
    if total > min(len(places), MOST_FAILURES):
        those = f"of the first {MOST_READ}; " if total > MOST_READ else ""
        cut = "… " if len(places) > MOST_FAILURES else ""
        how = f"`eqt show {result.path.parent} --failed` lists all"
        yield f"  {cut}{those}{how}"


# Tables with one row per run, for other programs --------------------------------------------------


def print_table(result: Result, name: str, form: str) -> None:
    """Print a table on stdout, with all digits."""
    from eqt_cli.results.dataset import columns

    if name == "metrics":  # those in another unit have it in their names
        numbers = result.comparable.items()
        rescaled = {name for name, of in numbers if result.units(name) != result.unit_of(of)}
        table = {
            f"{name} ({result.units(name)})" if name in rescaled else name: column
            for name, column in columns(result).items()
        }
    else:
        table = _unsettled(result)
    if form == "parquet":
        _print_parquet(table)
        return
    rows = list(zip(*(column.tolist() for column in table.values()), strict=True))
    if not rows:
        output.complain("every run settled")
    if form == "csv":
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(map(csv_cell, table))
        writer.writerows(map(csv_cell, row) for row in rows)
        return
    for row in rows:
        output.print_verbatim(output.json_text(dict(zip(table, row, strict=True))))


def _unsettled(result: Result) -> dict[str, Array]:
    """Return the unsettled runs and their starts, in columns that `initial.file` takes."""
    settled = summary.settles(result)
    if settled is None:
        raise result.error("does not tell which runs settled")
    if result.is_sweep:
        raise EqtError("--table unsettled: a sweep has starts by point; choose one with --point")
    runs = np.flatnonzero(~settled.all(axis=0))
    laws = zip(result.labels, settled[:, runs].astype(int), strict=True)
    poses, velocities = (result.read(f"initial_{of}", run=runs) for of in ("pose", "velocity"))
    size = range(1, poses.shape[-1] + 1)
    names = [f"Q{row}{column}" for row in size for column in size]
    names += [f"V{k}" for k in range(1, velocities.shape[-1] + 1)]
    starts = np.concatenate([poses.reshape(len(runs), len(size) ** 2), velocities], axis=1)
    of_laws = {f"settled_{label}": law for label, law in laws}
    return {"run": runs} | of_laws | dict(zip(names, starts.T, strict=True))


def _print_parquet(table: dict[str, Array]) -> None:
    if sys.stdout.isatty():
        raise EqtError("--format parquet: is for a file; add > FILE.parquet")
    if absent := [name for name in ("pandas", "pyarrow") if not find_spec(name)]:
        raise EqtError(f"--format parquet needs {' and '.join(absent)}: pip install pandas pyarrow")
    import pandas

    sys.stdout.buffer.write(pandas.DataFrame(table).to_parquet())
