"""Keys that follow from swept names, and points that do not count."""

import json
import math

import numpy as np
import pytest
from case_tables import from_yaml, in_ci
from faults_harness import contents
from said import error_of, says
from small_experiment import configuration, study_of

from eqt_cli.api import run
from eqt_cli.config.study import at_point
from eqt_cli.results.result import open_result

FOLLOWS = "{set: {zeta: 0.7, gains.kp: 'inertia[0]*w**2', gains.kd: '2*zeta*inertia[0]*w'}}"


def study_with(folder, *entries, grids=(), **changes):
    sweep = f"[{', '.join(entries)}]"
    return study_of(folder, configuration(sweep=sweep, **changes), grids=grids)


def gains(study, point):
    own = study.experiment(point).config.gains
    return own.kp, own.kd


@pytest.mark.parametrize(
    ("design", "widths"),
    [
        ("{grid: {w: [0.5, 2]}}", [0.5, 2]),
        ("{grid: {w: {low: 1, high: 3, points: 2}}}", [1, 3]),
        ("{zip: {w: [0.5, 2], initial.pose: [haar, identity]}}", [0.5, 2]),
        ("{concat: [{grid: {w: [1]}}, {grid: {w: [3]}}]}", [1, 3]),
        ("{grid: {w: [30 rpm, 1 Hz]}}", [math.pi, 1.0]),
        ("{random: {points: 2, seed: 3, axes: {w: {low: 1, high: 2}}}}", None),
        in_ci("imports scipy.stats", "{lhs: {points: 2, axes: {w: {low: 1, high: 2}}}}", None),
        in_ci("imports scipy.stats", "{sobol: {points: 2, axes: {w: {values: [1, 2]}}}}", None),
    ],
)
def test_keys_follow_in_every_design(tmp_path, design, widths):
    study = study_with(tmp_path, design, FOLLOWS)
    widths = widths or [study.sweep.point(k)["w"] for k in range(2)]
    for point, w in enumerate(widths):
        # By hand, in doubles: the inertia's first number is 2.
        assert gains(study, point) == (pytest.approx(2 * w**2), pytest.approx(2.8 * w))


def test_a_case_changes_what_a_formula_reads(tmp_path):
    cases = "{cases: {light: {inertia: [1, 1, 1]}, heavy: {inertia: [2 kg m^2, 1, 3]}, same: {}}}"
    study = study_with(tmp_path, "{grid: {w: [2]}}", cases, FOLLOWS)
    assert [gains(study, k)[0] for k in range(3)] == [4, 8, 8]


def test_units_and_lists_follow(tmp_path):
    follows = "{set: {inertia: [J, J, '2*J'], control.period: '(20/w) ms', control.delay: w}}"
    study = study_with(
        tmp_path, "{grid: {J: [1], w: [1, 2]}}", follows, controllers="[lee2010]", control="{}"
    )
    control = study.experiment(1).config.control
    assert (control.period, control.delay) == (pytest.approx(0.01), 2)
    assert study.experiment(0).resolved["inertia"] == [1, 1, 2]


def test_formulas_in_time_keep_t_and_take_the_other_numbers(tmp_path):
    """The reference of each point is that of its name, of the time and of a key."""
    factors = "[{axis: [1, 0, 0], by: t}, {axis: [0, 0, 1], by: '0'}]"
    follows = "{set: {'reference.factors[0].by': 'A*sin(2*t) - A/2 + inertia[0]*t*A*1e-2'}}"
    study = study_with(
        tmp_path,
        "{grid: {A: [0.5, -1.5]}}",
        follows,
        reference=f"{{kind: path, factors: {factors}}}",
    )
    for point, A in enumerate((0.5, -1.5)):
        shown = study.experiment(point).reference_over_horizon()
        t = shown.times
        angle = A * np.sin(2 * t) - A / 2 + 2 * t * A * 1e-2  # the inertia's first number is 2
        assert np.abs(shown.pose[:, 2, 1] - np.sin(angle)).max() < 1e-14


def test_a_grid_of_the_command_line_has_names_too(tmp_path):
    study = study_with(tmp_path, FOLLOWS, grids=["w=1,2,4"])
    assert [gains(study, k)[0] for k in range(3)] == [2, 8, 32]
    assert study.sweep.place(0, "gains.kp") == (0, "set", "gains.kp")
    assert study.sweep.place(1, "w") == (1, "grid", "w", 1)


def test_points_at_which_a_condition_does_not_hold_are_dropped(tmp_path):
    grid = "{grid: {gains.kp: [0.5, 1, 2], gains.kd: [0.5, 1, 2]}}"
    study = study_with(tmp_path, grid, "{where: 'gains.kd**2 >= gains.kp'}")
    pairs = [(kp, kd) for kp in (0.5, 1, 2) for kd in (0.5, 1, 2) if kd**2 >= kp]
    assert [tuple(study.sweep.point(k).values()) for k in range(len(study))] == pairs
    assert [gains(study, k) for k in range(len(study))] == pairs
    assert study.sweep.rules.dropped == 9 - len(pairs)
    again = study_with(tmp_path, grid, "{where: ['gains.kp <= gains.kd**2', 'gains.kp < 2']}")
    assert len(again) == sum(kp < 2 for kp, _ in pairs)
    assert again.digest != study.digest


def test_points_by_number_are_counted_in_what_is_left(tmp_path):
    grid = "{grid: {gains.kp: [1, 2, 3, 4, 5]}}"
    study = study_with(tmp_path, grid, "{where: 'gains.kp > 1'}", "{points: '0,2:4'}")
    assert [gains(study, k)[0] for k in range(len(study))] == [2, 4, 5]


@pytest.mark.ci("runs two sweeps")
def test_results_hold_names_and_what_follows_and_speak_of_names(tmp_path, invoke):
    study = study_with(tmp_path, "{grid: {w: [1, 2]}}", FOLLOWS, "{where: w < 3}")
    done = run(study, tmp_path / "r")
    with open_result(done) as result:
        assert [key.key for key in result.swept_keys] == ["w"]
        assert result.point_name(1) == "w 2"
        assert result.coordinate("gains.kp").tolist() == [2, 8]
        assert result.attributes_of("gains.kp")["formula"] == "inertia[0]*w**2"
    # By hand, the same gains give the same runs.
    pairs = "{zip: {gains.kp: [2, 8], gains.kd: [2.8, 5.6]}}"
    byhand = contents(run(study_with(tmp_path, pairs), tmp_path / "byhand").path)
    ours = contents(done.path)
    assert all(ours[name].tobytes() == byhand[name].tobytes() for name in ("pose", "effort"))
    plan = json.loads(invoke("sweep", done.path, "--dry-run", "--json").stdout)
    assert plan["dropped"] == 0 and plan["first"][1]["gains.kp"] == 8
    text = invoke("sweep", done.path, "--dry-run", "--where", "w>1").stdout
    assert "dropped  1 of 2 points, where: w < 3, where: w>1" in text


@from_yaml
def test_what_is_wrong_is_said_at_its_place(tmp_path, sweep, said):
    text = configuration(sweep=f"[{sweep}]", control="{period: 0.1}")
    assert says(error_of(study_of, tmp_path, text), f"{tmp_path}/config.yaml:{said}")


@from_yaml
def test_what_is_wrong_in_a_search_is_said_at_its_place(tmp_path, tune, said):
    from eqt_cli.config.document import read_config
    from eqt_cli.extensions.search.tune import Search

    path = tmp_path / "config.yaml"
    path.write_text(configuration(tune=tune))
    assert says(error_of(Search.read, read_config(path)), f"{path}:{said}")


def test_a_search_over_a_name_writes_what_follows(tmp_path):
    from eqt_cli.config.document import read_config
    from eqt_cli.extensions.search.search import swept
    from eqt_cli.extensions.search.tune import Search

    path = tmp_path / "config.yaml"
    follows = "set: {J: 'inertia[0]', gains.kp: 'J*w**2', 'controllers[1].gains.kd': 'v'}"
    over = "over: {w: [0.5, 2], v: [1, 2]}, objective: effort"
    tuned = f"{{{over}, {follows}}}"
    path.write_text(configuration(controllers="[eqt, {kind: gt, gains: {kd: 1}}]", tune=tuned))
    eqt, gt = Search.read(read_config(path)).laws
    assert list(eqt.axes) == ["w"] and sorted(gt.axes) == ["v", "w"]
    assert eqt.at({"w": 2}).data["gains"] == {"kp": 8, "kd": 0.5}
    assert gt.at({"w": 1, "v": 1.5}).data["gains"] == {"kp": 2, "kd": 1.5}
    assert swept(gt, {"w": [1], "v": [2]}).data["sweep"][1]["set"].keys() == {
        *("J", "gains.kp", "gains.kd")
    }


def test_a_part_of_a_sweep_keeps_its_formulas(tmp_path):
    shapes = "{zip: {time.samples: [6, 4, 6]}}"
    study = study_with(tmp_path, shapes, "{grid: {w: [1, 2]}}", FOLLOWS, "{points: '1:6'}")
    assert study.is_ragged and [list(points) for points in study.shapes] == [[0, 3, 4], [1, 2]]
    piece = study.piece(1)
    assert [gains(piece, k) for k in range(2)] == [gains(study, k) for k in (1, 2)]
    assert at_point(piece.document, piece.sweep, 1).data["gains"]["kp"] == 8
