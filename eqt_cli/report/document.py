"""A result as one HTML page that needs no network and no other file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from eqt_cli.analysis.certificate_sheet import certificate_sheet
from eqt_cli.analysis.certificates import Row
from eqt_cli.analysis.comparison import compare
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.comparison.tables import Sheet, sheets
from eqt_cli.core.version import __version__
from eqt_cli.report.curves import curves
from eqt_cli.report.facts import facts
from eqt_cli.report.figures import DEFAULT, SWEPT, Wanted, inline_figures
from eqt_cli.report.points import best_points, point_table
from eqt_cli.report.runs import run_table
from eqt_cli.results.result import Result

_NUMBER = re.compile(r"[-+]?[\d.]+(e-?\d+)?( %| ± \S+| \[.*\])?")
"""A number, perhaps with a percent sign, a spread or an interval."""

_NORM = re.compile("‖[^‖]*‖")

TEMPLATES = Path(__file__).with_name("templates")


def report(
    results: Result,
    wanted: Sequence[Wanted] | None = None,
    certificates: Sequence[Row] = (),
    unverified: str = "",
) -> str:
    """The page about an experiment or a sweep.

    Equal results give equal pages: it holds no date but those of the result.

    Parameters
    ----------
    results
        Open.
    wanted
        The figures, by default those of its kind; what cannot be drawn of this result is left out,
        with a remark.
    certificates
        What the verification of the result found.
    unverified
        Why there are no certificates, if there are none.
    """
    sweeps = results.is_sweep
    default = SWEPT if sweeps else DEFAULT
    drawn, remarks = inline_figures(results, default if wanted is None else wanted, certificates)
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            version=__version__,
            facts=facts(results),
            figures=[{"key": f.key, "svg": Markup(f.svg), "caption": f.caption} for f in drawn],
            remarks=remarks,
            certificates=_table(certificate_sheet(certificates)),
            unverified=unverified,
            css=Markup((TEMPLATES / "report.css").read_text(encoding="utf-8")),
            js=Markup((TEMPLATES / "report.js").read_text(encoding="utf-8")),
            **(_of_sweep(results) if sweeps else _of_experiment(results)),
        )
    )


def _of_experiment(results: Result) -> dict[str, Any]:
    comparison = compare(results)
    made = sheets(comparison, Plain())
    return {
        "best": None,
        "claims": _table(made.get("claims")),
        "levels": _table(made.get("controllers")),
        "pairs": _table(made.get("pairs")),
        "missing": comparison.missing,
        "picker": curves(results),
        "table": run_table(results),
    }


def _of_sweep(results: Result) -> dict[str, Any]:
    absent = dict.fromkeys(("claims", "levels", "pairs", "missing", "picker"))
    return {**absent, "best": _table(best_points(results)), "table": point_table(results)}


def environment() -> Environment:
    """Where templates are found, and how they are filled in: everything is escaped."""
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["typeset"] = _typeset
    return made


def _typeset(text: str) -> Markup:
    """The paper's symbols with their subscripts; all else is only escaped."""
    escaped = str(escape(text))
    for symbol in ("Q_E", "Q_d", "V_d", "P_d", "K_d", "τ_d", "τ_ff", "𝕀_t"):
        letter, index = symbol.split("_")
        escaped = re.sub(rf"\b{symbol}\b", f"{letter}<sub>{index}</sub>", escaped)
    escaped = re.sub(r"\bAd_\{([^}]*)\}", r"Ad<sub>\1</sub>", escaped)
    return Markup(_NORM.sub(lambda norm: norm[0].replace(" ", "\u00a0"), escaped))


def _table(sheet: Sheet | None) -> dict[str, Any] | None:
    """A sheet for the page: minus signs as such, and which columns are numbers."""
    if sheet is None:
        return None
    columns = list(zip(*(row for part in sheet.sections for row in part.rows), strict=True))
    return {
        "caption": sheet.caption,
        "header": sheet.header,
        "numeric": [all(_is_numeric(cell) for cell in column) for column in columns],
        "sections": [
            {"title": part.title, "rows": [[_minus(cell) for cell in row] for row in part.rows]}
            for part in sheet.sections
        ],
        "notes": sheet.notes,
    }


def _is_numeric(cell: str) -> bool:
    return cell in ("", "-") or _NUMBER.fullmatch(cell) is not None


def _minus(cell: str) -> str:
    """A hyphen before a digit is a minus sign."""
    return "".join(
        "−" if c == "-" and cell[i + 1 : i + 2].isdigit() and not cell[i - 1 : i].isalnum() else c
        for i, c in enumerate(cell)
    )
