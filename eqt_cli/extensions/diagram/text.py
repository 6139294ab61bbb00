"""Draws a diagram as text, for terminals: the stages in rows, one below the other."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence

from eqt_cli.extensions.diagram.boxes import LAW
from eqt_cli.extensions.diagram.diagram import Diagram, Drawn
from eqt_cli.extensions.diagram.wording import SPACE

COLUMNS, MARGIN = 80, 3
"""Columns of a terminal, and those of the way back on the left."""

SIDES = {False: ("┌", "─", "┐", "│", "└", "┘"), True: ("┌", "╌", "┐", "╎", "└", "┘")}
"""Corners and sides of a box, and those of an ideal one."""


def text(diagram: Diagram) -> str:
    """Return the diagram in lines of at most 80 characters; ideal boxes have broken sides."""
    lines, feeds, last = [f"the loop of {diagram.title}", ""], 0, 0
    stages = [stage for stage in diagram.stages if diagram.stages[stage][0].boxes]
    for stage in stages:
        for k, lane in enumerate(diagram.stages[stage]):
            name = stage if k == 0 else ""
            if lane.laws and list(lane.laws) != [lane.boxes[0].title]:
                name = f"{stage}: {', '.join(lane.laws)}"
            rows = [row for part in _lane(lane.boxes, name) for row in part]
            if stage == LAW and not feeds:
                feeds = len(lines) + 1
            last = len(lines) + 1
            lines += [" " * MARGIN + row for row in rows]
        if stage != stages[-1]:
            label = plain(", ".join(diagram.arrows[stage]))
            lines.append(" " * MARGIN + f"     ▼ {label}")
    words = plain(", ".join(diagram.arrows[stages[-1]]))
    lines[feeds] = f"┌─▶{lines[feeds][MARGIN:]}"
    lines[last] = f"└──{lines[last][MARGIN:]}"
    for k in range(feeds + 1, last):
        lines[k] = f"│{lines[k][1:]}"
    notes = [row for note in diagram.notes for row in textwrap.wrap(note, COLUMNS)]
    lines += ["", f"back to the law: {words}", *notes]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def plain(words: str) -> str:
    """Return words without marks of an index: ``Qd`` for ``Q_d``."""
    return re.sub(r"\b(\w)_(\w)\b", r"\1\2", words).replace(SPACE, " ")


def _lane(boxes: Sequence[Drawn], name: str) -> Iterator[list[str]]:
    """Yield the rows of boxes, with the arrows between those that signals pass in order."""
    before: Drawn | None = None
    for box in boxes:
        if before is not None and not box.beside:
            yield [f"     ▼ {plain(' '.join(before.gives[:1]))}"]
        elif before is not None and not before.beside:
            yield ["     ▲"]  # what acts on the box above
        yield _box(box, name)
        before, name = box, ""


def _box(box: Drawn, name: str) -> list[str]:
    inner = COLUMNS - MARGIN - 4
    start, level, end, side, low, lower = SIDES[box.is_ideal]
    title = f"{name}: {box.title}" if name else box.title
    if box.laws:
        title += f" (only {', '.join(box.laws)})"
    head = f"{start}{level} {textwrap.shorten(plain(title), inner - 2)} "
    rows = [head + level * (inner + 3 - len(head)) + end]
    for line in box.lines:
        words = line.text.split(" ")
        mark = "▸ " if line.laws else ""
        joined = mark + " ".join(words)
        for row in textwrap.wrap(joined.replace(SPACE, "\x00"), inner, subsequent_indent="  "):
            rows.append(f"{side} {plain(row.replace(chr(0), ' ')):<{inner}} {side}")
    return [*rows, low + level * (inner + 2) + lower]
