"""Report on a result as one HTML page that needs no network and no other file."""

import re
from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from eqt_cli.analysis.certificate_table import certificate_table, with_titles
from eqt_cli.analysis.certificates.base import Row
from eqt_cli.analysis.comparison.compare import compare
from eqt_cli.analysis.comparison.maps import sweep_tables
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.comparison.tables import findings, text_tables
from eqt_cli.core.errors import EqtError
from eqt_cli.report.animation import animation
from eqt_cli.report.environment import TEMPLATES, page
from eqt_cli.report.figures import CASES, COMPARED, DEFAULT, FRONTS, SWEPT, Wanted, inline_figures
from eqt_cli.report.summary import (
    accuracy,
    called,
    columns,
    curves,
    day,
    given,
    laws,
    lead,
    made_by,
    point_table,
    provenance,
    run_table,
)
from eqt_cli.results.result import HEADLINE, Result
from eqt_cli.tuning.folder import TUNE, WORST
from eqt_cli.tuning.held_out import side_by_side
from eqt_cli.tuning.tables import tuning_tables, worst_tables

RANKS = ("mean_pose_error", "early_torque")
"""Metrics by which the median run is animated; the first that is stored is used."""


OPTIONAL = (
    "best",
    "findings",
    "headline",
    "means",
    "claims",
    "levels",
    "pairs",
    "missing",
    "picker",
    "animation",
)
"""Parts of a page that only sweeps or only single experiments have."""


SEARCHED = (
    (TUNE, "Tuned", "Tuned laws on held-out runs", tuning_tables),
    (WORST, "Worst runs", "The worst runs that were found", worst_tables),
)
"""Searches: kind, short and full title of the section, and its tables."""


def report(
    result: Result,
    wanted: Sequence[Wanted] | None = None,
    certificates: Sequence[Row] = (),
    unverified: str = "",
    author: str = "",
    notes: str = "",
    title: str = "",
    date: str = "",
) -> str:
    """Return the page about an experiment or a sweep.

    Equal results give equal pages: the page holds no date but those of the result.

    Parameters
    ----------
    result
        Open result.
    wanted
        Figures, by default those of its kind; those that cannot be drawn are omitted, with a
        remark.
    certificates
        Rows found by the verification of the result.
    unverified
        Reason why there are no certificates, if there are none.
    author, notes
        Author of the page, and remarks for its reader; blank lines separate paragraphs.
    title, date
        Title and date of the page; by default the laws and the day of the run.
    """
    shown = _default(result) if wanted is None else wanted
    drawn, remarks = inline_figures(result, shown, certificates)
    of_kind = _of_sweep(result) if result.is_sweep else _of_experiment(result)
    return page(
        "report.html.j2",
        ["report.css"],
        "report.js",
        result=result,
        failed=len(result.failures),
        lead=lead(result),
        author=author,
        title=title or called(result),
        made_by=made_by(result),
        date=date or day(result),
        notes=[" ".join(part.split()) for part in re.split(r"\n\s*\n", notes) if part.strip()],
        given=given(result),
        laws=laws(result),
        functions=result.lyapunov_functions,
        accuracy=list(accuracy(result)),
        provenance=provenance(result),
        config=str(result.attributes.get("config", "")).rstrip(),
        figures=drawn,
        remarks=remarks,
        certificates=certificate_table(rows := with_titles(certificates, result.title_of)),
        doubts=certificate_table(rows, brief=True),
        unverified=unverified,
        font=b64encode((TEMPLATES / "equations.woff2").read_bytes()).decode("ascii"),
        search=_searched(result),
        **dict.fromkeys(OPTIONAL) | of_kind,
    )


def _default(result: Result) -> Sequence[Wanted]:
    """Return the default figures for the kind of the result."""
    if WORST.beside(result):
        return (Wanted("worst"),)
    if _has_fronts(TUNE.beside(result)):
        return FRONTS
    if side_by_side(result):
        return CASES
    if result.is_sweep:
        mapped = len(result.labels) > 1 and len(result.swept_keys) in (1, 2)
        return (*SWEPT, COMPARED) if mapped else SWEPT
    return DEFAULT


def _has_fronts(record: dict[str, Any] | None) -> bool:
    """Return whether a search had two objectives, so that its laws are compared as fronts."""
    return record is not None and len(record["objectives"]) > 1


def _of_experiment(result: Result) -> dict[str, Any]:
    record = TUNE.beside(result)
    means = [name for name, of in HEADLINE.items() if of is np.mean]
    return {
        "headline": result.headline(),
        "means": columns(result, [each for name in means for each in result.in_parts(name)]),
        "picker": curves(result),
        "table": run_table(result),
        **({} if _has_fronts(record) else _compared(result)),
        **_animated(result),
    }


def _of_sweep(result: Result) -> dict[str, Any]:
    """Return the parts of a sweep; no means, since one over all points means little."""
    best = None if WORST.beside(result) or TUNE.beside(result) else sweep_tables(result)
    return {"best": best, "table": point_table(result)}


def _searched(result: Result) -> dict[str, Any] | None:
    """Return the section on the search whose outcome the result judges; None without one."""
    for kind, short, title, tables in SEARCHED:
        if record := kind.beside(result):
            made = tables(result, record)
            return {"id": kind.found, "short": short, "title": title, "tables": made}
    return None


def _compared(result: Result) -> dict[str, Any]:
    comparison = compare(result)
    made = text_tables(comparison, Plain())
    return {
        "findings": findings(comparison),
        "confidence": f"{100 * comparison.confidence:g}",
        "claims": None if comparison.departures else made.get("claims"),
        "levels": made.get("controllers"),
        "pairs": made.get("pairs"),
        "missing": comparison.missing,
    }


def _animated(result: Result) -> dict[str, Any]:
    """Return the animation of the first law's median run; empty if no body can be shown."""
    by = next((name for name in RANKS if result.has(name)), None)
    runs = [run for run in result.stored_runs if by and np.isfinite(result[by][0, run])]
    with suppress(EqtError):
        if by and runs:
            middle = sorted(runs, key=lambda run: float(result[by][0, run]))[(len(runs) - 1) // 2]
            return {
                "animation": animation(result, int(middle)),
                "animated": int(middle),
                "animated_by": result.quantity(by).described,
            }
    return {}
