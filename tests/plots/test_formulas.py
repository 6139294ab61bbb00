"""Formulas are read once in a style, whatever renders them."""

from io import BytesIO
from typing import Any

import pytest
from matplotlib.mathtext import MathTextParser

from eqt_cli.plots.drawing.layout import blank_sheet, freeze
from eqt_cli.plots.drawing.style import Style, house_style

pytestmark = pytest.mark.usefixtures("unarranged")


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What Matplotlib reads, on what it depends."""
    own: Any = MathTextParser._parse_cached  # type: ignore[attr-defined]  # Matplotlib's own
    uncached, found = own.__wrapped__, []

    def parsed(self: Any, *on: Any) -> Any:
        found.append((self._output_type, *on))
        return uncached(self, *on)

    monkeypatch.setattr(MathTextParser, "_parse_cached", parsed)
    return found


def _draw(style: Style, text: str) -> None:
    with house_style(style):
        drawing, panels = blank_sheet("column", [["one", "other"]], 1.0)
        for axes in panels.values():
            axes.set_xlabel(text)
        freeze(drawing)
        for format in ("pdf", "svg", "png"):
            drawing.savefig(BytesIO(), format=format)


def test_a_formula_is_read_once_for_all_renderers_and_formats(read: list[tuple[Any, ...]]) -> None:
    _draw(Style(), r"$\|\tau\|$")
    assert read
    assert len(read) == len(set(read))


def test_a_second_figure_reads_nothing_again(read: list[tuple[Any, ...]]) -> None:
    style = Style()
    _draw(style, r"$\|\tau\|$")
    before = len(read)
    _draw(style, r"$\|\tau\|$")
    assert len(read) == before


@pytest.mark.slow("reads the fonts of another style")
def test_another_style_reads_for_itself(read: list[tuple[Any, ...]]) -> None:
    _draw(Style(), "$x$")
    before = len(read)
    _draw(Style(), "$x$")
    assert len(read) == 2 * before


def test_matplotlib_is_left_as_it_was() -> None:
    before = MathTextParser._parse_cached  # type: ignore[attr-defined]  # Matplotlib's own
    with house_style(Style()):
        assert MathTextParser._parse_cached is not before  # type: ignore[attr-defined]  # as above
    assert MathTextParser._parse_cached is before  # type: ignore[attr-defined]  # as above
