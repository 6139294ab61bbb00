"""Flaws of a drawn figure that can be measured: in its texts, its titles and its fonts."""

from contextlib import contextmanager
from itertools import combinations
from unittest.mock import patch

from matplotlib.cbook import is_math_text
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eqt_cli.figures.render import encode
from eqt_cli.figures.style import ENLARGED, house_style

LEAST = 5.5
"""Least size of a letter in the file, pt."""
TALLEST = 9.6
"""Height of a column with its caption on a page of a journal, in."""
SLACK = 3.0
"""Half a line of a frame beyond the page, in pixels of 1/300 in."""
ROOM = 9.0
"""Room of ascenders and descenders in the box of a text, a quarter of 8 pt, in such pixels."""


@contextmanager
def recorded():
    """Yield a dict of every text that is drawn meanwhile, with its box."""
    found, draw = {}, Text.draw

    def record(text, renderer):
        if text.get_visible() and text.get_text().strip():
            # Without the line from a name to its curve.
            found[text] = Text.get_window_extent(text, renderer)
        draw(text, renderer)

    with patch.object(Text, "draw", record):
        yield found


def smallest(text):
    """Size of the smallest letter of a text in the layout, pt."""
    sizes = [float(text.get_fontsize())]
    for line in text.get_text().split("\n"):
        if is_math_text(line):
            font = text.get_fontproperties()
            sizes += [glyph[1] for glyph in MathTextParser("path").parse(line, 72, font).glyphs]
    return min(sizes)


def beyond(box, page):
    """How far a box leaves the page, in pixels."""
    return max(page.x0 - box.x0, page.y0 - box.y0, box.x1 - page.x1, box.y1 - page.y1)


def overlaps(boxes):
    """A sentence for each text that covers another."""
    for (text, box), (other, its) in combinations(boxes.items(), 2):
        both = Bbox.intersection(box, its)
        if both is not None and min(both.width, both.height) >= ROOM:
            yield f"overlap: {text.get_text()!r} and {other.get_text()!r}"


def flaws(drawing, width):
    """All flaws of a figure, a sentence each."""
    with house_style(), recorded() as boxes:
        drawing.draw_without_rendering()
    found, page = list(overlaps(boxes)), drawing.bbox
    inked = drawing.get_tightbbox().transformed(drawing.dpi_scale_trans)
    if (far := beyond(inked, page)) > SLACK:
        found.append(f"something leaves the page by {far:.0f} px")
    for text, box in boxes.items():
        name = text.get_text()
        if (far := beyond(box, page)) > SLACK:
            found.append(f"leaves the page by {far:.0f} px: {name!r}")
        if (size := smallest(text) * ENLARGED[width]) < LEAST - 0.01:
            found.append(f"a letter of {size:.2f} pt: {name!r}")
    titles = [axes.get_title() for axes in drawing.axes if axes.get_title()]
    found += [f"title twice: {title!r}" for title in {t for t in titles if titles.count(t) > 1}]
    scales = [axis for axes in drawing.axes for axis in (axes.xaxis, axes.yaxis)]
    for label in {scale.label.get_text() for scale in scales if scale.label in boxes}:
        if any(line.count("(") != line.count(")") for line in label.split("\n")):
            found.append(f"broken in a unit: {label!r}")
    if width != "slide" and drawing.get_figheight() > TALLEST:
        found.append(f"{drawing.get_figheight():.1f} in tall")
    if b"/Type3" in encode(drawing, "pdf"):
        found.append("a Type 3 font")
    return found
