"""`eqt margins`: stability margins of the loop of each law."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import complain, count_of, laid_out, print_found

if TYPE_CHECKING:
    from rich.text import Text

    from eqt_cli.analysis.margins import GainMargin, LawMargins, Margins

VERDICTS = {True: "stable", False: "unstable", None: "undecided"}


def margins(
    config: options.Config,
    set_: options.Set = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Print eigenvalues, delay and gain margins of each law; exit 4 if a loop is unstable.

    The loop is linearised about its reference. Limits, steps and noise are left out and named.
    Nothing is run.
    """
    from eqt_cli import api

    source = options.source_of(config, set_)
    found = api.margins(
        options.study_at(source, point, trust_plugins=trust_plugins, doing="without")
    )
    causes = [f"the loop of '{law.label}' is unstable" for law in found.laws if law.is_unstable]
    print_found(_document(found, causes), *_pieces(found), json=json)
    if quiet and not json:
        for cause in causes:
            complain(f"eqt: {config}: {cause}")
    if causes:
        raise typer.Exit(4)


def _document(found: Margins, causes: list[str]) -> dict[str, Any]:
    return {
        "name": found.experiment.name,
        "group": found.experiment.group.name,
        "period": found.period,
        "left_out": found.left_out,
        "causes": causes,
        "laws": [
            {
                "label": law.label,
                "verdict": _verdict(law),
                "largest_eigenvalue": law.size,
                "eigenvalue": [law.growth.eigenvalue.real, law.growth.eigenvalue.imag],
                "at": law.growth.at if law.changes else None,
                "cycle": law.cycle,
                "growth_rate": law.growth.rate,
                "offset": law.offset.tolist(),
                "delay_margin": law.delay,
                "delay_margin_periods": law.delay_periods,
                "delay_margin_is_least": law.delay_is_least,
                "gain_margins": {
                    name: {"lower": gain.lower, "upper": gain.upper}
                    for name, gain in law.gains.items()
                },
            }
            for law in found.laws
        ],
    }


def _pieces(found: Margins) -> Iterator[str | Text]:
    """Yield the printed text: the table, and notes on how to read it."""
    titles, sampled = found.experiment.titles, found.period is not None
    eigenvalue = "largest |eigenvalue|" if sampled else "largest real part, 1/s"
    gains = _gains(found)
    header = ["law", eigenvalue, "delay margin", *gains, "verdict"]
    rows = [[titles[law.label], *_cells(law, found.period, gains)] for law in found.laws]
    notes = list(_notes(found))
    yield laid_out(TextTable("margins", "", header, [Block("", rows)], notes, spare=("both",)))


def _notes(found: Margins) -> Iterator[str]:
    """Say what the columns mean, and what is left out."""
    from eqt_cli.analysis.margins import LARGEST_FACTOR

    titles = found.experiment.titles
    yield "delay margin: further delay of the command with which the loop is still stable"
    yield (
        "kp, kd, both: factors of these gains with which the loop is stable; "
        f"any: at least from 1/{LARGEST_FACTOR:g} to {LARGEST_FACTOR:g}"
    )
    if "position" in _gains(found):
        yield "of a cascade, kp and kd are those of its attitude law, and position is kx, kv and ki"
    for law in found.laws:
        if beside := _beside(found, law):
            yield f"{titles[law.label]} stays {beside} beside its reference; linearised there"
    for cycle in sorted({law.cycle for law in found.laws if law.cycle} - {found.period}):
        of = ", ".join(titles[law.label] for law in found.laws if law.cycle == cycle)
        yield f"eigenvalues of {of}: of {cycle:g} s, after which all that is slower is due together"
    if any(law.is_indicative and not law.changes for law in found.laws):
        yield (
            "indicative: the loop without the parts that are left out decides nothing about the "
            "whole loop"
        )
    changing = [f"{titles[law.label]} {law.growth.at:.3g} s" for law in found.laws if law.changes]
    if changing:
        yield (
            "indicative: the loop changes in time; then eigenvalues at single times do not decide "
            f"whether it is stable. All numbers are those at the worst time: {', '.join(changing)}"
        )
    if found.left_out:
        yield f"left out: {', '.join(found.left_out)}"


def _gains(found: Margins) -> list[str]:
    """Return the names of the gain margins: that of the position where a law has it."""
    from eqt_cli.analysis.margins import GAINS

    cascades = any(loop.controller.reads_flat_output for loop in found.experiment.loops.values())
    return [name for name in GAINS if cascades or name != "position"]


def _cells(law: LawMargins, period: float | None, names: list[str]) -> list[str]:
    """Return the cells of a row except the name."""
    gains = ["-" if not law.growth.is_stable else _factors(law.gains.get(name)) for name in names]
    return [f"{law.size:.{3 if period is None else 6}g}", _delay(law), *gains, _verdict(law)]


def _verdict(law: LawMargins) -> str:
    return "indicative" if law.is_indicative else VERDICTS[law.growth.is_stable]


def _delay(law: LawMargins) -> str:
    if law.delay is None:
        return "-"
    if law.delay == float("inf"):
        return "any"
    periods = law.delay_periods
    whole = "" if periods is None else f" ({count_of(periods, 'period')})"
    least = "at least " if law.delay_is_least else ""
    return f"{least}{law.delay:.4g} s{whole}"


def _factors(found: GainMargin | None) -> str:
    if found is None:
        return "not used"
    if found.lower is None:
        return "any" if found.upper is None else f"below {found.upper:.3g}"
    if found.upper is None:
        return f"above {found.lower:.3g}"
    return f"{found.lower:.3g} to {found.upper:.3g}"


def _beside(found: Margins, law: LawMargins) -> str:
    """Return the offset of a loop from its reference, part by part; empty if it has none."""
    import numpy as np

    from eqt_cli.closed_loop.linearised import AT_REST

    sizes = [
        (float(np.linalg.norm(law.offset[part.axes])), part.velocity_unit.removesuffix("/s"))
        for part in found.experiment.group.parts
    ]
    return " and ".join(f"{size:.3g} {unit}" for size, unit in sizes if size > AT_REST)
