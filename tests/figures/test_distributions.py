"""The figure of metrics over runs: what the boxes and the distribution functions say."""

import numpy as np
import pytest

from eqt_cli.extend import Distributions, EqtError
from eqt_cli.figures import comparison_figures
from eqt_cli.figures.render import curves, encode
from eqt_cli.figures.shown import MetricValues

pytestmark = pytest.mark.usefixtures("unarranged")


@pytest.fixture
def unsettled(so3, altered, opened):
    """Settling times: all of EqT's runs settle, none of GT's and asym's, four of nog's six."""
    times = np.tile(np.linspace(0.5, 3, 6), (4, 1))
    times[1] = np.nan
    times[2, [1, 4]] = np.nan
    times[3] = np.nan
    return altered(so3, settling_time=times)


def drawn(drawing):
    """Every curve, by panel and name."""
    return {(c.panel, c.name): c for c in curves(drawing)}


def test_boxes_are_quantiles_and_means(so3, opened, picture):
    results = opened(so3)
    found = drawn(picture(Distributions(), results))
    for row, controller in enumerate(results["controller"]):
        effort = results["effort"][row]
        low, lower, median, upper, high = np.quantile(effort, [0.1, 0.25, 0.5, 0.75, 0.9])

        def across(part, controller=controller):
            return found["effort", f"{part} {controller}"].x

        np.testing.assert_allclose(across("whiskers"), [low, lower, np.nan, upper, high])
        np.testing.assert_allclose(across("quartiles"), [upper, lower, lower, upper, upper])
        np.testing.assert_allclose(across("median"), median)
        np.testing.assert_allclose(across("mean"), effort.mean())
        np.testing.assert_array_equal(across("runs"), effort)


def test_of_many_runs_only_the_extremes_are_points(so3, opened, monkeypatch):
    monkeypatch.setattr(comparison_figures, "MOST_POINTS", 5)
    results = opened(so3)
    drawing = Distributions().draw([results])
    extremes = drawn(drawing)["effort", "extremes gt"].x
    np.testing.assert_array_equal(
        extremes, [results["effort"][1].min(), results["effort"][1].max()]
    )
    texts = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert texts == ["quartiles, median", "mean", "10–90 %", "extremes"]  # by columns


def test_controllers_are_named_beside_the_boxes_of_the_first_column(so3, opened, picture):
    drawing = picture(Distributions(), opened(so3))
    left, right, *_ = drawing.axes
    assert [text.get_text() for text in left.get_yticklabels()] == ["EqT", "GT", "nog", "asym"]
    assert not any(text.get_visible() for text in right.get_yticklabels())


def test_defaults_are_those_that_the_result_holds(so3, altered, opened):
    drawing = Distributions().draw([altered(so3, peak_torque=None)])
    shown = [axes.get_label() for axes in drawing.axes]
    assert shown == ["mean_attitude_error", "early_torque", "effort"]
    # A panel in which nothing could be drawn is left out.
    assert not np.isfinite(opened(so3)["settling_time"]).any()
    assert "No run has a settling time." in drawing.get_supxlabel()


@pytest.mark.ci("computes a result of its own")
def test_trajectories_are_not_needed(so3, altered, opened):
    over_time = [v for v in opened(so3).names if "time" in opened(so3).dims(v)]
    without = altered(so3, **dict.fromkeys(over_time))
    figure = Distributions(metrics=["effort", "settling_time"])
    expected = encode(figure.draw([opened(so3)]), "svg")
    assert encode(figure.draw([without]), "svg") == expected


def test_labels_name_unit_and_window(so3, opened, picture):
    results = opened(so3)
    metrics = ["effort", "early_torque", "mean_pose_error", "settling_time", "steps"]
    drawing = picture(Distributions(metrics=metrics), results)
    assert [axes.get_xlabel() for axes in drawing.axes] == [
        r"effort $[\mathrm{(N\,m)^{2}\,s}]$",
        r"mean $\|\tau\|$ $(\mathrm{N\,m})$, first 5 s",
        r"mean $\|I - Q_{\mathrm{E}}\|_{\mathrm{F}}$",
        r"settling time $(\mathrm{s})$",
        "work of the solver, as its\nengine counts it",
    ]
    assert results.long_name("early_torque").endswith("first 5 s")


def test_what_reaches_beyond_the_end_is_open_and_counted(unsettled):
    drawing = Distributions(metrics=["settling_time"]).draw([unsettled])
    (axes,) = drawing.axes
    found = {c.name: c for c in curves(drawing)}
    # Of nog's six runs four settled, at 0.5, 1.5, 2 and 3 s: the median is between 2 and 3 s, and
    # the upper quartile is not known.
    np.testing.assert_allclose(found["median nog"].x, 2.5)
    np.testing.assert_allclose(found["quartiles nog"].x, [4, 1.625, 1.625, 4])
    np.testing.assert_allclose(found["ends nog"].x, [1.0, np.nan])
    assert "mean nog" not in found and "mean eqt" in found
    assert not {"quartiles gt", "median gt", "mean gt"} & set(found)
    assert axes.get_xlim()[1] == 4
    assert axes.get_title(loc="right") == "not settled of 6"
    assert [text.get_text() for text in axes.texts] == ["0", "6", "2", "6"]


def test_where_no_run_had_settled_the_scale_is_that_of_the_runs(so3, altered, opened):
    never = np.full((4, 6), np.nan)
    drawing = Distributions(metrics=["settling_time"]).draw([altered(so3, settling_time=never)])
    assert drawing.axes[0].get_xlim() == (0, 4)
    assert [text.get_text() for text in drawing.axes[0].texts] == ["6"] * 4


def test_distribution_functions_end_below_1_where_runs_had_not_settled(unsettled):
    drawing = Distributions(kind="ecdf", metrics=["settling_time"]).draw([unsettled])
    (axes,) = drawing.axes
    eqt, gt, nog, _ = axes.lines
    np.testing.assert_allclose(eqt.get_ydata(), [0, 1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6, 1])
    np.testing.assert_allclose(gt.get_data(), [[4], [0]])
    np.testing.assert_allclose(nog.get_xdata(), [0.5, 0.5, 1.5, 2, 3, 4])
    np.testing.assert_allclose(nog.get_ydata(), [0, 1 / 6, 2 / 6, 3 / 6, 4 / 6, 4 / 6])
    assert axes.get_title(loc="right") == "not settled: 0, 6, 2, 6 of 6"


def test_distribution_functions_of_many_runs_have_few_steps(so3, opened, monkeypatch):
    monkeypatch.setattr(comparison_figures, "MOST_STEPS", 3)
    results = opened(so3)
    line = Distributions(kind="ecdf", metrics=["effort"]).draw([results]).axes[0].lines[0]
    effort = np.sort(results["effort"][0])
    np.testing.assert_array_equal(line.get_xdata(), effort[[0, 0, 3, 5]])
    np.testing.assert_allclose(line.get_ydata(), [0, 1 / 6, 4 / 6, 1])


def test_runs_of_several_results_are_counted_by_result(so3, simulate, opened, picture):
    other = simulate(name="fewer", ensemble={"runs": 3, "seed": 2}, controllers=["gt"])
    metrics = ["settling_time"]
    drawing = picture(
        Distributions(controllers=["gt"], metrics=metrics), opened(so3), opened(other)
    )
    (axes,) = drawing.axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["GT, small", "GT, fewer"]
    assert axes.get_title(loc="right") == "not settled"
    assert [text.get_text() for text in axes.texts] == ["6/6", "3/3"]


def test_more_than_six_laws_share_no_panel(so3, opened, monkeypatch):
    monkeypatch.setattr(comparison_figures, "MOST_COLOURS", 2)
    drawing = Distributions(kind="ecdf").draw([opened(so3)])
    assert {len(axes.lines) for axes in drawing.axes} == {2}
    assert "The first 2 laws; no room for “nog”, “asym”." in drawing.get_supxlabel()
    captions = []
    drawing = Distributions(kind="ecdf").draw([opened(so3)], captions=captions)
    assert drawing.get_supxlabel() == "6 runs, first 2 of 4 laws"


def test_runs_that_are_alike_have_no_distribution(so3, altered, opened):
    results = opened(so3)
    stored = filter(results.has, results.metrics)
    first = {name: results[name][:, :1] + 0 * results[name] for name in stored}
    for name in ("initial_pose", "initial_velocity"):
        first[name] = results[name][:1] + 0 * results[name]
    with pytest.raises(EqtError, match="shows how runs differ, and here all runs of a law are al"):
        Distributions().draw([altered(so3, **first)])


def test_a_value_that_is_missing_is_remarked_on(so3, altered, opened):
    effort = opened(so3)["effort"]
    effort[0, 2] = np.nan
    drawing = Distributions(metrics=["effort"]).draw([altered(so3, effort=effort)])
    assert "EqT: 1 of 6 runs have no effort; left out." in drawing.get_supxlabel()
    mean = drawn(drawing)["effort", "mean eqt"].x
    np.testing.assert_allclose(mean, np.nanmean(effort[0]))


def test_logarithmic_scales_have_numbers_within_a_decade(so3, altered, opened):
    effort = opened(so3)["effort"] * 0 + np.linspace(20, 90, 6)
    drawing = Distributions(metrics=["effort"], log=True).draw([altered(so3, effort=effort)])
    (axes,) = drawing.axes
    assert axes.get_xscale() == "log"
    texts = [text.get_text() for text in axes.get_xticklabels()]
    assert {"40", "60", "80"} <= set(texts)


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("efort", "finds no metric 'efort'; did you mean 'effort'?"),
        ("lyapunov", "finds no metric 'lyapunov'; there are: mean_torque, effort, peak_torque, "),
    ],
)
def test_unknown_metrics_are_refused(name, end, so3, opened):
    with pytest.raises(EqtError) as caught:
        Distributions(metrics=[name]).draw([opened(so3)])
    assert str(caught.value).startswith(f"{so3}: figure 'distributions' {end}")


def test_a_result_without_any_of_the_metrics_says_so(so3, altered):
    first = ("mean_attitude_error", "mean_pose_error", "early_torque")
    others = ("effort", "peak_torque", "settling_time")
    without = altered(so3, **dict.fromkeys((*first, *others)))
    with pytest.raises(EqtError) as caught:
        Distributions().draw([without])
    assert str(caught.value).endswith(
        "figure 'distributions' finds none of the metrics effort, peak_torque, settling_time; "
        "choose others with the option 'metrics'"
    )


@pytest.mark.parametrize("unsettled", [0, 1, 3, 9, 10])
def test_quantiles_are_numpys_as_far_as_they_are_known(unsettled):
    values = np.random.default_rng(1).permutation(np.arange(10.0) ** 2)
    levels = [0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0]
    censored = np.where(np.argsort(np.argsort(values)) >= 10 - unsettled, np.inf, values)
    found = MetricValues(censored).quantiles(levels)
    # Rank 9·level is known if both of its neighbours are.
    known = np.ceil(9 * np.array(levels)) < 10 - unsettled
    np.testing.assert_allclose(found[known], np.quantile(values, levels)[known])
    assert np.isinf(found[~known]).all()
