"""The figure of a recording beside a run: curves, gaps, the clock, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from case_tables import from_yaml
from said import says

from eqt_cli.api.loading import open_at
from eqt_cli.extend import EqtError, group_named
from eqt_cli.extensions.flights.figures import MeasuredFigure
from eqt_cli.extensions.logs.recording_check import Recording
from eqt_cli.figures.render import curves
from eqt_cli.figures.style import Style, house_style

pytestmark = pytest.mark.usefixtures("unarranged")

OFFSET = 0.137


@pytest.fixture
def result(paper_result):
    with open_at(paper_result) as opened:
        yield opened


@pytest.fixture
def recording(result):
    """Run 2 of GT between its samples, with a gap, by another clock."""
    from eqt_cli.extensions.flights.measured import Course

    k = result.labels.index("gt")
    states = [result.trajectory(name, 2)[k] for name in ("pose", "velocity", "torque")]
    times = np.arange(0.5, 12.0, 0.07)
    times = times[(times < 4) | (times > 5)]
    found = Course(group_named(result.group_name), result.times, *states).at(times)
    gaps = np.flatnonzero(np.diff(times) > 0.5)
    shown = found.pose, found.velocity, found.wrench
    return Recording(
        "log.csv", "log.csv:1", group_named(result.group_name), times - OFFSET, *shown, gaps
    )


def drawn(result, recording, **options):
    figure = MeasuredFigure(**({"controllers": ["GT"], "run": 2} | options))
    return figure.draw([result], "page", measured=recording)


def test_measured_curves_lie_on_those_of_their_run(result, recording):
    drawing = drawn(result, recording)
    found = {(one.panel, one.name): one for one in curves(drawing)}
    rows = ("pose", "error", "difference", "velocity", "wrench")
    panels = [f"{row} rotation" for row in rows]
    assert list(dict.fromkeys(panel for panel, _ in found)) == panels
    for axis in ("ωx", "ωy", "ωz"):  # the noise of a recording without noise is its interpolation
        assert np.nanmax(np.abs(found["difference rotation", f"difference {axis}"].y)) < 1e-3
    panels.remove("difference rotation")
    for panel in panels:
        for axis in ("ωx", "ωy", "ωz"):
            lines = {
                line.get_label(): line
                for axes in drawing.axes
                for line in axes.lines
                if axes.get_label() == panel
            }
            measured, simulated = lines[f"measured {axis}"], lines[f"simulated {axis}"]
            t, y = measured.get_data()
            real = np.isfinite(y)
            there = np.interp(t[real], *simulated.get_data())
            scale = np.abs(simulated.get_ydata()).max()
            # What is drawn of the run are lines between samples 0.1 s apart.
            np.testing.assert_allclose(y[real], there, rtol=0, atol=0.02 * scale)
            # A gap is left empty.
            assert np.isnan(y).sum() == 1
            assert not ((t[real] > 4.01) & (t[real] < 4.99)).any()


def test_recorded_coordinates_differ_under_a_style_of_two_colours(result, recording, tmp_path):
    sheet = tmp_path / "two.mplstyle"
    sheet.write_text('axes.prop_cycle: cycler(color=["k", "r"])\n', encoding="utf-8")
    with house_style(Style((str(sheet),))):
        panel = drawn(result, recording).axes[0]
    recorded = [line for line in panel.lines if line.get_label().startswith("measured")]
    assert len({(line.get_color(), line.get_linestyle()) for line in recorded}) == 3


def test_what_was_not_measured_has_no_panels(result, recording):
    none = np.full(recording.velocities.shape, np.nan)
    drawing = drawn(result, replace(recording, wrenches=none, velocities=none))
    assert [axes.get_label() for axes in drawing.axes] == [
        f"{row} rotation" for row in ("pose", "error", "difference")
    ]


def test_degrees(result, recording):
    plain, degrees = (
        {(one.panel, one.name): one for one in curves(drawn(result, recording, degrees=on))}
        for on in (False, True)
    )
    key = "velocity rotation", "measured ωx"
    np.testing.assert_allclose(degrees[key].y, np.degrees(plain[key].y))
    assert degrees[key].up.endswith("(deg/s)")


def test_what_is_shown_is_said(result, recording, paper_result):
    text = drawn(result, recording).get_supxlabel().replace("\n", " ")
    assert text.startswith(
        "Lines: GT, run 2. Tints: log.csv: 150 rows from 0.5 to 11.98 s of run 2, 1 gap; "
    )
    assert "clock offset +0.137" in text
    assert text.endswith(" of GT; correlation 1.000.")


@from_yaml
def test_what_it_refuses(options, given, said, result, recording, paper_result):
    with pytest.raises(EqtError) as caught:
        drawn(result, recording if given else None, **options)
    assert says(str(caught.value).replace(str(paper_result), "RESULT"), said)
