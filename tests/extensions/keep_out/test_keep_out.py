"""Keep-out cones: their numbers by a plain program, remarks on the reference, what is no cone."""

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.base.option_types import Kind
from eqt_cli.config.remarks import remarks
from eqt_cli.extend import group_named
from eqt_cli.extensions.keep_out.between import straightened
from eqt_cli.loop.signals import metrics
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.quantity import WHOLE
from eqt_cli.results.result import open_result

pytestmark = pytest.mark.needs("keep_out")

TABLE = [[0, 1, 0, 0], [4, 0.5, 0.2, -0.8], [7, 0, 1, -1]]
CONES = {
    "constant": {"axis": [0, 0, 1], "at": [1, 0.1, 0.2], "angle": "40 deg"},
    "expressions": {"axis": [0, 0.6, 0.8], "at": ["cos(0.3*t)", "sin(0.3*t)", 3], "angle": 0.9},
    "table": {"axis": [1, 0, 0], "table": TABLE, "angle": "50 deg"},
}


def direction(name, t):
    if name == "constant":
        d = np.tile([1, 0.1, 0.2], (len(t), 1))
    elif name == "expressions":
        d = np.column_stack([np.cos(0.3 * t), np.sin(0.3 * t), 3 + 0 * t])
    else:
        times, *columns = np.transpose(TABLE)
        d = np.column_stack([np.interp(t, times, x) for x in columns])
    return d / np.linalg.norm(d, axis=1)[:, None]


def expected(name, t, Q):
    """Time inside and least margin, deg: angles by atan2, crossings on straight lines."""
    cone = metric(name).cones[0]
    axis, d = Q[..., :3, :3] @ np.array(cone.axis), direction(name, t)
    across = np.linalg.norm(np.cross(axis, d), axis=-1)
    angle = np.arctan2(across, np.einsum("rsk,sk->rs", axis, d)) - cone.angle
    inside = np.zeros(len(angle))
    for run, margins in enumerate(angle):
        for a, b, dt in zip(margins, margins[1:], np.diff(t), strict=False):
            low, high = min(a, b), max(a, b)
            inside[run] += dt * (high < 0 or (low < 0 and -low / (high - low)))
    return inside, np.degrees(angle.min(axis=1))


def metric(name, kind="keep_out_time"):
    read = Kind(metrics).read({"kind": kind, "cones": [CONES[name]]}, Problems(str))
    assert read
    return read


@pytest.mark.parametrize("name", CONES)
def test_numbers_are_those_of_a_plain_program(name):
    t, turns = np.linspace(0, 8, 4001), np.random.default_rng(3).normal(size=(3, 1, 3))
    Q = group_named("SO3").exp(turns * (t / 4)[:, None])
    time, margin = expected(name, t, Q)
    assert time.any()
    assert (time < 8).any()
    over = SampledRuns(t)
    # Lines of chords and of angles lie (2 ms · 1 rad/s)² / 8 = 5e-7 rad apart.
    np.testing.assert_allclose(metric(name).of(over, Q), time, rtol=0, atol=1e-5)
    least = metric(name, "keep_out_margin").of(over, Q)
    np.testing.assert_allclose(least, margin, rtol=0, atol=1e-4)


def test_lines_of_chords_pass_through_a_cone_between_two_samples():
    """About z, from 60° before the direction to 20° behind it in 8 s: 10° take 1 s by the arc."""
    cone = {"axis": [1, 0, 0], "at": [1, 0, 0], "angle": "10 deg"}
    t = np.linspace(0, 8, 202)  # none at the centre of the cone
    Q = group_named("SO3").exp(np.outer(np.radians(10 * t - 60), [0, 0, 1]))[None]
    time, margin = (
        Kind(metrics).read({"kind": kind, "cones": [cone]}, Problems(str)).of(SampledRuns(t), Q)
        for kind in ("keep_out_time", "keep_out_margin")
    )
    # A chord of 0.4° is 6e-6 rad away from its arc.
    assert time == pytest.approx(2.0, abs=1e-4)
    assert margin == pytest.approx(-10.0, abs=4e-4)


def test_lines_are_divided_until_they_are_straight():
    seen = []

    def lines(times):
        seen.append(times)
        return np.stack([np.cos(times), np.sin(40 * times) * (times < 1)], axis=-1)[None]

    rows = np.array([0.0, 3.0, 10.0])
    times = straightened(rows, 2, lines)
    assert seen[-1] is times
    assert np.isin(rows, times).all()
    smooth = times[times > 1.1]
    middle = (smooth[1:] + smooth[:-1]) / 2
    apart = np.abs(np.interp(middle, smooth, np.cos(smooth)) - np.cos(middle))
    assert apart.max() < 1.1e-6  # the second derivative is known at the ends of lines
    assert len(times) < 20_000  # 40 rad/s in the first second take 14,000


@pytest.mark.ci("compiles the metrics of six experiments")
@pytest.mark.filterwarnings("ignore::eqt_cli.base.errors.EqtWarning")  # the reference is inside
@pytest.mark.parametrize("name", CONES)
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_runs_have_these_numbers(name, engine, tmp_path):
    """They know what happens between rows, whatever `measure` says, and wherever rows are."""
    kinds = ("keep_out_time", "keep_out_margin")
    config = mapping(
        solver={"engine": engine, "rtol": 1e-8},
        ensemble={"runs": 12},
        time={"duration": 8, "samples": 5},
        metrics=[{"kind": kind, "cones": [CONES[name]]} for kind in kinds],
        measure={"start": 1},
    )
    fine = config | {"metrics": [], "time": {"duration": 8, "samples": 8001}}
    api.run(config | {"store": {"trajectories": "none"}}, tmp_path / "few")
    api.run(fine, tmp_path / "many")
    with open_result(tmp_path / "many") as many, open_result(tmp_path / "few") as few:
        found = expected(name, many["time"], many["pose"][0])
        for kind, values in zip(kinds, found, strict=True):
            # The least angle at samples, 1 ms apart, is some 1e-4 deg above that between them.
            np.testing.assert_allclose(few[kind][0], values, rtol=0, atol=1e-3)
            assert few.quantity(kind).window == WHOLE


@pytest.mark.parametrize(("axis", "at", "angle", "inside"), [
    ([0, 1, 0], [0, 1, 0], 1.5, None),  # a quarter turn about z takes it 90 deg away
    ([0, 1, 0], [0, 0, 1], 1.6, 1.6 - np.pi / 2),  # it stays 90 deg from z
    ([0, 1, 1], [0, 1, 1], 1.5, None),  # by half a turn, 90 deg away
    ([0, 1, 1], [0, 1, 1], 1.6, 1.6 - np.pi / 2),
    ([0, 0, 1], [0, 0, 1], 0.3, 0.3),
])  # fmt: skip
def test_of_an_axis_that_may_turn_the_best_turn_counts(axis, at, angle, inside):
    cones = {"kind": "keep_out_time", "cones": [{"axis": axis, "at": at, "angle": angle}]}
    point = {"kind": "point", "axis": [0, 0, 1], "at": [0, 0, 1]}
    config = mapping(metrics=[cones], task=point, controllers=["lee2010"])
    config.pop("reference")
    said = "\n".join(map(str, remarks(api.load_experiment(config).base)))
    assert ("the reference is inside" in said) is (inside is not None)
    assert inside is None or f"by up to {np.degrees(inside):.3g} deg" in said


def test_a_reference_that_enters_is_remarked_on():
    slew = {"kind": "slew", "to": {"rotvec": [0, "120 deg", 0]}, "duration": 4}
    cones = [{"axis": [0, 0, 1], "at": [1, 0, 0], "angle": "20 deg"}]
    config = mapping(
        reference=slew,
        metrics=[{"kind": "keep_out_time", "cones": cones}],
        time={"duration": 5, "samples": 51},
    )
    said = "\n".join(map(str, remarks(api.load_experiment(config).base)))
    assert "metrics[0].cones[0]: the reference is inside from" in said
    cones[0]["axis"] = [0, 1, 0]  # which the slew does not turn
    said = "\n".join(map(str, remarks(api.load_experiment(config).base)))
    assert "inside" not in said
    cones[0]["at"] = ["cos(t)", 0, 0]
    said = "\n".join(map(str, remarks(api.load_experiment(config).base)))
    assert "metrics[0].cones[0].at: the direction passes through 0 at 1.571 s" in said


@pytest.mark.parametrize(
    ("change", "place", "word"),
    [
        ({"at": None}, "cones[0]", "expected either at"),
        ({"table": TABLE}, "cones[0]", "expected either at"),
        ({"at": [0, 0, 0]}, "cones[0].at", "not all 0"),
        ({"at": [1, 0]}, "cones[0].at", "[x, y, z]"),
        ({"at": [1, 0, "cos(t"]}, "cones[0].at[2]", "cos(t"),
        ({"at": None, "table": [[0, 1, 0]]}, "cones[0].table[0]", "[t, x, y, z]"),
        ({"at": None, "table": TABLE[::-1]}, "cones[0].table[1]", "a time after 7 s"),
        ({"at": None, "table": [[0, 1, 2, 0], [2, -3, -6, 0]]}, "table[1]", "passes through 0"),
        ({"angle": 30}, "cones[0].angle", "without a unit is in rad"),
        ({"angle": "200 deg"}, "cones[0].angle", "less than 180 deg"),
        ({"angle": "20 s"}, "cones[0].angle", "an angle in"),
        ({"axis": [0, 0, 0]}, "cones[0].axis", "not all 0"),
        ({"sun": 1}, "cones[0].sun", "unknown"),
    ],
)
def test_what_is_no_cone_is_said_at_its_place(change, place, word):
    cone = {key: x for key, x in (CONES["constant"] | change).items() if x is not None}
    config = mapping(metrics=[{"kind": "keep_out_time", "cones": [cone]}])
    with pytest.raises(ConfigError) as refused:
        api.load_experiment(config)
    assert place in str(refused.value)
    assert word in str(refused.value)
