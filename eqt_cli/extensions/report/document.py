"""The document: templates, figures and tables on one page."""

import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html.entities import html5
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison_tables import matrix, premises, remarks, text_tables
from eqt_cli.analysis.maps import sweep_tables, winners
from eqt_cli.base.errors import EqtError, EqtWarning, printable
from eqt_cli.base.registry import summary as summary_of
from eqt_cli.base.reporting import WORD, reporter, step
from eqt_cli.base.version import __version__
from eqt_cli.extensions.report import summary
from eqt_cli.extensions.report.opening import extremes, opening, points_won
from eqt_cli.figures.figure import figures
from eqt_cli.figures.render import DRAWN, encode, figure_from
from eqt_cli.results.conclusion import answers_of, conclusion_of, side_by_side
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import Result

# Location and rendering of the page templates -----------------------------------------------------


_FORMULA, _COMMAND = re.compile(r"\$([^$]*[\\_][^$]*)\$"), re.compile(r"\\([a-zA-Z]+) ?")

_SYMBOL = re.compile(r"(\w)_\{([^{}]*)\}|(?<![\w.])([^\W\d_])_([^\W_]{1,2})(?![\w(])")
"""A letter with its index, as in Q_E and τ_{x}; a key such as `gains.k_R` is none."""

_NUMBER = re.compile(r"\*?[-+]?[\d.]+(e-?\d+)?( %| ± \S+| \[.*\])?")
"""A number, perhaps with a percent sign, a spread or an interval."""

TEMPLATES = Path(__file__).with_name("templates")


def page(template: str | Path, styles: Sequence[str], script: str, **values: Any) -> str:
    """Fill in a template, of the report or at a path, with its styles and its script in the page.

    HTML markup is escaped, and characters that no page can show, such as bidirectional controls.
    """
    place = TEMPLATES / template
    loader = FileSystemLoader([place.parent, TEMPLATES])
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalized,
    )
    environment.filters |= {"typeset": _typeset, "prose": _prose}
    environment.filters |= {"minus": _minus, "numeric": _numeric}
    css, js = (
        Markup("".join(loader.get_source(environment, name)[0] for name in names))
        for names in (styles, [script])
    )
    return environment.get_template(place.name).render(
        version=__version__, css=css, js=js, **values
    )


def _finalized(value: Any) -> Any:
    is_text = isinstance(value, str) and not isinstance(value, Markup)
    return printable(value, "\n\t") if is_text else value


def _typeset(text: str) -> Markup:
    """Typeset symbols with their indices, mathematics of Matplotlib, and code in backticks."""
    # Commands of TeX have the names that letters have in HTML.
    text = _COMMAND.sub(lambda name: html5.get(f"{name[1]};", name[0]), _FORMULA.sub(r"\1", text))
    whole = WORD.sub(lambda word: word[0].replace(" ", "\u00a0"), printable(text))
    pieces = re.split("`([^`]*)`", str(escape(whole)))  # escaped before there is any markup
    pieces[1::2] = [f"<code>{piece}</code>" for piece in pieces[1::2]]
    for _ in range(2):  # an index may have an index
        pieces[::2] = [_SYMBOL.sub(r"\1\3<sub>\2\4</sub>", piece) for piece in pieces[::2]]
    return Markup("".join(pieces))


def _prose(text: str) -> Markup:
    """Typeset a sentence: symbols, powers of ten, minus signs, and no break before a unit."""
    signed = re.sub(r"(?<![\w.])-(?=\d)", "−", text)

    def power(match: re.Match[str]) -> str:
        return f"\u00a0·\u00a010<sup>{match[1].replace('-', '−').strip('+')}{match[2]}</sup>"

    return Markup(re.sub(r"(?<=\d)e([-+]?)0*(\d+)", power, str(_typeset(signed))))


def _minus(text: str) -> str:
    """Replace a hyphen before a digit by a minus sign, after letters or digits only in 1e-3."""
    return re.sub(r"(?<![^\W_])-(?=\d)|(?<=\de)-(?=\d)", "−", text)


def _numeric(rows: Sequence[Sequence[str]]) -> list[bool]:
    """Return which columns of a table are numeric."""
    return [
        all(cell in ("", "-") or _NUMBER.fullmatch(cell) for cell in column)
        for column in zip(*rows, strict=True)
    ]


# Figures as SVG inside an HTML page; this module knows figures by name and options only -----------


LARGEST = 700_000
"""Maximum number of SVG characters per figure; larger figures are omitted, with a remark."""

_SVG, _XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
_DECIMAL = re.compile(r"-?\d+\.\d{3,}")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")


@dataclass(frozen=True)
class Wanted:
    """A figure to show.

    Attributes
    ----------
    name, options
        Name and options of the figure, as for `eqt plot`.
    caption
        Caption; the description of the figure if empty.
    needs
        Variable without which the figure is silently omitted.
    requested
        Whether a user requested it; the page then says why it cannot be drawn.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    caption: str = ""
    needs: str = ""
    requested: bool = False


MANY = 8
"""Most laws whose intervals stand beside a figure."""


class TooLargeFigureError(EqtError):
    """A figure that is too large for a page."""


DEFAULT = (
    Wanted("path", caption="The paths of the bodies, with the reference.", needs="position_error"),
    Wanted("summary"),
    Wanted("pose", needs="position_error"),
    Wanted("torque"),
    Wanted("commands", needs="command"),
    Wanted(
        "commands",
        {"thrusters": True},
        "The thrust of each thruster in run 0; shading marks thrusts at a limit.",
        needs="thrust",
    ),
    Wanted(
        "commands",
        {"wheels": True},
        "The momentum of each wheel in run 0; shading marks a wheel at its limit.",
        needs="wheel_momentum",
    ),
    Wanted("estimate", needs="estimated_pose"),
    Wanted("distributions", caption="How metrics are distributed over runs."),
)
"""Default figures of a report on an experiment."""

_BY_EFFORT = {"metric": "effort"}, "The same for the effort, the integral of the torque squared."

SWEPT = (
    Wanted("sweep", caption="The error by which laws are compared first."),
    Wanted("sweep", *_BY_EFFORT),
    Wanted("pareto"),
    Wanted("settled", {}, "The share of runs that settle, with 95 % intervals.", "settled"),
)
"""Default figures of a report on a sweep."""

CASES = (Wanted("forest"), Wanted("forest", *_BY_EFFORT), Wanted("pareto"))
"""Default figures of a report on two laws in cases."""

COMPARED = Wanted(
    "winners",
    caption="Which law has the better mean pose error at each point, and by how many per cent; "
    "white: undecided. All tests of the map are counted.",
)
"""Further default figure of a sweep with several laws over one or two keys."""


def inline_figures(
    result: Result, wanted: Sequence[Wanted]
) -> tuple[list[dict[str, str]], list[str]]:
    """Return the figures that can be drawn of a result, and remarks on those that cannot.

    A figure has a ``key``, its name in the page and the prefix of every identifier in it; ``svg``,
    an element in the colours of the file; and a ``caption``.
    """
    drawn: list[dict[str, str]] = []
    remarks: list[str] = []
    refusals: list[str] = []
    due = [
        figure
        for figure in wanted
        if figure.name in figures.names() and (not figure.needs or result.has(figure.needs))
    ]
    with step(DRAWN, len(due)):
        for figure in due:
            try:
                drawn.append(_draw(result, figure, len(drawn) + 1))
            except EqtError as error:
                reason = str(error).removeprefix(f"{result.path}: ")
                # Some default figures of a sweep need other axes than it has.
                optional = result.is_sweep and not isinstance(error, TooLargeFigureError)
                (refusals if optional and not figure.requested else remarks).append(reason)
            reporter().advance(1)
    return drawn, remarks if drawn or remarks else refusals[:1]


def named(names: Sequence[str]) -> list[Wanted]:
    """Return figures by name, with their default captions.

    Raises
    ------
    ComponentError
        If there is no such figure.
    """
    by_name = {
        figure.name: replace(figure, needs="")
        for figure in reversed((*DEFAULT, *SWEPT, *CASES, COMPARED))
    }
    for name in names:
        figures.get(name)
    return [replace(by_name.get(name, Wanted(name)), requested=True) for name in names]


def _draw(result: Result, wanted: Wanted, number: int) -> dict[str, str]:
    figure, notes = figure_from(wanted.name, wanted.options), list[str]()
    # The first one stands beside the finding, or below that of many laws.
    beside = number == 1 and len(result.labels) <= MANY
    drawing = figure.draw([result], "column" if beside else "page", captions=notes)
    for k, artist in enumerate(drawing.findobj()):
        if (label := artist.get_label()) in result.labels:
            artist.set_gid(f"law-{result.labels.index(label)}-{k}")
    usual = conclusion_of(result).figures.get(wanted.name) or summary_of(type(figure))
    caption = " ".join([str(drawing.get_label()) or wanted.caption or usual, *notes])
    svg = inlined(encode(drawing, "svg", letters="path"), f"figure{number}", caption)
    if len(svg) > LARGEST:
        raise TooLargeFigureError(
            f"figure '{wanted.name}' has too many curves for a page; "
            f"`eqt plot RESULT --figure {wanted.name}` draws it"
        )
    return {"key": f"figure{number}", "svg": Markup(svg), "caption": caption}


def inlined(svg: bytes, key: str, label: str) -> str:
    """Convert an SVG file to an element of a page.

    Identifiers become unique in the page, coordinates are rounded to a hundredth of a point, and a
    label describes the figure.
    """
    root = ElementTree.fromstring(svg)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.endswith("}metadata"):
                parent.remove(child)
    for element in root.iter():
        element.tag = element.tag.removeprefix(f"{{{_SVG}}}")
        for name, value in list(element.attrib.items()):
            del element.attrib[name]
            element.attrib[name.removeprefix(f"{{{_XLINK}}}")] = _adapted(name, value, key)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.attrib |= {"role": "img", "aria-label": label}
    return ElementTree.tostring(root, encoding="unicode")


def _adapted(name: str, value: str, key: str) -> str:
    local = name.rpartition("}")[2]
    if local == "id":
        return f"{key}-{value}"
    if local == "href" and value.startswith("#"):
        return f"#{key}-{value[1:]}"
    value = _REFERENCE.sub(rf"url(#{key}-\1)", value)
    if local in ("d", "x", "y", "width", "height", "points"):
        return _DECIMAL.sub(lambda match: f"{float(match[0]):.2f}", value)
    return value


# Report on a result as one HTML page that needs no network and no other file ----------------------


SWEPT_METRICS = ("effort", "peak_torque")
"""Numbers whose best and worst points a page lists besides those that are compared first."""


OPTIONAL = (
    "best won opening looks many premises answer claims levels pairs others missing picker live "
    "certificates doubts drawing"
).split()
"""Parts of a page that only sweeps or only single experiments have, or that are left out."""


def report(
    result: Result,
    wanted: Sequence[Wanted] | None = None,
    certificates: Mapping[str, Any] | None = None,
    unverified: str = "",
    author: str = "",
    notes: str = "",
    title: str = "",
    date: str = "",
    against: str = "",
    live: Mapping[str, str] | None = None,
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
        Tables of the certificates of the result: all `certificates`, and the `doubts`.
    unverified
        Reason why there are no certificates, if there are none.
    author, notes
        Author of the page, and remarks for its reader; blank lines separate paragraphs.
    title, date
        Title and date of the page; by default the comment at the top of the configuration, or the
        laws, and the day of the run.
    against
        Label of the controller with which the others are compared; the first if empty.
    live
        Its part with sliders: the `html`, and the `css` for it.
    """
    shown = _default(result) if wanted is None else wanted
    drawn, remarks = inline_figures(result, shown)
    concluded = conclusion_of(result)
    searched = concluded.tables()
    if refused := _refusal(result):
        notes = f"{notes}\n\n{refused}"
        reporter().remark(EqtWarning(f"the page does not compare the laws: {refused}"))
    if result.is_sweep:
        of_kind: dict[str, Any] = {"table": summary.point_table(result)}
        if not concluded.id and not refused:  # no means: one over all points means little
            of_kind["best"] = sweep_tables(result, SWEPT_METRICS)
            won = list(map(points_won, winners(result)[:1]))
            of_kind["won"] = won or [extremes(result)]
    else:
        of_kind = {"picker": summary.curves(result), "table": summary.run_table(result)}
        if not (concluded.figures or concluded.premise or refused):
            of_kind |= _compared(result, against)
        of_kind["many"] = len(result.labels) > MANY
    if finding := concluded.finding(searched):
        of_kind["won"] = [finding]
    return page(
        "report.html.j2",
        ["report.css"],
        "report.js",
        result=result,
        failed=len(result.failures),
        facts=summary.facts(result, author, date),
        title=title or summary.called(result),
        notes=[" ".join(text.split()) for text in re.split(r"\n\s*\n", notes) if text.strip()],
        remarked=result.described.remarks,
        stated=summary.stated_values(result),
        laws=summary.laws(result),
        functions=result.lyapunov_functions,
        accuracy=list(summary.accuracy(result)),
        provenance=summary.provenance(result),
        config=str(result.attributes.get("config", "")).rstrip(),
        figures=drawn,
        remarks=remarks,
        unverified=unverified.replace(f"{result.path.parent}/", ""),
        font=b64encode((TEMPLATES / "equations.woff2").read_bytes()).decode("ascii"),
        answers=answers_of(result)[1],
        search=concluded.id and vars(concluded) | {"tables": searched},
        **dict.fromkeys(OPTIONAL) | of_kind | dict(certificates or {}) | {"live": live},
    )


def _refusal(result: Result) -> str:
    """Return why the laws of a result must not be compared; "" if they may be."""
    try:
        conclusion_of(result).compared(result)
    except EqtError as error:
        return str(error.args[0]).removeprefix(f"{result.path}: ")
    return ""


def _default(result: Result) -> Sequence[Wanted]:
    """Return the default figures for the kind of the result."""
    if concluded := conclusion_of(result).figures:
        return [*map(Wanted, concluded)]
    if side_by_side(result):
        return CASES
    if result.is_sweep:
        mapped = len(result.labels) > 1 and len(result.swept_keys) in (1, 2)
        return (*SWEPT, COMPARED) if mapped else SWEPT
    return DEFAULT


def _compared(result: Result, against: str) -> dict[str, Any]:
    whole = compare(result)
    judged = [x for x in whole.judgements if x.is_at_home and not whole.departures]
    comparison, base = replace(whole, judgements=judged), against or whole.labels[0]
    tables = text_tables(comparison, Plain(), [base, *comparison.labels])
    levels, pairs = tables.get("controllers"), tables.get("pairs")
    answer, open_ = matrix(comparison, base), remarks(comparison, base)
    caption = f"Means of {comparison.titles[base]}; differences of the other laws from it"
    looks = {look["label"]: look | {"number": k} for k, look in enumerate(summary.looks(result))}
    if levels and not answer.blocks:  # of a single law
        caption, answer, levels = levels.caption, levels, None
    with_base = len(comparison.labels) - 1
    return {
        "opening": opening(comparison, base),
        "looks": looks,
        "premises": premises(comparison),
        "answer": replace(answer, caption=caption, notes=[*open_, *answer.notes]),
        "claims": tables.get("claims"),
        "levels": levels,
        # The pairs with the base come first.
        "pairs": pairs and replace(pairs, blocks=pairs.blocks[:with_base]),
        "others": pairs and replace(pairs, blocks=pairs.blocks[with_base:], notes=[]),
        "missing": comparison.missing,
    }
