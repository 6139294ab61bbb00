"""The paper's figure: what is drawn is what the result holds."""

import numpy as np
import pytest
from case_tables import from_yaml
from made_up import Table, write
from matplotlib.colors import to_rgba
from said import error_of, says

from eqt_cli.base.store_writer import Variable
from eqt_cli.extend import RunsFigure
from eqt_cli.figures.layout import NO_NUMBERS
from eqt_cli.figures.time_figures import Paper, Summary

pytestmark = pytest.mark.usefixtures("unarranged")

PRINT = Paper()
"""As in the paper: means on linear scales."""

SIGNALS = ("pose_error", "velocity_error", "torque_norm", "lyapunov")


def test_no_L_of_a_law_that_claims_none_and_a_note_of_laws_with_gains_of_their_own(
    simulate, opened, curve_names, picture
):
    drawing = picture(PRINT, opened(simulate(controllers=["eqt", "goodarzi2013", "slotine_li"])))
    shown = [[line.get_label() for line in axes.lines] for axes in drawing.axes]
    assert shown == [["eqt", "goodarzi2013", "slotine_li"]] * 3 + [["eqt", "slotine_li"]]
    assert curve_names(drawing) == ["EqT", "Goodarzi 2013", "Slotine–Li"]
    assert drawing.get_supxlabel().splitlines() == [
        "Gains not matched: Goodarzi 2013, Slotine–Li.",
        "Without L, since the law does not claim that it falls: Goodarzi 2013.",
        "Curves: mean, 6 runs.",
    ]


@pytest.mark.parametrize(("log", "scale"), [(False, "linear"), (True, "log")])
def test_laws_of_one_curve_have_their_paired_differences_in_a_panel(
    log, scale, so3, altered, opened
):
    """GT and asym differ from EqT by 1/1000 of its peak; on a logarithm, of its value."""
    error, notes = opened(so3)["pose_error"].copy(), []
    apart = 1e-3 * (error[0] if log else error[0].max()) * np.sin(np.arange(error.shape[-1]))
    error[1], error[3] = error[0] + apart, error[0] - apart
    figure = Summary(controllers=["eqt", "gt", "asym"], degrees=False, log=log)
    drawing = figure.draw([altered(so3, pose_error=error)], captions=notes)
    [panel] = [axes for axes in drawing.axes if axes.get_label() == "difference of pose_error"]
    assert panel.get_title() == "others − EqT" and drawing.axes[0].get_yscale() == scale
    for law, line in zip((1, 3), panel.lines[1:], strict=True):
        median = np.median(error[law] - error[0], axis=0)
        np.testing.assert_array_equal(line.get_ydata(), median)
    assert "EqT, GT and asym: one curve (medians" in drawing.get_supxlabel()
    assert len(figure.draw([opened(so3)]).axes) == len(drawing.axes) - 1


def test_laws_that_differ_by_rounding_have_no_panel_of_differences(so3, altered, opened):
    error = opened(so3)["pose_error"].copy()
    error[1] = error[0] * (1 + 2e-16)
    figure = Summary(controllers=["eqt", "gt"], degrees=False)
    drawing = figure.draw([altered(so3, pose_error=error)], captions=[])
    assert "EqT and GT: one curve (equal to rounding)" in drawing.get_supxlabel()
    assert "difference of pose_error" not in [axes.get_label() for axes in drawing.axes]


def test_a_curve_that_starts_at_0_starts_where_a_logarithmic_scale_does(so3, altered, opened):
    error = opened(so3)["velocity_error"].copy()
    error[..., 0] = 0
    drawing = Summary(controllers=["eqt"], log=True).draw([altered(so3, velocity_error=error)])
    values = drawing.axes[1].lines[0].get_ydata()
    assert np.ma.getmaskarray(values).tolist() == [True] + [False] * (len(values) - 1)
    assert np.ma.getdata(values)[0] == 0


def test_failed_runs_are_left_out_of_the_means(so3, altered, opened, curve_names):
    signals = {signal: opened(so3)[signal] for signal in SIGNALS}
    status = np.zeros_like(opened(so3)["status"])
    status[0, 2], status[1] = 2, 3
    for values in signals.values():
        values[status != 0] = np.nan
    drawing = PRINT.draw([altered(so3, status=status, **signals)])
    for axes, signal in zip(drawing.axes, SIGNALS, strict=True):
        good = [0, 1, 3, 4, 5]
        assert len(axes.lines) == 3
        np.testing.assert_array_equal(
            axes.lines[0].get_ydata(), signals[signal][0, good].mean(axis=0)
        )
    assert curve_names(drawing) == ["EqT", "nog", "asym"]
    assert drawing.get_supxlabel().splitlines()[-1] == (
        "Curves: mean, runs: 5 (EqT), 6 (nog), 6 (asym)."
    )


def test_stored_runs_are_paired_with_their_own_status(odd_names, altered, opened):
    status = np.zeros_like(opened(odd_names)["status"])
    status[0, 1], status[0, 5] = 1, 1  # run 5 has no stored trajectory
    drawing = PRINT.draw([altered(odd_names, status=status)])
    mean = opened(odd_names)["lyapunov"][0, [0, 2, 3]].mean(axis=0)
    np.testing.assert_array_equal(drawing.axes[3].lines[0].get_ydata(), mean)
    assert "_hidden: 1 of 4 runs failed; left out." in drawing.get_supxlabel()


def test_axes_carry_symbols_and_units(so3, opened, picture):
    drawing = picture(PRINT, opened(so3))
    assert [axes.get_ylabel() for axes in drawing.axes] == [
        r"$\|I - Q_{\mathrm{E}}\|_{\mathrm{F}}$",
        r"$\|V - V_{\mathrm{d}}\|$ $(\mathrm{rad/s})$",
        r"$\|\tau\|$ $(\mathrm{N\,m})$",
        r"$\mathcal{L}$ $(\mathrm{J})$",
    ]
    assert [axes.get_xlabel() for axes in drawing.axes] == [
        "",
        "",
        r"$t$ $(\mathrm{s})$",
        r"$t$ $(\mathrm{s})$",
    ]


def test_rotation_and_translation_are_shown_apart(se3, opened, picture):
    results = opened(se3)
    drawing = picture(PRINT, results)
    signals = [
        f"{norm}_{part}"
        for norm in ("velocity_error", "torque_norm")
        for part in ("rotation", "translation")
    ]
    signals = ["attitude_angle", "position_error", *signals]
    for axes, signal in zip(drawing.axes, [*signals, "lyapunov"], strict=True):
        np.testing.assert_array_equal(axes.lines[1].get_ydata(), results[signal][1].mean(axis=0))
    assert [axes.get_ylabel() for axes in drawing.axes] == [
        r"attitude error $(\mathrm{deg})$",
        r"$\|p - p_{\mathrm{d}}\|$ $(\mathrm{m})$",
        r"$\|\omega - \omega_{\mathrm{d}}\|$ $(\mathrm{rad/s})$",
        r"$\|v - v_{\mathrm{d}}\|$ $(\mathrm{m/s})$",
        r"$\|\tau\|$ $(\mathrm{N\,m})$",
        r"$\|f\|$ $(\mathrm{N})$",
        r"$\mathcal{L}$ $(\mathrm{J})$",
    ]
    assert [axes.get_title() for axes in drawing.axes[:2]] == ["rotation", "translation"]


def test_parts_of_extended_poses_have_symbols_of_their_own(simulate, opened, picture):
    brief = {"controllers": ["eqt"], "time": {"duration": 0.1, "samples": 3}}
    results = opened(simulate(group="SE23", inertia=1.0, reference={"kind": "constant"}, **brief))
    labels = [axes.get_ylabel().split(" $(")[0] for axes in picture(Paper(), results).axes[:6]]
    assert labels == [
        r"$\|I - R_{\mathrm{E}}\|_{\mathrm{F}}$",
        r"$\|v_{\mathrm{E}}\|$",
        r"$\|p_{\mathrm{E}}\|$",
        r"$\|\omega - \omega_{\mathrm{d}}\|$",
        r"$\|V - V_{\mathrm{d}}\|_{v}$",
        r"$\|V - V_{\mathrm{d}}\|_{p}$",
    ]


def test_a_norm_without_parts_says_the_units_of_all_parts(se3, altered, opened):
    parts = [name for name in opened(se3).names if name.endswith(("_rotation", "_translation"))]
    drawing = Summary().draw([altered(se3, **dict.fromkeys(parts))])
    units = r"($\mathrm{rad/s}$ and $\mathrm{m/s}$)"
    assert drawing.axes[1].get_ylabel() == r"$\|V - V_{\mathrm{d}}\|$ " + units


def test_log_leaves_a_torque_of_less_than_a_decade_linear(so3, opened, picture):
    scales = [axes.get_yscale() for axes in picture(Paper(log=True), opened(so3)).axes]
    assert scales == ["log", "log", "linear", "log"]


REST = {"torque": ["0", "0", "0"]}


def test_log_is_of_a_torque_that_spans_a_decade_too(simulate, opened):
    rest = opened(
        simulate(reference=REST, time={"duration": 30, "samples": 31}, controllers=["eqt"])
    )
    torques = [x for x in Paper(log=True).draw([rest]).axes if x.get_label() == "torque_norm"]
    assert {axes.get_yscale() for axes in torques} == {"log"}


@pytest.mark.parametrize(("focus", "laws", "titles"), [
    ([], ["eqt", "gt"], "EqT and GT"), (["asym"], ["asym"], "asym")
])  # fmt: skip
def test_bands_are_of_laws_in_focus_or_of_those_compared_first(
    focus, laws, titles, so3, opened, picture
):
    drawing = picture(Summary(focus=focus), opened(so3))
    for axes in drawing.axes:
        drawn = [shape.get_label() for shape in axes.collections]
        assert [label for label in drawn if label != NO_NUMBERS] == laws
    assert drawing.get_supxlabel().splitlines() == [
        "Thin dashes: threshold of settled.",
        f"Curves: median, quartiles of {titles}, 6 runs.",
    ]


def test_the_threshold_of_settled_is_where_the_error_is_drawn(so3, opened, altered, picture):
    def thresholds(drawing):
        return [
            float(shape.get_segments()[0][0, 1])
            for axes in drawing.axes
            for shape in axes.collections
            if shape.get_label() == NO_NUMBERS
        ]

    angle = np.degrees(2 * np.arcsin(0.05 / np.sqrt(8)))  # ‖I − R‖ = 2√2 sin(θ/2)
    assert thresholds(picture(Summary(), opened(so3))) == [pytest.approx(angle)]
    assert thresholds(picture(Summary(degrees=False), opened(so3))) == [pytest.approx(0.05)]
    far = altered(so3, pose_error=opened(so3)["pose_error"] + 1.0)
    assert not thresholds(Summary(log=True).draw([far]))


def test_laws_panels_and_times_are_chosen(so3, opened, picture):
    chosen = {"controllers": ["EqT", "asym"], "panels": ["lyapunov"], "start": 1.0, "end": 2.0}
    (panel,) = picture(Paper(**chosen), opened(so3)).axes
    assert [line.get_label() for line in panel.lines] == ["eqt", "asym"]
    assert panel.get_xlim() == (1.0, 2.0)
    result = opened(so3)
    within = (result.times >= 1 - 1e-9) & (result.times <= 2 + 1e-9)
    expected = result["lyapunov"][3].mean(axis=0)[within]
    np.testing.assert_array_equal(panel.lines[1].get_ydata(), expected)


@from_yaml
def test_what_cannot_be_chosen_is_said(options, message, so3, opened):
    assert says(error_of(Summary(**options).draw, [opened(so3)]), message.format(path=so3))


def test_linear_scales_begin_at_zero(so3, opened, picture):
    assert [axes.get_ylim()[0] for axes in picture(PRINT, opened(so3)).axes] == [0, 0, 0, 0]


def test_the_legend_shows_titles_of_laws_and_labels_of_all_others(
    odd_names, so3, opened, curve_names, picture
):
    laws = curve_names(picture(Summary(), opened(so3)))
    assert laws == ["EqT", "GT", "nog", "asym"]
    names = curve_names(picture(Summary(), opened(odd_names)))
    # In two columns, which are filled one after the other.
    assert [name.replace("\n", " ") for name in names] == [
        "_hidden",
        "5 \\$\\oops\\$",
        "g = $\\frac{1}{2}$",
        ("a long name " * 6).strip(),
    ]


@pytest.fixture
def legend(curve_names):
    return lambda results: curve_names(Summary().draw([results]))


def test_a_law_that_is_only_called_like_another_has_no_title(simulate, opened, legend):
    laws = [{"kind": "family", "label": "gt"}, {"kind": "gt", "label": "theirs"}, "eqt"]
    results = opened(simulate(controllers=laws, ensemble={"runs": 1, "seed": 1}))
    assert legend(results) == ["gt", "theirs", "EqT"]


def test_results_without_titles_take_those_of_laws_of_that_name(so3, opened, tmp_path, legend):
    results = opened(so3)
    attributes = {k: v for k, v in results.attributes.items() if k != "experiment"}
    variables, coordinates = (
        {n: Variable(results.dims(n), results[n], {"units": results.units(n)}) for n in names}
        for names in (results.names, results.coordinates)
    )
    write(tmp_path / "old.h5", Table(variables, coordinates, attributes))
    assert legend(opened(tmp_path / "old.h5")) == ["EqT", "GT", "nog", "asym"]


@pytest.mark.parametrize("chosen", [["nog"], ["nog", "eqt"]])
def test_chosen_controllers_keep_their_looks(chosen, so3, opened, picture):
    lines = picture(Summary(), opened(so3)).axes[0].lines
    every = dict(zip(["eqt", "gt", "nog", "asym"], lines, strict=True))
    drawing = picture(Summary(controllers=chosen), opened(so3))
    shown = [label for label in every if label in chosen]
    for label, line in zip(shown, drawing.axes[0].lines, strict=True):
        assert to_rgba(line.get_color()) == to_rgba(every[label].get_color())
        np.testing.assert_array_equal(line.get_ydata(), every[label].get_ydata())


def test_medians_within_their_quartiles_and_names_in_words(so3, opened, picture):
    results = opened(so3)
    drawing = picture(Summary(), results)
    axes = drawing.axes[0]
    # ‖I − R‖ = 2 √2 sin(θ/2) of a turn by θ
    angles = np.degrees(2 * np.arcsin(np.minimum(results["pose_error"][1] / np.sqrt(8), 1)))
    drawn = axes.lines[1].get_ydata()
    np.testing.assert_allclose(drawn, np.median(angles, axis=0), rtol=1e-6)
    corners = axes.collections[1].get_paths()[0].vertices
    found = np.unique(corners[np.isclose(corners[:, 0], 2.0)][:, 1])
    expected = np.quantile(angles[:, 20], [0.25, 0.75])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert axes.get_ylabel() == r"angle $(\mathrm{deg})$"
    titles = ["attitude error", "rate error", "torque", "Lyapunov function"]
    assert [axes.get_title() for axes in drawing.axes] == titles
    assert not any(axes.spines["top"].get_visible() for axes in drawing.axes)
    printed = picture(PRINT, results).axes
    assert [axes.get_title() for axes in printed] == [""] * 4
    assert all(axes.spines["top"].get_visible() for axes in printed)


def falling(results, low, decades):
    """An error of all runs that falls from 1 by so many decades, and is at `low` at the start."""
    values = np.broadcast_to(10.0 ** -np.linspace(0, decades, 41), results["pose_error"].shape)
    values = values.copy()
    values[..., 0] = low
    return values


@pytest.mark.parametrize(("decades", "scale"), [(1.9, "linear"), (2.1, "log")])
def test_a_scale_is_logarithmic_from_two_decades(decades, scale, so3, altered, opened):
    values = falling(opened(so3), 1.0, decades)
    for law in values:
        law *= 5.0
    axes, *_ = Summary(panels=["pose_error"]).draw([altered(so3, pose_error=values)]).axes
    assert axes.get_yscale() == scale


@pytest.mark.parametrize("low", [1e-105, 0.0])
def test_no_scale_reaches_a_sentinel(low, so3, altered, opened):
    values = falling(opened(so3), low, 3)
    for figure in (Summary(panels=["pose_error"], degrees=False), RunsFigure()):
        axes = figure.draw([altered(so3, pose_error=values)]).axes[0]
        assert axes.get_yscale() == "log"
        assert 1e-5 < axes.get_ylim()[0] <= 1e-3
        assert 1 < axes.get_ylim()[1] < 3


def test_a_scale_ends_at_the_error_of_the_solver(so3, altered, opened):
    results = opened(so3)  # whose tolerance is 1e-3, without an estimate

    def floor(**signals):
        figure = Summary(panels=list(signals), controllers=["eqt"])
        (axes,) = figure.draw([altered(so3, **signals)]).axes
        return axes.get_ylim()[0]

    angle = np.degrees(2 * np.arcsin(1e-3 / np.sqrt(8)))
    assert floor(pose_error=falling(results, 1.0, 9)) == pytest.approx(angle)
    assert floor(lyapunov=falling(results, 1.0, 9)) == pytest.approx(1e-6)
    assert floor(lyapunov=falling(results, 1e5, 18)) == pytest.approx(1e-4)  # rounding


def test_a_law_that_diverges_is_cut_off_and_named_in_the_panel(so3, altered, opened):
    values = falling(opened(so3), 1.0, 3)
    values[2] = 10.0 ** np.linspace(0, 7, 41)
    drawing = Summary(degrees=False).draw([altered(so3, pose_error=values)])
    first, second, *_ = drawing.axes
    assert first.get_ylim()[1] == pytest.approx(10.0)
    assert [text.get_text() for text in first.texts] == ["nog diverges"]
    assert not second.texts
    printed = Paper().draw([altered(so3, pose_error=values)])
    assert printed.axes[0].get_ylim()[1] < 2 * values[[0, 1, 3]].max()
    assert "Cut off where it leaves the reference: “nog”." in printed.get_supxlabel()
