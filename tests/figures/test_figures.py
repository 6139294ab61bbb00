"""What holds for every figure of the registry."""

import logging
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from io import StringIO
from string import ascii_lowercase

import matplotlib
import numpy as np
import pytest
from ci_cases import mostly_ci
from flaws import flaws
from matplotlib.figure import Figure
from PIL import Image
from said import error_of, says

from eqt_cli.api import plot
from eqt_cli.api.loading import open_at
from eqt_cli.extend import Commands, EqtError, EstimateFigure
from eqt_cli.figures.figure import OfReference, OfSweep, OverTime, figures
from eqt_cli.figures.layout import freeze
from eqt_cli.figures.render import encode, render
from eqt_cli.figures.style import house_style

FORMATS = ("pdf", "svg", "png", "tiff")

# Figures of sweeps, searches, rates, recordings, actuators and estimates have tests of their own.
OTHERS = OfSweep | Commands | EstimateFigure
OF_EXTENSIONS = {"fronts", "keep_out", "worst", "rates", "measured"}
NAMES = [name for name in figures.names() if name not in OF_EXTENSIONS]
NAMES = [name for name in NAMES if not issubclass(figures.get(name), OTHERS)]


def every(of):
    """Runs a test for each of some figures.

    All tests of a figure come in a row, so that the processes of the tests share the drawings out.
    """
    names = [name for name in NAMES if of(figures.get(name))]
    why = "finds places for the panels of one of several figures"
    return mostly_ci("name", names, ["paper"], why, scope="module")


every_figure = every(lambda kind: True)
every_figure_of_runs = every(lambda kind: not issubclass(kind, OfReference))
every_figure_over_time = every(lambda kind: issubclass(kind, OverTime))
unarranged = pytest.mark.usefixtures("unarranged")


AGAIN = pytest.mark.ci("draws figures again, which are drawn once in fast tests")


@dataclass
class Drawn:
    """A figure, drawn once for all tests that only look at it."""

    drawing: Figure
    flaws: list[str]
    said: str  # on the way, on any stream or in a log


@pytest.fixture(scope="module")
def drawn():
    @cache
    def draw(name, path):
        said, log = StringIO(), logging.getLogger()
        listener = logging.StreamHandler(said)
        log.addHandler(listener)
        try:
            with open_at(path) as results, redirect_stdout(said), redirect_stderr(said):
                drawing = figures.get(name)().draw([results])
                return Drawn(drawing, flaws(drawing, "column"), said.getvalue())
        finally:
            log.removeHandler(listener)

    return draw


@every_figure
def test_no_text_covers_another_or_leaves_the_sheet(name, se3, drawn):
    assert drawn(name, se3).flaws == []


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.ci("draws every figure again")
def test_odd_and_long_names_find_room(name, odd_names, drawn):
    assert drawn(name, odd_names).flaws == []


@pytest.mark.ci("draws every figure twice, in processes of their own")
def test_files_are_equal_byte_for_byte_in_every_process(so3, tmp_path):
    formats = {name: FORMATS if name == "paper" else ("svg",) for name in NAMES}
    code = (
        "from pathlib import Path\n"
        "from eqt_cli.figures.render import render\n"
        "from eqt_cli.api.loading import open_at\n"
        f"with open_at({str(so3)!r}) as results:\n"
        f"    for name, formats in {formats}.items():\n"
        "        render([results], name, Path.cwd(), formats)\n"
    )
    for folder, changes in (
        ("one", {"PYTHONHASHSEED": "1", "SOURCE_DATE_EPOCH": "0", "TZ": "UTC"}),
        ("two", {"PYTHONHASHSEED": "2", "SOURCE_DATE_EPOCH": "2000000000", "TZ": "Asia/Tokyo"}),
    ):
        (tmp_path / folder).mkdir()
        command = [sys.executable, "-W", "error", "-c", code]
        environment = {**os.environ, **changes}
        done = subprocess.run(
            command, cwd=tmp_path / folder, env=environment, stderr=subprocess.PIPE, check=False
        )
        assert done.returncode == 0, done.stderr.decode()
    for name in NAMES:
        for format in formats[name]:
            one, two = (tmp_path / folder / f"{name}.{format}" for folder in ("one", "two"))
            assert one.read_bytes() == two.read_bytes(), (name, format)


@mostly_ci("name", NAMES, ["path"], AGAIN.args[0])
@unarranged
def test_the_users_own_matplotlib_settings_change_nothing(name, so3, opened):
    expected = encode(figures.get(name)().draw([opened(so3)]), "png")
    with matplotlib.rc_context({"axes.facecolor": "black", "font.size": 20, "savefig.dpi": 50}):
        assert encode(figures.get(name)().draw([opened(so3)]), "png") == expected
        assert matplotlib.rcParams["font.size"] == 20


@pytest.mark.ci("writes every format")
@unarranged
def test_every_format_is_drawn_once(so3, opened, monkeypatch):
    drawing, own, drawn = figures.get("paper")().draw([opened(so3)]), Figure.draw, []

    def draw(figure, renderer):
        drawn.append(figure)
        own(figure, renderer)

    monkeypatch.setattr(Figure, "draw", draw)
    for format in FORMATS:
        encode(drawing, format)
    assert len(drawn) == len(FORMATS)


@every_figure
def test_drawing_says_nothing(name, se3, drawn):
    assert drawn(name, se3).said == ""


@every_figure_over_time
@unarranged
def test_missing_trajectories_say_what_to_do(name, so3, altered, opened):
    whole = opened(so3)
    results = altered(so3, **{v: None for v in whole.names if "time" in whole.dims(v)})
    assert says(
        error_of(figures.get(name)().draw, [results]),
        f"{results.path}: figure '{name}' needs the trajectories of…'lyapunov'…",
    )


@every_figure_of_runs
@unarranged
def test_no_good_run_at_all_is_an_error(name, so3, altered, opened):
    results = altered(so3, status=np.ones_like(opened(so3)["status"]))
    assert says(
        error_of(figures.get(name)().draw, [results]),
        f"{results.path}: figure '{name}' has nothing to show, since…",
    )


@every_figure_of_runs
@unarranged
def test_failed_runs_are_counted_below_the_panels(name, so3, altered, opened):
    if name == "failures":
        pytest.skip("it shows them")
    status = np.zeros_like(opened(so3)["status"])
    status[1, [3, 4]] = 3  # the first run is what figures of one run show
    status[2] = 1
    drawing = figures.get(name)().draw([altered(so3, status=status)])
    assert drawing.get_supxlabel().splitlines()[:2] == [
        "GT: 2 of 6 runs failed; left out.",
        "nog: 6 of 6 runs failed; left out.",
    ]


@every_figure_over_time
@unarranged
def test_the_number_of_stored_runs_is_said(name, odd_names, opened, picture):
    drawing = picture(figures.get(name)(), opened(odd_names))
    assert drawing.get_supxlabel().splitlines()[0] == "Trajectories of the first 4 of 6 runs."


@every_figure
def test_a_complete_result_needs_no_remark_but_how_many_runs_are_averaged(name, se3, drawn):
    drawing = drawn(name, se3).drawing
    averaged = name in ("paper", "summary", "runs", "torque", "distributions")
    assert ("6 runs" in drawing.get_supxlabel()) == averaged
    single = name in ("path", "pose")  # which says its axis, or the run
    # In four seconds no run settles; a body upside down has no roll.
    also = name in ("distributions", "pose")
    assert len(drawing.get_supxlabel().splitlines()) == (averaged or single) + also


@every_figure
def test_panels_of_several_are_lettered(name, se3, drawn):
    axes = drawn(name, se3).drawing.axes
    letters = [panel.get_title(loc="left") for panel in axes]
    assert letters == [f"({letter})" for letter in ascii_lowercase[: len(axes)]]


@every_figure_over_time
@unarranged
def test_a_single_sample_is_no_curve(name, so3, altered, opened, tmp_path):
    results = opened(so3)
    over_time = [v for v in (*results.names, "time") if "time" in results.dims(v)]
    single = {v: results.read(v, time=[0]) for v in over_time}
    assert says(
        error_of(figures.get(name)().draw, [altered(so3, **single)]),
        f"{tmp_path / 'altered.h5'}: figure '{name}' needs trajectories of two…",
    )


@mostly_ci("name", NAMES, ["path"], AGAIN.args[0])
@unarranged
def test_signals_that_are_zero_throughout_can_be_drawn(name, so3, altered, opened):
    results = opened(so3)
    over_time = [v for v in results.names if "time" in results.dims(v)]
    zeros = altered(so3, **{v: np.zeros_like(results[v]) for v in over_time})
    options = {"log": True} if hasattr(figures.get(name), "log") else {}
    assert encode(figures.get(name)(**options).draw([zeros]), "pdf")


@unarranged
def test_render_names_its_files_after_the_figure(so3, opened, tmp_path):
    files = render([opened(so3)], "paper", tmp_path / "new" / "figures", ["svg", "json"])
    assert [path.relative_to(tmp_path).as_posix() for path in files] == [
        "new/figures/paper.svg",
        "new/figures/paper.json",
        "new/figures/paper-caption.tex",
    ]
    assert sorted(files) == sorted((tmp_path / "new" / "figures").iterdir())


@pytest.mark.ci("draws a figure three times")
@unarranged
def test_a_journal_gets_its_width_and_resolution(so3, tmp_path):
    for _ in range(2):  # of which the second replaces files of eqt
        files = plot(so3, "torque", tmp_path, formats=("tiff", "svg"), width="84 mm", dpi=100)
    tiff, svg = files[:2]
    assert b'width="238.11' in svg.read_bytes()
    with Image.open(tiff) as picture:
        assert picture.width == int(84 / 25.4 * 100)
        assert picture.info["dpi"] == (100, 100)
    with pytest.raises(EqtError, match=r"unknown width '3 km'; known: column, .* lengths of 38 mm"):
        plot(so3, "torque", tmp_path, width="3 km")


def test_the_name_of_a_colour_scale_stays_beside_its_numbers():
    """A bar is narrower than its place in the layout, and gets its width when it is drawn."""
    with house_style():
        drawing = Figure(figsize=(7.0, 2.3))
        panels = drawing.subplots(1, 3)
        image = panels[-1].imshow(np.eye(3))
        bar = drawing.colorbar(image, ax=panels, label="share (%)").ax
        freeze(drawing)
        drawing.draw_without_rendering()
        name = bar.yaxis.label.get_window_extent()
        numbers = [label.get_window_extent() for label in bar.get_yticklabels()]
    assert not any(name.overlaps(number) for number in numbers)
