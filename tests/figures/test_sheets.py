"""Figures as a reader gets them: nothing overlaps, leaves the page or is too small."""

import importlib.util
from pathlib import Path

import pytest
from flaws import flaws

from eqt_cli.api.loading import open_at
from eqt_cli.figures.figure import figures
from eqt_cli.figures.style import Style

LOOKS = {
    "column": ("column", ()),
    "page": ("page", ()),
    "slide": ("slide", ()),
    "dark slide": ("slide", ("dark_background",)),
}

_SPEC = importlib.util.spec_from_file_location(
    "sheets", Path(__file__).parents[2] / "docs" / "figures" / "sheets.py"
)
assert _SPEC is not None and _SPEC.loader is not None
sheets = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(sheets)

SEARCHED = ("fronts", "tuned", "worst")
CASES = [
    name
    for name, (results, *_) in sheets.FIGURES.items()
    if not set(results.split()) & set(SEARCHED)
    and name not in ("pareto, flies", "winners, scenarios", "winners, lag")
]
"""All but those of searches, which take minutes, and three that are refused."""


@pytest.mark.ci("draws every figure in each width")
@pytest.mark.parametrize(("width", "theme"), LOOKS.values(), ids=LOOKS)
@pytest.mark.parametrize("name", CASES)
def test_no_figure_has_a_flaw(name, width, theme, made_once):
    results, figure, options = sheets.FIGURES[name]
    folders = [
        made_once(f"sheet {one}", lambda to, one=one: sheets.result(to, one))
        for one in results.split()
    ]
    opened = [
        open_at(folder / "results" / one)
        for folder, one in zip(folders, results.split(), strict=True)
    ]
    drawing = figures.get(figure)(**options).draw(opened, width, style=Style(theme))
    for one in opened:
        one.close()
    assert flaws(drawing, width) == []


@pytest.mark.parametrize(
    ("name", "options", "width"),
    [
        ("paper", {"log": True}, "slide"),
        pytest.param("path", {}, "column", marks=pytest.mark.needs("paths")),
    ],
)
def test_a_few_figures_have_no_flaw(name, options, width, se3, opened):
    assert flaws(figures.get(name)(**options).draw([opened(se3)], width), width) == []


def test_two_results_share_rows_of_the_legend_and_no_text_covers_another(so3, simulate, opened):
    other = simulate(gains={"kp": 1, "kd": 1}, name="damped")
    figure = figures.get("distributions")(kind="ecdf")
    drawing = figure.draw([opened(so3), opened(other)], "slide")
    assert flaws(drawing, "slide") == []
    rows = {}
    for text in drawing.legends[0].get_texts():
        rows.setdefault(round(text.get_window_extent().y0), []).append(text.get_text())
    for texts in rows.values():
        assert len({"damped" in text for text in texts}) == 1
