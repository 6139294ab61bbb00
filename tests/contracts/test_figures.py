"""What every figure must do, whoever wrote it."""

import dataclasses
import re

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.legend import Legend
from matplotlib.patches import Patch
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.api.loading import open_at
from eqt_cli.base.extensions import shipped
from eqt_cli.base.registry import is_foreign, meanings
from eqt_cli.extend import Commands, EqtError, EstimateFigure, OfSweep, group_named
from eqt_cli.figures.render import curves
from eqt_cli.figures.style import Style

pytestmark = pytest.mark.usefixtures("unarranged")

CONFIG = mapping(
    initial={"pose": {"kind": "exp_normal", "std": 1.0}, "velocity": "normal"},
    solver={"rtol": 1e-3, "cross_check": 0, "error_estimate": False},
)
ESTIMATED = {
    "actuators": [{"kind": "limit", "limit": 5.0}],
    "control": {"period": 0.1},
    "sensors": {
        "pose": [{"kind": "noise", "std": 0.1, "period": 0.2}],
        "velocity": [{"kind": "noise", "std": 0.1}, {"kind": "bias", "value": 0.1}],
    },
    "estimator": {"kind": "invariant"},
}
CONES = [{"axis": [0, 0, 1], "at": [1, 0, "sin(t)"], "angle": "40 deg"}]
SWEEP = {
    "sweep": [{"grid": {"gains.kp": [1, 2], "gains.kd": [0.5, 1]}}],
    "ensemble": {"runs": 8, "seed": 1},  # the fewest of which a win is significant
    # EqT wins, from rest, against a law that is damped so much that it hardly moves.
    "controllers": ["eqt", {"kind": "gt", "gains": {"kp": 0.2, "kd": 50}}],
    "initial": {
        "pose": {"kind": "exp_normal", "std": 1.0},
        "velocity": {"kind": "normal", "std": 1e-3},
    },
}
SMALL = {"budget": 1, "population": 5, "seeds": 1}
TUNE = SMALL | {
    "budget": 5,
    "over": {"gains.kp": [0.5, 2], "gains.kd": [0.5, 2]},
    "objectives": ["effort", "mean_pose_error"],
    "confirm": {"runs": 3},
}
WORST = SMALL | {
    "over": {"gains.kp": [0.5, 2], "plant.inertia.relative": [-0.1, 0.1]},
    "objective": "mean_pose_error",
}
SEARCHED = {"fronts": "tuned", "worst": "worst"}
"""Figures of searches, and the results that they are of."""

IN = {"column": 3.5, "page": 7.16, "slide": 13.3 / 2.25}  # a slide is written larger
BY_PLACE = ("runs", "sweep")
"""Figures of which numbers were kept before their curves had names; they go on being compared."""


def has(extension):
    """Whether eqt has an extension."""
    return extension in [known.name for known in shipped()]


def make_results(folder):
    """Results of every kind that figures are of; and what `verify` finds."""
    for name, more in (
        ("single", {}),
        ("bare", {"store": {"trajectories": "none"}}),
        ("sweep", SWEEP),
        ("estimated", ESTIMATED),
    ):
        api.run(api.load_experiment(CONFIG | more, {"name": name}), folder / name)
    if has("keep_out"):
        cones = {"metrics": [{"kind": "keep_out_time", "cones": CONES}], "name": "cones"}
        api.run(CONFIG | cones, folder / "cones")
    if not has("search"):
        return
    api.tune(CONFIG | {"tune": TUNE}, folder / "tuned")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eqt_cli.extensions.search.worst.MOST_ON_A_LINE", 3)
        api.worst(CONFIG | {"worst": WORST}, folder / "worst")


def recording_of_run(result):
    """What would have been measured of run 0 of the first controller."""
    from eqt_cli.extensions.logs.recording_check import Recording

    states = [result.trajectory(name, 0)[0] for name in ("pose", "velocity", "torque")]
    gaps = np.array([4])
    return Recording(
        "a.csv", "a.csv:1", group_named(result.group_name), result.times, *states, gaps, timed=True
    )


@pytest.fixture(scope="module")
def results(made_once):
    """As `make_results` has made them, once for all processes of the tests."""
    folder = made_once("figures of every kind", make_results)
    opened = {name: open_at(folder / name) for name in ("single", "bare", "sweep", "estimated")}
    opened |= {name: open_at(folder / name) for name in SEARCHED.values() if has("search")}
    opened |= {"cones": open_at(folder / "cones")} if has("keep_out") else {}
    yield opened, recording_of_run(opened["single"]) if has("flights") else None
    for one in opened.values():
        one.close()


def of_sweep(figure_class):
    return issubclass(figure_class, OfSweep)


def subject(figure_class):
    """The kind of result that a figure is of."""
    if figure_class.name in SEARCHED:
        return SEARCHED[figure_class.name]
    if figure_class.name == "keep_out":
        return "cones"
    if figure_class in (Commands, EstimateFigure):
        return "estimated"
    return "sweep" if of_sweep(figure_class) else "single"


def looks_of_laws(drawing, names):
    """What tells the laws apart in each panel and each legend: (law, look) for each artist."""
    panels = [[(str(a.get_label()), a) for a in panel.lines] for panel in drawing.axes]
    for legend in drawing.findobj(Legend):
        panels.append([(text.get_text(), a) for text, a in zip_handles(legend)])
    for named in panels:
        found = [(law, look(a)) for text, a in named for law in names if starts(text, law)]
        if found:
            yield found


def zip_handles(legend):
    return zip(legend.get_texts(), legend.legend_handles, strict=True)


def starts(text, law):
    """Whether a name of a curve begins with that of a law: ``GT``, ``GT: 3``, ``GT, start``."""
    return re.match(rf"{re.escape(law)}($|[ ,:])", text)


def look(artist):
    if isinstance(artist, Patch):
        return to_hex(artist.get_facecolor(), keep_alpha=True), artist.get_hatch()
    if isinstance(artist, PathCollection):  # of `scatter`
        return to_hex(artist.get_facecolor()[0]), artist.get_paths()[0].vertices.tolist()
    dashes = artist.get_linestyle(), artist._unscaled_dash_pattern
    return to_hex(artist.get_color()), str(dashes), artist.get_marker(), artist.get_fillstyle()


AGAIN = pytest.mark.ci("draws every figure again")


@pytest.mark.parametrize(
    ("width", "cycle"),
    [
        ("column", 'color=["k"]'),
        pytest.param("page", 'color=["k", "k"], linestyle=["-", "-"]', marks=AGAIN),
        pytest.param("slide", 'color=["r", "g", "b"]', marks=AGAIN),
    ],
    ids=["column", "page", "slide"],
)
def test_it_draws_a_result_as_wide_as_it_is_told(figure_class, results, tmp_path, width, cycle):
    """In the style that it is given; in one of one colour, too, no two laws look alike.

    Every curve has a name, by which `make figures-check` finds it again.
    """
    opened, recording = results
    sheet = tmp_path / "own.mplstyle"
    sheet.write_text(f"axes.prop_cycle: cycler({cycle})", encoding="utf-8")
    style, shown = Style((str(sheet),)), opened[subject(figure_class)]
    drawing = figure_class().draw([shown], width, style=style, measured=recording)
    assert drawing.get_figwidth() == pytest.approx(IN[width])
    assert drawing.axes
    assert all(axes.has_data() for axes in drawing.axes if axes.get_label() != "<colorbar>")
    for found in looks_of_laws(drawing, {"eqt", "gt", "EqT", "GT"}):
        for law, one in found:
            assert not [other for other, same in found if same == one and other != law]
    if is_foreign(figure_class.__module__) or figure_class.name in BY_PLACE:
        return  # its curves are known by their places
    drawn = curves(drawing)
    assert drawn
    assert [
        curve.name
        for curve in drawn
        if re.fullmatch(r"((line|points|cells|lower edge|upper edge) )?\d+", curve.name)
    ] == []


def test_its_options_are_documented(figure_class):
    told = meanings(figure_class)
    assert [f.name for f in dataclasses.fields(figure_class) if not told.get(f.name)] == []
    assert figure_class.__doc__


def test_a_controller_that_there_is_not_is_named(figure_class, results):
    opened, recording = results
    shown = opened[subject(figure_class)]
    with pytest.raises(EqtError, match=r"figure '.*' finds no controller 'gtt'"):
        figure_class(controllers=("gtt",)).draw([shown], measured=recording)


def test_what_it_cannot_show_is_one_message(figure_class, results):
    opened, _ = results
    lacking = opened["single" if of_sweep(figure_class) else "sweep"]
    with pytest.raises(EqtError) as caught:
        figure_class().draw([lacking])
    assert f"'{figure_class.name}'" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_trajectories_that_are_not_kept_are_one_message_or_not_needed(figure_class, results):
    opened, recording = results
    said = f"'{figure_class.name}'"
    try:
        figure_class().draw([opened["bare"]], measured=recording)
    except EqtError as error:
        said = str(error)
    assert f"'{figure_class.name}'" in said
    assert "\n" not in said
