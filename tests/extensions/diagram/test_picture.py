"""Where the parts of a picture are: inside each other, beside each other, and joined by arrows."""

import re
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from xml.etree import ElementTree

import pytest
from small_experiment import mapping

import eqt_cli
from eqt_cli.extensions.diagram.picture import HEAD, text_width

pytestmark = pytest.mark.needs("diagram")

ROUNDING = 0.01
"""px; numbers have six digits."""

PX_OF_MM = 96 / 25.4

PHONE = 375
"""px, the width of the screen of a small phone."""

LOOPS = {
    "plain": mapping(),
    "full": mapping(
        actuators=[{"kind": "limit", "limit": 1}, {"kind": "lag", "time_constant": 0.1}],
        plant={
            "forces": [
                {"kind": "constant", "force": [0.1, 0, 0]},
                {"kind": "gust", "std": 0.1, "time_constant": 2},
            ]
        },
        control={"period": 0.1},
        sensors={
            "pose": [{"kind": "noise", "std": 0.01}],
            "velocity": [{"kind": "noise", "std": 0.1}],
        },
        estimator="invariant",
    ),
    "laws": mapping(controllers=["eqt", {"kind": "family", "label": "weighted", "transport": 1}])
    | {"sweep": [{"grid": {"gains.kp": [1, 2]}}]},
}


@dataclass(frozen=True)
class Area:
    left: float
    top: float
    right: float
    bottom: float

    def holds(self, other):
        return (
            self.left - ROUNDING <= other.left
            and self.top - ROUNDING <= other.top
            and other.right <= self.right + ROUNDING
            and other.bottom <= self.bottom + ROUNDING
        )

    def meets(self, other):
        apart = (
            self.right <= other.left + ROUNDING
            or other.right <= self.left + ROUNDING
            or self.bottom <= other.top + ROUNDING
            or other.bottom <= self.top + ROUNDING
        )
        return not apart

    def has_on_its_edge(self, x, y):
        across = self.left - ROUNDING <= x <= self.right + ROUNDING
        along = self.top - ROUNDING <= y <= self.bottom + ROUNDING
        on_side = min(abs(x - self.left), abs(x - self.right)) < ROUNDING
        on_top = min(abs(y - self.top), abs(y - self.bottom)) < ROUNDING
        return (across and on_top) or (along and on_side)


class Picture:
    """Panels, boxes in them, words, and arrows by their two ends."""

    def __init__(self, svg):
        root = ElementTree.fromstring(svg)
        self.width, self.height = float(root.get("width")), float(root.get("height"))
        _, _, right, bottom = map(float, root.get("viewBox").split())
        self.sheet = Area(0, 0, right, bottom)
        self.panels, self.boxes, self.words, self.arrows = [], [], [], []
        self._read(root, 0.0, 0.0, None)

    def _read(self, node, x, y, panel):
        start = None
        for part in node:
            kind = part.tag.rpartition("}")[2]
            if kind == "g":
                moved = re.fullmatch(r"translate\((\S+) (\S+)\)", part.get("transform"))
                self._read(part, x + float(moved[1]), y + float(moved[2]), len(self.panels))
            elif kind == "rect":
                left, top = x + float(part.get("x", 0)), y + float(part.get("y", 0))
                right, bottom = left + float(part.get("width")), top + float(part.get("height"))
                area = Area(left, top, right, bottom)
                if part.get("x") is None:
                    self.panels.append(area)
                else:
                    self.boxes.append((panel, area))
            elif kind == "text":
                said, size = "".join(part.itertext()), float(part.get("font-size"))
                said = said.replace("\u200b", "")
                width, at = text_width(said, size), x + float(part.get("x"))
                left = at - width / 2 if part.get("text-anchor") == "middle" else at
                low = y + float(part.get("y"))
                self.words.append((panel, said, Area(left, low - 0.72 * size, left + width, low)))
            elif kind == "polyline":
                at, to = part.get("points").split()[0].split(",")
                start = x + float(at), y + float(to)
            elif kind == "path" and start:
                at, to = re.match(r"M(\S+?),(\S+) ", part.get("d")).groups()
                self.arrows.append((start, (x + float(at), y + float(to))))


@cache
def diagram(name):
    return eqt_cli.diagram(LOOPS[name])


def picture(name, narrow):
    """Drawn for each test, so that a fault in the drawing is told by the test that it breaks."""
    return Picture(diagram(name).svg(narrow=narrow))


@pytest.fixture(params=LOOPS)
def loop(request):
    return request.param


@pytest.fixture(params=[False, True], ids=["wide", "narrow"])
def drawn(request, loop):
    return picture(loop, request.param)


def test_the_picture_is_180_mm_wide_and_the_narrow_one_fits_a_phone():
    assert picture("plain", False).width == pytest.approx(180 * PX_OF_MM, abs=0.5)
    assert 0.85 * PHONE < picture("plain", True).width < PHONE


def test_boxes_are_in_their_panel_and_panels_on_the_sheet(drawn):
    assert len(drawn.panels) >= 4
    assert all(drawn.sheet.holds(panel) for panel in drawn.panels)
    for panel, box in drawn.boxes:
        assert drawn.panels[panel].holds(box)


def test_nothing_lies_over_another_one(drawn):
    for one, other in combinations(drawn.panels, 2):
        assert not one.meets(other)
    for (_, one), (_, other) in combinations(drawn.boxes, 2):
        assert not one.meets(other)


def test_words_are_where_there_is_room_for_them(drawn):
    """In a box, or in the head of a panel, or outside all panels; and never over other words."""
    for panel, said, area in drawn.words:
        assert drawn.sheet.holds(area), said
        if panel is not None:
            assert drawn.panels[panel].holds(area), said
            inside = [box.holds(area) for of, box in drawn.boxes if of == panel and box.meets(area)]
            assert all(inside), said
        else:
            assert not any(each.meets(area) for each in drawn.panels), said
    for (_, one, area), (_, other, at) in combinations(drawn.words, 2):
        assert "▸" in (one, other) or not area.meets(at), (one, other)


def test_arrows_lead_from_edge_to_edge(drawn):
    areas = [*drawn.panels, *(box for _, box in drawn.boxes)]
    assert len(drawn.arrows) >= 4
    for ends in drawn.arrows:
        for x, y in ends:
            assert any(area.has_on_its_edge(x, y) for area in areas), (x, y)


def test_each_panel_has_the_name_of_its_stage(drawn):
    names = {
        said
        for panel, said, area in drawn.words
        if panel is not None and area.bottom < drawn.panels[panel].top + HEAD
    }
    assert {"reference", "law", "actuators", "plant", "sensors"} <= names
