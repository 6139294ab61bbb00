"""Names beside curves, or in a legend."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from eqt_cli.figures.curves import name_curves
from eqt_cli.figures.style import house_style


@pytest.fixture
def named():
    """A drawing of curves over 0 to 1 after they were named."""

    def of(curves, names):
        with house_style():
            drawing = Figure(figsize=(3.5, 2))
            axes = drawing.add_subplot()
            x = np.linspace(0, 1, len(curves[0]))
            lines = [axes.plot(x, curve)[0] for curve in curves]
            name_curves(drawing, [axes], lines, names)
            drawing.draw_without_rendering()
        return drawing

    return of


def test_curves_with_room_are_named_beside_them(named):
    drawing = named([np.zeros(50), np.ones(50)], ["low", "high"])
    (axes,) = drawing.axes
    assert not drawing.legends
    low, high = axes.texts
    assert (low.get_text(), high.get_text()) == ("low", "high")
    assert low.get_position()[1] < 0.5 < high.get_position()[1]


def test_names_hide_no_curve(named):
    x = np.linspace(0, 1, 400)
    curves = [np.sin(9 * x), 2 + np.cos(7 * x), 5 + 0 * x]
    (axes,) = named(curves, ["one", "two", "three"]).axes
    assert len(axes.texts) == 3
    for text in axes.texts:
        box = Text.get_window_extent(text)
        for curve in curves:
            assert not box.count_contains(axes.transData.transform(np.column_stack([x, curve])))


@pytest.mark.parametrize(
    ("curves", "names"),
    [
        ([np.zeros(50), np.zeros(50)], ["one", "other"]),  # which lie on each other
        ([np.zeros(50), np.ones(50)], ["low", "a name that is too long"]),
        ([np.full(50, k) for k in range(9)], list("abcdefghi")),
    ],
)
def test_curves_without_room_have_a_legend(named, curves, names):
    drawing = named(curves, names)
    (legend,) = drawing.legends
    assert [text.get_text().replace("\n", " ") for text in legend.get_texts()] == names
    assert not drawing.axes[0].texts
