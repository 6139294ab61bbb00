"""Location and rendering of the page templates."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from eqt_cli.analysis.comparison.notation import significant
from eqt_cli.core.errors import printable
from eqt_cli.core.version import __version__

_NORM = re.compile("‖[^‖]*‖")

_NUMBER = re.compile(r"[-+]?[\d.]+(e-?\d+)?( %| ± \S+| \[.*\])?")
"""A number, perhaps with a percent sign, a spread or an interval."""

TEMPLATES = Path(__file__).with_name("templates")


def page(template: str, styles: Sequence[str], script: str, **values: Any) -> str:
    """Fill in a template, with its styles and its script in the page."""
    css, js = (
        Markup("".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names))
        for names in (styles, [script])
    )
    made = _environment().get_template(template)
    return made.render(version=__version__, css=css, js=js, **values)


def _environment() -> Environment:
    """Return the template environment, which escapes everything.

    HTML markup is escaped, and characters that no page can show, such as bidirectional controls.
    """
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalized,
    )
    made.filters |= {
        "typeset": _typeset,
        "prose": _prose,
        "minus": _minus,
        "numeric": _numeric,
        "significant": significant,
    }
    return made


def _finalized(value: Any) -> Any:
    is_text = isinstance(value, str) and not isinstance(value, Markup)
    return printable(value, "\n\t") if is_text else value


def _typeset(text: str) -> Markup:
    """Typeset the paper's symbols with their subscripts; all else is only escaped."""
    escaped = str(escape(printable(text)))
    for symbol in ("Q_E", "Q_d", "V_d", "P_d", "K_d", "τ_d", "τ_ff", "𝕀_t"):
        letter, index = symbol.split("_")
        escaped = re.sub(rf"\b{symbol}\b", f"{letter}<sub>{index}</sub>", escaped)
    escaped = re.sub(r"\bAd_\{([^}]*)\}", r"Ad<sub>\1</sub>", escaped)
    return Markup(_NORM.sub(lambda norm: norm[0].replace(" ", "\u00a0"), escaped))


def _prose(text: str) -> Markup:
    """Typeset a sentence: symbols, powers of ten, minus signs, and no break before a unit."""
    signed = (
        re.sub(r"(?<![\w.])-(?=\d)", "−", text).replace(" %", "\u00a0%").replace("N m", "N\u00a0m")
    )
    powers = re.sub(
        r"(?<=\d)e([-+]?)0*(\d+)",
        lambda match: (
            f"\u00a0·\u00a010<sup>{match[1].replace('-', '−').strip('+')}{match[2]}</sup>"
        ),
        str(_typeset(signed)),
    )
    return Markup(powers)


def _minus(text: str) -> str:
    """Replace a hyphen before a digit, and not after a letter or digit, by a minus sign."""
    return re.sub(r"(?<![^\W_])-(?=\d)", "−", text)


def _numeric(rows: Sequence[Sequence[str]]) -> list[bool]:
    """Return which columns of a table are numeric."""
    return [all(map(_is_numeric, column)) for column in zip(*rows, strict=True)]


def _is_numeric(cell: str) -> bool:
    return cell in ("", "-") or _NUMBER.fullmatch(cell) is not None
