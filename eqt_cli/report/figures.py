"""Figures as SVG inside an HTML page; this module knows figures by name and options only."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree import ElementTree

from markupsafe import Markup

from eqt_cli.analysis.certificates.base import Row
from eqt_cli.core.errors import EqtError
from eqt_cli.core.registry import description
from eqt_cli.core.reporting import reporter, step
from eqt_cli.plots.base import Extras, OfCertificates
from eqt_cli.plots.figures import figures
from eqt_cli.plots.render import DRAWN, encode, figure_from
from eqt_cli.results.result import Result

LARGEST = 700_000
"""Maximum number of SVG characters per figure; larger figures are omitted, with a remark."""

_SVG, _XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
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
    asked
        Whether a user asked for it, and is told why it cannot be drawn.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    caption: str = ""
    needs: str = ""
    asked: bool = False


class TooLargeFigureError(EqtError):
    """A figure that is too large for a page."""


DEFAULT = (
    Wanted(
        "paper",
        {"log": True},
        "Means over runs of pose error, velocity error, torque and Lyapunov function L, as in "
        "Figure 3 of the paper; errors and L on logarithmic axes.",
    ),
    Wanted("torque"),
    Wanted("commands", needs="command"),
    Wanted(
        "commands",
        {"thrusters": True},
        "The thrust of each thruster in run 0; what is beyond its limits is shaded.",
        needs="thrust",
    ),
    Wanted(
        "commands",
        {"wheels": True},
        "The momentum of each wheel in run 0; what is at its limit is shaded.",
        needs="wheel_momentum",
    ),
    Wanted("estimate", needs="estimated_pose"),
    Wanted("distributions"),
    Wanted("phase", {"runs": 10}),
    Wanted("certificates"),
)
"""Default figures of a report on an experiment."""

_BY_EFFORT = {"metric": "effort"}, "The same for the effort, the integral of the torque squared."

SWEPT = (
    Wanted("sweep"),
    Wanted("sweep", *_BY_EFFORT),
    Wanted("pareto"),
    Wanted("envelope", needs="settled"),
)
"""Default figures of a report on a sweep."""

CASES = (Wanted("forest"), Wanted("forest", *_BY_EFFORT), Wanted("pareto"))
"""Default figures of a report on two laws in cases."""

COMPARED = Wanted(
    "winners",
    {},
    "Which law has the better mean pose error at each point, and by how many per cent; white: "
    "undecided. All tests of the map are counted.",
)
"""Further default figure of a sweep with several laws over one or two keys."""

FRONTS = (
    Wanted(
        "fronts",
        {},
        "Winners of the search by both objectives, means over held-out runs with 95 % intervals. "
        "The line joins the Pareto front of these runs. Half-filled: the starting gains.",
    ),
)
"""Default figure of a report on a search with two objectives."""


def inline_figures(
    result: Result, wanted: Sequence[Wanted], certificates: Sequence[Row] = ()
) -> tuple[list[dict[str, str]], list[str]]:
    """Return the figures that can be drawn of a result, and remarks on those that cannot.

    A figure has a ``key``, its name in the page and the prefix of every identifier in it; ``svg``,
    an element in the colours of the file; and a ``caption``.
    """
    drawn: list[dict[str, str]] = []
    remarks: list[str] = []
    refusals: list[str] = []
    due = [figure for figure in wanted if _is_due(result, figure, certificates)]
    with step(DRAWN, len(due)):
        for figure in due:
            try:
                drawn.append(_draw(result, figure, f"figure{len(drawn) + 1}", certificates))
            except EqtError as error:
                reason = str(error).removeprefix(f"{result.path}: ")
                # Some default figures of a sweep need other axes than it has.
                optional = result.is_sweep and not isinstance(error, TooLargeFigureError)
                (refusals if optional and not figure.asked else remarks).append(reason)
            reporter().advance(1)
    return drawn, remarks if drawn or remarks else refusals[:1]


def _is_due(result: Result, wanted: Wanted, certificates: Sequence[Row]) -> bool:
    """Return whether a figure exists and has data; that certificates are missing, the page says."""
    if wanted.name not in figures.names() or (wanted.needs and not result.has(wanted.needs)):
        return False
    return bool(certificates) or not issubclass(figures.get(wanted.name), OfCertificates)


def named(names: Sequence[str]) -> list[Wanted]:
    """Return figures by name, with their default captions.

    Raises
    ------
    ComponentError
        If there is no such figure.
    """
    known = {
        figure.name: replace(figure, needs="")
        for figure in reversed((*DEFAULT, *SWEPT, *CASES, COMPARED, *FRONTS))
    }
    for name in names:
        figures.get(name)
    return [replace(known.get(name, Wanted(name)), asked=True) for name in names]


def _draw(result: Result, wanted: Wanted, key: str, certificates: Sequence[Row]) -> dict[str, str]:
    figure = figure_from(wanted.name, wanted.options)
    text = encode(figure.draw([result], "page", extras=Extras(certificates)), "svg")
    caption = wanted.caption or description(type(figure))
    svg = inlined(text, key, caption)
    if len(svg) > LARGEST:
        raise TooLargeFigureError(
            f"figure '{wanted.name}' has too many curves for a page; "
            f"`eqt plot {result.path.parent} --figure {wanted.name}` draws it"
        )
    return {"key": key, "svg": Markup(svg), "caption": caption}


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
        return _NUMBER.sub(lambda match: f"{float(match[0]):.2f}", value)
    return value
