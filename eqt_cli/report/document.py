"""A result as one HTML page that needs no network and no other file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from eqt_cli.analysis.certificate_table import certificate_table
from eqt_cli.analysis.certificates import Row
from eqt_cli.analysis.comparison import compare
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.comparison.tables import text_tables
from eqt_cli.analysis.text_tables import TextTable
from eqt_cli.core.printable import printable
from eqt_cli.core.version import __version__
from eqt_cli.report.figures import COMPARED, DEFAULT, FRONTS, SWEPT, Wanted, inline_figures
from eqt_cli.report.point_table import best_points, point_table
from eqt_cli.report.run_curves import curves
from eqt_cli.report.run_table import columns, run_table
from eqt_cli.report.summary import accuracy, lead, provenance
from eqt_cli.results.result import HEADLINE, Result
from eqt_cli.tuning.folder import record_beside
from eqt_cli.tuning.tables import tuning_tables

_NUMBER = re.compile(r"[-+]?[\d.]+(e-?\d+)?( %| ± \S+| \[.*\])?")
"""A number, perhaps with a percent sign, a spread or an interval."""

_NORM = re.compile("‖[^‖]*‖")

TEMPLATES = Path(__file__).with_name("templates")


def report(
    result: Result,
    wanted: Sequence[Wanted] | None = None,
    certificates: Sequence[Row] = (),
    unverified: str = "",
) -> str:
    """The page about an experiment or a sweep.

    Equal results give equal pages: it holds no date but those of the result.

    Parameters
    ----------
    result
        Open.
    wanted
        The figures, by default those of its kind; what cannot be drawn of this result is left out,
        with a remark.
    certificates
        What the verification of the result found.
    unverified
        Why there are no certificates, if there are none.
    """
    shown = _default(result) if wanted is None else wanted
    drawn, remarks = inline_figures(result, shown, certificates)
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            version=__version__,
            result=result,
            failed=len(result.failures),
            lead=lead(result),
            accuracy=list(accuracy(result)),
            provenance=provenance(result),
            config=str(result.attributes.get("config", "")).rstrip(),
            figures=[{"key": f.key, "svg": Markup(f.svg), "caption": f.caption} for f in drawn],
            remarks=remarks,
            certificates=_table(certificate_table(certificates)),
            unverified=unverified,
            css=Markup((TEMPLATES / "report.css").read_text(encoding="utf-8")),
            js=Markup((TEMPLATES / "report.js").read_text(encoding="utf-8")),
            **(_of_sweep(result) if result.is_sweep else _of_experiment(result)),
        )
    )


def _default(result: Result) -> Sequence[Wanted]:
    """The figures of a result of its kind."""
    if result.is_sweep:
        mapped = len(result.labels) > 1 and len(result.swept_keys) in (1, 2)
        return (*SWEPT, COMPARED) if mapped else SWEPT
    return FRONTS if _has_fronts(record_beside(result)) else DEFAULT


def _has_fronts(record: dict[str, Any] | None) -> bool:
    """Whether a result is of a search with two objectives, whose laws are compared as fronts."""
    return record is not None and len(record["objectives"]) > 1


def _of_experiment(result: Result) -> dict[str, Any]:
    record = record_beside(result)
    tuned = tuning_tables(result, record) if record else []
    made: dict[str, TextTable] = {}
    missing: list[str] = []
    if not _has_fronts(record):
        comparison = compare(result)
        made, missing = text_tables(comparison, Plain()), comparison.missing
    return {
        "best": None,
        "tuned": [_table(table) for table in tuned],
        "headline": result.headline(),
        "means": columns(result, [name for name, of in HEADLINE.items() if of is np.mean]),
        "claims": _table(made.get("claims")),
        "levels": _table(made.get("controllers")),
        "pairs": _table(made.get("pairs")),
        "missing": missing,
        "picker": curves(result),
        "table": run_table(result),
    }


def _of_sweep(result: Result) -> dict[str, Any]:
    """As of an experiment; a mean over all points means little."""
    absent = ("headline", "means", "claims", "levels", "pairs", "missing", "picker")
    best, table = _table(best_points(result)), point_table(result)
    made: dict[str, Any] = {"best": best, "table": table, "tuned": []}
    return dict.fromkeys(absent) | made


def environment() -> Environment:
    """Where templates are found, and how they are filled in: everything is escaped.

    Markup of HTML, and what no page can show, such as an order of reading that is turned around.
    """
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalized,
    )
    made.filters["typeset"] = _typeset
    return made


def _finalized(value: Any) -> Any:
    is_text = isinstance(value, str) and not isinstance(value, Markup)
    return printable(value, "\n\t") if is_text else value


def _typeset(text: str) -> Markup:
    """The paper's symbols with their subscripts; all else is only escaped."""
    escaped = str(escape(printable(text)))
    for symbol in ("Q_E", "Q_d", "V_d", "P_d", "K_d", "τ_d", "τ_ff", "𝕀_t"):
        letter, index = symbol.split("_")
        escaped = re.sub(rf"\b{symbol}\b", f"{letter}<sub>{index}</sub>", escaped)
    escaped = re.sub(r"\bAd_\{([^}]*)\}", r"Ad<sub>\1</sub>", escaped)
    return Markup(_NORM.sub(lambda norm: norm[0].replace(" ", "\u00a0"), escaped))


def _table(table: TextTable | None) -> dict[str, Any] | None:
    """A table for the page: minus signs as such, and which columns are numbers."""
    if table is None:
        return None
    cells = list(zip(*table.rows, strict=True))
    return {
        "caption": table.caption,
        "header": table.header,
        "numeric": [all(_is_numeric(cell) for cell in column) for column in cells],
        "blocks": [
            {"title": block.title, "rows": [[_minus(cell) for cell in row] for row in block.rows]}
            for block in table.blocks
        ],
        "notes": table.notes,
    }


def _is_numeric(cell: str) -> bool:
    return cell in ("", "-") or _NUMBER.fullmatch(cell) is not None


def _minus(cell: str) -> str:
    """A hyphen before a digit is a minus sign."""
    return "".join(
        "−" if c == "-" and cell[i + 1 : i + 2].isdigit() and not cell[i - 1 : i].isalnum() else c
        for i, c in enumerate(cell)
    )
