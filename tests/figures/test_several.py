"""Several results in one figure: whose curve is whose, and what cannot be shown together."""

import shutil

import numpy as np
import pytest
from case_tables import from_yaml
from matplotlib.colors import to_rgb
from said import error_of, says

from eqt_cli.extend import Conclusion, RunsFigure, SweepFigure
from eqt_cli.figures.shown import Chosen, ShownControllers, looks, names
from eqt_cli.figures.style import Style, house_style, line_style
from eqt_cli.figures.time_figures import Paper, Summary, Torque

pytestmark = pytest.mark.usefixtures("unarranged")


@pytest.fixture
def stiff(tmp_path, simulate):
    """The experiment with another gain, a longer horizon and two of the controllers."""
    return simulate(
        name="stiff",
        gains={"kp": 2.0, "kd": 1.0},
        time={"duration": 5.0, "samples": 26},
        controllers=["gt", "eqt"],
    )


def test_every_result_keeps_its_own_times_and_values(so3, stiff, opened):
    first, second = opened(so3), opened(stiff)
    axes = Paper().draw([first, second]).axes[0]
    assert len(axes.lines) == 6
    for line, results, controller in zip(axes.lines[3:5], (first, second), (3, 0), strict=True):
        mean = results["pose_error"][controller].mean(axis=0)
        np.testing.assert_array_equal(line.get_xdata(), results["time"])
        np.testing.assert_array_equal(line.get_ydata(), mean)
    assert axes.get_xlim() == (0, 5)


def test_the_legend_names_controller_and_result(so3, stiff, opened, curve_names, picture):
    drawing = picture(Summary(controllers=["eqt"]), opened(so3), opened(stiff))
    assert curve_names(drawing) == ["EqT, small", "EqT, stiff"]


def test_a_law_has_its_colour_in_every_result_and_a_result_its_dashes(so3, stiff, opened, picture):
    lines = picture(Summary(), opened(so3), opened(stiff)).axes[0].lines
    looks = {line.get_label(): (line.get_color(), str(line.get_linestyle())) for line in lines}
    eqt, gt = looks["eqt, small"], looks["gt, small"]
    assert looks["eqt, stiff"][0] == eqt[0] and looks["gt, stiff"][0] == gt[0] != eqt[0]
    assert looks["eqt, stiff"][1] == looks["gt, stiff"][1] != eqt[1] == gt[1]


def test_curves_of_more_results_than_dashes_look_different(so3, tmp_path, opened):
    paths = [tmp_path / str(number) / "results.h5" for number in range(5)]
    for path in paths:
        path.parent.mkdir()
        shutil.copy(so3, path)
    with house_style():
        shown = ShownControllers([opened(path) for path in paths], "paper").ensembles
        looks = {str(line_style(ensemble.look)) for ensemble in shown}
    assert len(looks) == 20


def test_variants_of_a_tuned_law_have_its_colour_and_their_own_dashes(so3, opened, monkeypatch):
    tuned = Conclusion("tuned", variants={"eqt": ("eqt", 0), "gt": ("eqt", 1), "nog": ("nog", 0)})
    monkeypatch.setattr("eqt_cli.figures.shown.conclusion_of", lambda result: tuned)
    with house_style():  # the winner, the start, another law and one that was not tuned
        styles = [line_style(look) for look in looks([opened(so3)], [range(4)])]
    assert styles[0]["color"] == styles[1]["color"]
    assert styles[0]["linestyle"] != styles[1]["linestyle"]
    assert len({style["color"] for style in styles[1:]}) == 3


LAWS = [{"kind": "family", "label": label} for label in "abcdefgh"]


@pytest.mark.ci("draws seven laws twice")
def test_beyond_six_laws_the_others_are_grey_unless_in_focus(simulate, opened):
    result = opened(simulate(controllers=LAWS, ensemble={"runs": 1, "seed": 1}))

    def coloured(**chosen):
        with house_style():
            shown = ShownControllers([result], "paper", Chosen(**chosen)).ensembles
            styles = {e.label: line_style(e.look) for e in shown}
        assert len(set(map(str, styles.values()))) == len(styles)
        return "".join(k for k, look in styles.items() if len(set(to_rgb(look["color"]))) > 1)

    assert coloured() == "abcdef"
    assert coloured(focus=["b", "h"]) == "bh"
    assert coloured(controllers=["f", "g", "h"]) == "fgh"


@pytest.mark.ci("simulates and draws eight laws")
@pytest.mark.parametrize(("figure", "signal"), [(Summary, "pose_error"), (Torque, "torque_norm")])
def test_beyond_six_laws_each_has_a_panel_sorted_by_its_median(figure, signal, simulate, opened):
    laws = [*LAWS[:7], {"kind": "eqt"}]
    result = opened(simulate(controllers=laws, ensemble={"runs": 3, "seed": 1}))
    captions = []
    drawing = figure(**{"degrees": False} if figure is Summary else {}).draw(
        [result], captions=captions
    )
    assert "a panel for each law" in drawing.get_label()
    titles = {axes.lines[0].get_label(): axes.get_title(loc="right") for axes in drawing.axes}
    assert titles == {**dict(zip("abcdefg", "abcdefg", strict=True)), "eqt": "EqT"}
    drawn = {axes.lines[0].get_label(): axes.lines[0].get_ydata() for axes in drawing.axes}
    medians = dict(zip(result.labels, np.median(result.read(signal), axis=1), strict=True))
    assert drawn.keys() == medians.keys()
    for law, curve in drawn.items():
        np.testing.assert_array_equal(curve, medians[law])
    late = slice(None) if figure is Torque else slice(-round(0.1 * len(result.times)), None)
    ends = [curve[late].mean() for curve in drawn.values()]
    assert ends == sorted(ends)
    assert not any("*" in caption for caption in captions)


@pytest.mark.ci("simulates and draws seven laws")
def test_panels_mark_laws_whose_gains_are_not_matched(simulate, opened):
    laws = [*LAWS[:6], {"kind": "slotine_li"}]
    drawing = Summary().draw([opened(simulate(controllers=laws))], captions=[])
    titles = {axes.get_title(loc="right") for axes in drawing.axes}
    assert titles == {*"abcdef", "Slotine–Li*"}
    assert "closing error, 6 runs, * gains not matched" in drawing.get_supxlabel()


@pytest.mark.parametrize("chosen", [["eqt", "nog"], ["gt", "asym"], ["eqt", "nog", "asym"], []])
def test_a_style_of_two_colours_tells_the_shown_laws_apart(chosen, so3, opened, tmp_path):
    cycle = 'axes.prop_cycle: cycler(color=["k", "r"], linestyle=["-", "--"])'
    sheet = tmp_path / "two.mplstyle"
    sheet.write_text(cycle, encoding="utf-8")
    lines = (
        Summary(controllers=chosen).draw([opened(so3)], style=Style((str(sheet),))).axes[0].lines
    )
    looks = {(line.get_color(), str(line._unscaled_dash_pattern)) for line in lines}
    assert len(looks) == len(chosen or "four")
    assert len({colour for colour, _ in looks}) == 2


def test_a_colour_is_chosen_and_equal_ones_differ_in_dashes(so3, opened, picture):
    chosen = {"gt": "gold", "nog": "#ffd700", "asym": "tab:blue"}
    lines = picture(Summary(colours=chosen), opened(so3)).axes[0].lines
    own, *others = [line.get_color() for line in lines]
    assert others == ["#ffd700", "#ffd700", "#1f77b4"] and own not in others
    assert lines[1]._unscaled_dash_pattern != lines[2]._unscaled_dash_pattern


@from_yaml
def test_a_wrong_colour(so3, opened, colours, message):
    said = error_of(Summary(colours=colours).draw, [opened(so3)])
    assert says(said, f"{so3}: figure 'summary' {message}")


def test_all_curves_of_one_law_differ_in_colour_and_dashes(so3, stiff, opened, picture):
    lines = picture(Summary(controllers=["eqt"]), opened(so3), opened(stiff)).axes[0].lines
    assert len({line.get_color() for line in lines}) == 2
    assert len({str(line.get_linestyle()) for line in lines}) == 2


def test_torques_are_drawn_with_their_own_reference(so3, opened, simulate, picture):
    reference = {"torque": ["sin(t)", "0", "1"]}
    few = {"ensemble": {"runs": 1, "seed": 1}, "time": {"duration": 1.0, "samples": 11}}
    other = simulate(name="other", reference=reference, controllers=["eqt"], **few)
    drawing = picture(Torque(controllers=["eqt"]), opened(so3), opened(other))
    drawn = {line.get_label(): line.get_ydata() for line in drawing.axes[0].lines}
    np.testing.assert_array_equal(drawn["desired, small"], abs(opened(so3)["desired_torque"][:, 0]))
    np.testing.assert_array_equal(
        drawn["desired, other"], abs(opened(other)["desired_torque"][:, 0])
    )


def test_single_runs_have_a_panel_per_controller_and_result(so3, stiff, opened, picture):
    drawing = picture(RunsFigure(), opened(so3), opened(stiff))
    titles = [axes.get_title() for axes in drawing.axes]
    assert titles[3:5] == ["asym, small", "GT, stiff"]


def test_equal_titles_are_told_apart_by_folder_or_number(so3, tmp_path, opened):
    copy = tmp_path / "again" / "results.h5"
    copy.parent.mkdir()
    shutil.copy(so3, copy)
    twin = tmp_path / "other" / "again" / "results.h5"
    shutil.copytree(copy.parent, twin.parent)
    assert names([opened(so3), opened(copy)]) == ["out", "again"]
    assert names([opened(copy), opened(twin)]) == ["small (1)", "small (2)"]


def test_failed_runs_are_counted_by_result(so3, altered, opened):
    status = np.zeros_like(opened(so3)["status"])
    status[0, 2] = 2
    one, other = opened(so3), altered(so3, status=status)
    drawing = Summary().draw([one, other])
    name = other.path.parent.name
    assert drawing.get_supxlabel().splitlines()[0] == (
        f"EqT, {name}: 1 of 6 runs failed; left out."
    )


def test_groups_do_not_mix(so3, se3, opened):
    assert error_of(Summary().draw, [opened(so3), opened(se3)]) == (
        f"{se3}: figure 'summary' shows results on one group; this is on SE3, and {so3} on SO3"
    )


def test_sweeps_are_shown_one_at_a_time(so3, opened):
    assert (
        error_of(SweepFigure().draw, [opened(so3), opened(so3)])
        == f"{so3}: figure 'sweep' shows one sweep at a time"
    )
