"""The figure of an estimate, and its error behind single runs."""

import numpy as np
import pytest
from said import error_of, says
from scipy.stats import chi2

from eqt_cli.extend import EstimateFigure, RunsFigure

pytestmark = pytest.mark.usefixtures("unarranged")

FLIES = {
    "controllers": ["eqt", "gt"],
    "control": {"period": 0.2},
    "sensors": {
        "pose": [{"kind": "noise", "std": 0.1, "period": 0.4}],
        "velocity": [{"kind": "noise", "std": 0.1}, {"kind": "bias", "value": 0.1}],
    },
    "time": {"duration": 2.0, "samples": 11},
}


@pytest.fixture
def filtered(simulate, opened):
    return opened(simulate(**FLIES, estimator={"kind": "invariant"}))


def band_of(axes, name):
    (found,) = (each for each in axes.collections if each.get_label() == name)
    return found.get_paths()[0].vertices


def test_errors_lie_in_three_deviations_and_nees_in_the_limits_of_chi_squared(filtered):
    drawing = EstimateFigure(run=2).draw([filtered])
    axes = {panel.get_label(): panel for panel in drawing.axes}
    for row, kind in (("rotation error", "pose"), ("bias error", "bias")):
        panel = axes[f"{'rotation bias' if kind == 'bias' else row} gt"]
        for k, line in enumerate(panel.lines):
            expected = filtered[f"{kind}_estimate_error"][1, 2, :, k]
            np.testing.assert_array_equal(line.get_ydata(), expected)
        edges = band_of(panel, "3σ")
        widest = 3 * filtered[f"{kind}_estimate_std"][1, 2].max(axis=-1)
        for time, reach in zip(filtered["time"], widest, strict=True):
            found = edges[edges[:, 0] == time, 1]
            assert (found.min(), found.max()) == pytest.approx((-reach, reach))
    own, mean = axes["NEES gt"].lines
    np.testing.assert_array_equal(own.get_ydata(), filtered["nees"][1, 2])
    np.testing.assert_array_equal(mean.get_ydata(), filtered["nees"][1].mean(axis=0))
    one, of_mean = axes["NEES gt"].patches
    limits = [(each.get_y(), each.get_y() + each.get_height()) for each in (one, of_mean)]
    assert limits[0] == pytest.approx(chi2.ppf([0.025, 0.975], 6))
    assert limits[1] == pytest.approx(chi2.ppf([0.025, 0.975], 6 * 6) / 6)
    assert drawing.get_supxlabel().endswith("Run 2, and means over 6 runs.")


def test_without_a_covariance_there_are_errors_only(filtered, simulate, opened, curve_names):
    """Beside a filter that has one, whose panels are below."""
    few = FLIES | {"controllers": ["eqt"], "estimator": {"kind": "complementary"}}
    other = opened(simulate(**few, name="other"))
    drawing = EstimateFigure(controllers=["eqt"]).draw([other])
    assert [panel.get_label() for panel in drawing.axes] == [
        "rotation error eqt",
        "rotation bias eqt",
    ]
    assert not any(panel.collections for panel in drawing.axes)
    assert len(curve_names(drawing)) == 3
    both = EstimateFigure(controllers=["eqt"]).draw([filtered, other])
    judged = [label for panel in both.axes if (label := panel.get_label()).startswith("NEES")]
    assert len(both.axes) == 5 and len(judged) == 1


def test_a_law_that_reads_measurements_has_no_estimate(simulate, opened):
    brief = {"controllers": ["eqt"], "time": {"duration": 0.2, "samples": 2}}
    result = opened(simulate(**FLIES | brief))
    assert says(
        error_of(EstimateFigure().draw, [result]).removeprefix(str(result.path)),
        ": figure 'estimate' finds no estimate, since…",
    )


def test_the_error_of_the_estimate_is_shaded_behind_single_runs(filtered, curve_names):
    drawing = RunsFigure().draw([filtered])
    error = filtered["estimate_error"].mean(axis=1)
    for k, panel in enumerate(drawing.axes):
        assert band_of(panel, "estimate")[:, 1].max() == pytest.approx(error[k].max())
    assert "mean error of the estimate" in curve_names(drawing)
    degrees = RunsFigure(degrees=True).draw([filtered]).axes[0]
    turn = np.degrees(2 * np.arcsin(filtered["estimate_error"][0] / (2 * np.sqrt(2))))
    top = band_of(degrees, "estimate")[:, 1].max()
    assert top == pytest.approx(turn.mean(axis=0).max())
    assert not RunsFigure(signal="torque_norm").draw([filtered]).axes[0].collections
