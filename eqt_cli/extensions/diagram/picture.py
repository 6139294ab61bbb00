"""Draws a diagram as SVG with live text: in columns, or in rows for narrow screens.

All is in the colour of the text around it, so that it fits a light and a dark page.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from pathlib import Path
from unicodedata import east_asian_width

from eqt_cli.base.version import __version__
from eqt_cli.extensions.diagram.boxes import ACTUATION, ESTIMATION, LAW, PLANT, REFERENCE, SENSING
from eqt_cli.extensions.diagram.diagram import Diagram, Drawn, Lane
from eqt_cli.extensions.diagram.wording import SPACE

WIDTH, NARROW = 680, 278
"""Widths of the two pictures, px: 180 mm, and that which `LARGER` fits a phone of 375 px."""

LARGER = 1.2
"""Magnification of the narrow picture, whose smallest letters are then 12 px high."""

TITLE, TEXT, SMALL = 11.5, 10.5, 10.0
"""Sizes of letters, px."""

ROW, PAD, GAP = 14.0, 6.0, 14.0
"""Height of a row of text, the margin inside boxes and panels, and what is between boxes."""

COLUMNS = {REFERENCE: 102.0, LAW: 152.0, ACTUATION: 146.0, PLANT: 146.0}
"""Widths of the panels of the forward path."""

BETWEEN = (WIDTH - sum(COLUMNS.values())) / 3
"""What is between two panels, for an arrow with its words."""

HEAD = 18.0
"""Height of the name of a panel."""

MARGIN = 8
"""Margin of the wide picture where it stands in no page, px."""

MARKS = ",", ";", ".", ")"
"""What no line begins with."""

STYLE = Path(__file__).with_name("alone.css")
"""Colours of a picture that stands in no page."""


_INDEXED = re.compile(r"(\w)_(\w)(,?)")


@dataclass
class Panel:
    """A stage, placed at the origin.

    Attributes
    ----------
    parts
        Its SVG.
    entries, exits
        Heights at which signals enter its first boxes and leave the last ones.
    """

    width: float
    height: float = 0.0
    parts: list[str] = field(default_factory=list)
    entries: list[float] = field(default_factory=list)
    exits: list[float] = field(default_factory=list)


# Text ---------------------------------------------------------------------------------------------


def text_width(text: str, size: float) -> float:
    """Return about how wide a text is in a sans serif font, px; rather too much."""
    narrow, wide = (
        sum(x in "iljtf.,:;|'()[] /\u00a0·" for x in text),
        sum(x in "mwMW@—" or east_asian_width(x) in "WF" for x in text),
    )
    return size * (0.36 * narrow + wide + 0.62 * (len(text) - narrow - wide))


def wrapped(text: str, width: float, size: float) -> list[str]:
    """Return the lines of a text within a width; a longer word is divided."""
    lines, line = list[str](), ""
    for word in text.split(" "):
        whole = f"{line} {word}".strip()
        if text_width(whole, size) <= width:
            line = whole
            continue
        lines += [line] if line else []
        if text_width(word, size) > width and SPACE in word:
            *lines_of_word, word = wrapped(word.replace(SPACE, " "), width, size)
            lines += lines_of_word
        while text_width(word, size) > width:
            cut = next(k for k in range(len(word), 0, -1) if text_width(word[:k], size) <= width)
            cut -= cut > 1 and word[cut:] in MARKS  # a comma has a letter before it
            lines.append(word[:cut])
            word = word[cut:]
        line = word
    return [*lines, line]


def _text(x: float, y: float, text: str, size: float = TEXT, **more: object) -> str:
    attributes = "".join(f' {k.replace("_", "-")}="{v}"' for k, v in more.items())
    return f'<text x="{x:g}" y="{y:g}" font-size="{size:g}"{attributes}>{_symbols(text)}</text>'


def _symbols(text: str) -> str:
    """Return a text in SVG, in which ``Q_d`` has an index."""
    pieces = []
    for k, word in enumerate(text.split(" ")):
        base, mark, index = word.partition("_")
        rest = index[1:]
        if mark and len(base) == 1 and index[:1].isalpha() and (not rest or rest == ","):
            low = f'<tspan font-size="75%" dy="2.5">{index[0]}</tspan>'
            pieces.append(
                f'{" " if k else ""}{escape(base)}{low}<tspan dy="-2.5">{rest}&#8203;</tspan>'
            )
        else:
            pieces.append(f"{' ' if k else ''}{escape(word)}")
    return "".join(pieces)


# Boxes and panels ---------------------------------------------------------------------------------


def _box(box: Drawn, x: float, y: float, width: float) -> tuple[list[str], float]:
    """Return the SVG of a box with its upper left corner, and its height."""
    inner, parts = width - 2 * PAD, list[str]()
    at = y + PAD + TITLE
    style = {"font_style": "italic"} if box.is_ideal else {"font_weight": "600"}
    for line in wrapped(box.title, inner, TITLE * 1.1):
        parts.append(_text(x + PAD, at - 1, line, TITLE, **style))
        at += ROW
    if box.laws:
        for line in wrapped(f"only {', '.join(box.laws)}", inner, TEXT):
            parts.append(_text(x + PAD, at - 2, line, font_style="italic"))
            at += ROW
    for words in box.lines:
        indent = 9.0 if words.laws else 0.0
        for k, line in enumerate(wrapped(words.text, inner - indent, TEXT)):
            if indent and not k:
                parts.append(_text(x + PAD, at - 2, "▸", SMALL))
            parts.append(_text(x + PAD + indent, at - 2, line))
            at += ROW
    height = at - ROW - y + PAD + 2
    dash = ' stroke-dasharray="4 3"' if box.is_ideal else ""
    frame = (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="4" '
        f'fill="currentColor" fill-opacity="{0 if box.is_ideal else 0.05}" '
        f'stroke="currentColor" stroke-width="1"{dash}/>'
    )
    return [frame, *parts], height


def panel_of(name: str, lanes: Sequence[Lane], width: float, columns: int = 1) -> Panel:
    """Return the panel of a stage, whose boxes beside each other stand in columns."""
    panel, y = Panel(width), HEAD
    panel.parts.append(_text(PAD, HEAD - 5, name, SMALL, letter_spacing="0.04em", opacity="0.75"))
    for lane in lanes:
        if lane.laws and list(lane.laws) != [lane.boxes[0].title]:
            for line in wrapped(", ".join(lane.laws), width - 2 * PAD, TEXT):
                panel.parts.append(_text(PAD, y + 10, line, font_style="italic"))
                y += ROW
            y += 2
        y = _series(panel, [box for box in lane.boxes if not box.beside], y, width)
        y = _beside(panel, [box for box in lane.boxes if box.beside], y, width, columns)
    panel.height = y - GAP + PAD
    frame = (
        f'<rect width="{width:g}" height="{panel.height:g}" rx="6" fill="currentColor" '
        'fill-opacity="0.035"/>'
    )
    panel.parts.insert(0, frame)
    return panel


def _series(panel: Panel, boxes: Sequence[Drawn], y: float, width: float) -> float:
    """Add boxes that signals pass one after the other, downwards; return where the next is."""
    for k, box in enumerate(boxes):
        parts, height = _box(box, PAD, y, width - 2 * PAD)
        panel.parts += parts
        if k == 0:
            panel.entries.append(y + PAD + 6)
        if k == len(boxes) - 1:
            panel.exits.append(y + PAD + 6)
        else:
            label = " ".join(box.gives[:1])
            bottom, x = y + height, PAD + 16
            panel.parts.append(_arrow([(x, bottom), (x, bottom + GAP + 4)]))
            panel.parts.append(_text(x + 7, bottom + GAP - 2, label, SMALL))
            y += 4
        y += height + GAP
    return y


def _beside(panel: Panel, boxes: Sequence[Drawn], y: float, width: float, columns: int) -> float:
    """Add boxes of which each acts by itself, in rows; return where the next is."""
    if not boxes:
        return y
    is_alone = not panel.entries
    if not is_alone:  # forces, which act on the box above
        x = PAD + 16
        panel.parts.append(_arrow([(x, y + 2), (x, y - GAP)]))
        y += 2
    else:
        panel.entries.append(y + PAD + 6)
        panel.exits.append(y + PAD + 6)
    share = (width - PAD * (columns + 1)) / columns
    for start in range(0, len(boxes), columns):
        heights = []
        for k, box in enumerate(boxes[start : start + columns]):
            parts, height = _box(box, PAD + k * (share + PAD), y, share)
            panel.parts += parts
            heights.append(height)
        y += max(heights) + PAD
    return y - PAD + GAP


def _arrow(points: Sequence[tuple[float, float]]) -> str:
    """Return a line with a head, which is no marker: those of hidden pictures are not drawn."""
    (x0, y0), (x, y) = points[-2:]
    along, up = (x > x0) - (x < x0), (y > y0) - (y < y0)
    back_x, back_y = x - 7.5 * along, y - 7.5 * up
    line = " ".join(f"{at:g},{to:g}" for at, to in [*points[:-1], (back_x, back_y)])
    return (
        f'<polyline points="{line}" fill="none" stroke="currentColor" stroke-width="1.2"/>'
        f'<path d="M{x:g},{y:g} L{back_x - 3.5 * up:g},{back_y - 3.5 * along:g} '
        f'L{back_x + 3.5 * up:g},{back_y + 3.5 * along:g} z"/>'
    )


def _placed(panel: Panel, x: float, y: float) -> str:
    return f'<g transform="translate({x:g} {y:g})">{"".join(panel.parts)}</g>'


# The two pictures ---------------------------------------------------------------------------------


def svg(diagram: Diagram, *, narrow: bool = False, alone: bool = True) -> str:
    """Return the diagram as SVG.

    Parameters
    ----------
    narrow
        Whether it is for a phone.
    alone
        Whether it is a file; a page has its own colours.
    """
    width, scale = (NARROW, LARGER) if narrow else (WIDTH, 1.0)
    parts, height = (_rows if narrow else _columns)(diagram)
    style, head, margin = "", "", MARGIN if alone and not narrow else 0
    left, wide, tall = -margin, width + 2 * margin, height + 2 * margin
    if alone:
        style = (
            f"<style>{STYLE.read_text('utf-8')}</style><metadata "
            f'xmlns:dc="http://purl.org/dc/elements/1.1/"><dc:title>eqt {__version__}</dc:title>'
            "</metadata>"
        )
        head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return (
        f'{head}<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left} {left} {wide} {tall:g}" '
        f'width="{scale * width:g}" height="{scale * width * tall / wide:g}" '
        'font-family="system-ui, sans-serif" '
        f'fill="currentColor" role="img"><title>{escape(f"The loop of {diagram.title}")}</title>'
        f"{style}{''.join(parts)}</svg>\n"
    )


def html(diagram: Diagram) -> str:
    """Return both pictures for a page, of which the width of the screen chooses one."""
    style = (
        "<style>.eqt-loop{overflow-x:auto}.eqt-loop svg{max-width:100%;height:auto}"
        ".eqt-loop svg+svg{display:none;max-width:none}"
        "@media(max-width:640px){.eqt-loop svg{display:none}.eqt-loop svg+svg{display:block}}"
        "</style>"
    )
    both = svg(diagram, alone=False) + svg(diagram, narrow=True, alone=False)
    name = escape(f"Loop of {diagram.title}")
    box = f'<div class="eqt-loop" role="region" aria-label="{name}" tabindex="0">'
    return f"{style}{box}{both}</div>\n"


def page(diagram: Diagram) -> str:
    """Return a page with both pictures."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="generator" content="eqt {__version__}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(diagram.title)}</title><style>body{{margin:16px}}"
        f"{STYLE.read_text('utf-8')}</style></head>\n<body>{html(diagram)}</body></html>\n"
    )


def _notes(diagram: Diagram, x: float, y: float, width: float) -> tuple[list[str], float]:
    parts = []
    for note in diagram.notes:
        for line in wrapped(note, width, TEXT):
            parts.append(_text(x, y + 12, line))
            y += ROW
    return parts, y


def _columns(diagram: Diagram) -> tuple[list[str], float]:
    """Return the forward path from left to right, and under it the way back."""
    forward, x = dict[str, tuple[Panel, float]](), 0.0
    for stage, width in COLUMNS.items():
        forward[stage] = panel_of(stage, diagram.stages[stage], width), x
        x += width + BETWEEN
    parts = [_placed(panel, x, 0.0) for panel, x in forward.values()]
    for (stage, (panel, x)), (_, (to, to_x)) in pairwise(forward.items()):
        parts += _between(panel, x, to, to_x, diagram.arrows[stage])
    top = max(panel.height for panel, _ in forward.values()) + 34
    law, law_x = forward[LAW]
    plant, plant_x = forward[PLANT]
    back = [stage for stage in (SENSING, ESTIMATION) if diagram.stages[stage][0].boxes]
    left = law_x + law.width + BETWEEN if len(back) == 2 else law_x + 70
    sensors = panel_of(SENSING, diagram.stages[SENSING], WIDTH - left, _columns_of(diagram, 2))
    parts.append(_placed(sensors, left, top))
    x, start = plant_x + plant.width / 2, plant.height
    parts.append(_arrow([(x, start), (x, top)]))
    parts.append(_text(x + 6, (start + top) / 2 + 4, ", ".join(diagram.arrows[PLANT]), SMALL))
    bottom, y, x = top + sensors.height, top + HEAD + PAD + 6, law_x + 34
    if len(back) == 2:
        estimator = panel_of(ESTIMATION, diagram.stages[ESTIMATION], law.width)
        parts.append(_placed(estimator, law_x, top))
        parts.append(_arrow([(left + PAD, y), (law_x + law.width - PAD, y)]))
        parts += _over(left - BETWEEN / 2, y, diagram.arrows[SENSING])
        parts.append(_arrow([(x, top), (x, law.height)]))
        bottom = max(bottom, top + estimator.height)
        label = diagram.arrows[ESTIMATION]
    else:
        parts.append(_arrow([(left + PAD, y), (x, y), (x, law.height)]))
        label = diagram.arrows[SENSING]
    for k, words in enumerate(label):
        parts.append(_text(x + 6, top - 20 + 12 * k, words, SMALL))
    notes, bottom = _notes(diagram, PAD, bottom + 4, WIDTH - PAD)
    return [*parts, *notes], bottom + 4


def _columns_of(diagram: Diagram, most: int) -> int:
    boxes = [box for box in diagram.stages[SENSING][0].boxes if box.beside]
    return max(1, min(most, len(boxes)))


def _between(panel: Panel, x: float, to: Panel, to_x: float, words: Sequence[str]) -> Iterator[str]:
    """Yield the arrows from one panel to the next, with what they carry."""
    start, end = x + panel.width - PAD, to_x + PAD
    middle, is_straight = x + panel.width + 2.5, panel.exits == to.entries
    for leaves in panel.exits:
        for enters in to.entries:
            points = [(start, leaves), (end, enters)]
            if leaves != enters:
                points[1:1] = [(middle, leaves), (middle, enters)]
            yield _arrow(points)
    at = (x + panel.width + to_x) / 2 + (0 if is_straight else 3)
    yield from _over(at, to.entries[0], words)


def _over(x: float, y: float, words: Sequence[str]) -> Iterator[str]:
    """Yield words over an arrow, and those from the second on under it."""
    lines = [*words[:1], *(x for text in words[1:] for x in wrapped(text, BETWEEN - 6, SMALL))]
    for k, text in enumerate(lines):
        yield _text(x, y - 5 if k == 0 else y + 1 + 11 * k, text, SMALL, text_anchor="middle")


def _rows(diagram: Diagram) -> tuple[list[str], float]:
    """Return all stages one below the other, with the way back along the left side."""
    left, y, parts = 22.0, 0.0, list[str]()
    tops: dict[str, float] = {}
    stages = [stage for stage in diagram.stages if diagram.stages[stage][0].boxes]
    for stage in stages:
        panel = panel_of(stage, diagram.stages[stage], NARROW - left)
        tops[stage] = y
        parts.append(_placed(panel, left, y))
        y += panel.height
        words = diagram.arrows[stage]
        if stage != stages[-1]:
            parts.append(_arrow([(left + 40, y), (left + 40, y + 24)]))
            parts.append(_text(left + 50, y + 16, ", ".join(words), SMALL))
            y += 24
    law = tops[LAW] + 12
    parts.append(_arrow([(left, y - 12), (8, y - 12), (8, law), (left, law)]))
    last = ", ".join(diagram.arrows[stages[-1]])
    parts.append(_text(left, y + 14, f"back to the law: {last}", SMALL))
    notes, y = _notes(diagram, left, y + 18, NARROW - left)
    return [*parts, *notes], y + 6
