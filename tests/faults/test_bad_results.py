"""What mutation has found, each case by itself: one message that says the place and the bound."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from said import said_of
from small_experiment import configuration

COMMON = {
    "controllers": "[eqt]",
    "ensemble": "{runs: 2, seed: 1}",
    "time": "{duration: 1.0, samples: 5}",
    "solver": "{rtol: 1.0e-3, cross_check: 1}",
}
LONG = "a" * 1000
CONFIGURATIONS = said_of(r"""
ensemble: {runs: 1000000000000} →
    ensemble.runs: expected a number of at most 100,000,000, got 1000000000000
time: {duration: 1.0, samples: 1099511627776} →
    time.samples: expected a number of at most 10,000,000, got 1099511627776
sweep: [{sobol: {points: 1099511627776, axes: {gains.kp: {low: 1, high: 2}}}}] →
    sweep[0].sobol.points: expected a number of at most 10,000,000, got 1099511627776
sweep: [{zip: {gains.kp: {low: 1, high: 2, points: 1000000000000000000}}}] →
    sweep[0].zip.gains.kp.points: expected a number of at most 10,000,000, got 1000000000000000000
group: R9*R9*R9*R9*R9*R9*R9*R9 →
    group: group 'R9*…': its 8 factors have more than 64 axes, so the numbers of
inertia: [[1, 1.0e+200, 0], [1.0e+200, 1, 0], [0, 0, 1.0e-200]] →
    inertia: expected the largest entry to be from 1e-100 to 1e+100, got 1e+200; choose other units
inertia: 1.0e-300 →
    inertia: expected the largest entry to be from 1e-100 to 1e+100, got 1e-300; choose other units
rigid: 0 → rigid: expected true or false, got 0
initial: {file: "a\0b"} → initial.file: a\x00b: cannot be read: embedded null byte
sweep: [{grid: {gains.kp: &x {low: 1, high: 2, points: 10000000}, gains.kd: *x}}] →
    sweep[0].grid: has 100,000,000,000,000 points; expected at most 10,000,000
sweep: [{grid: {gains.kp: &x {low: 1, high: 2, points: 10000000}}}, {grid: {gains.kd: *x}}] →
    sweep: has 100,000,000,000,000 points; expected at most 10,000,000
""") | {
    f"initial: {{file: {LONG}}}": f"initial.file: {LONG}: cannot be read: file name too long",
    f"group: {'*'.join(['SO3'] * 600)}": (
        "group: group 'SO3*…': its 600 factors have more than 64 axes, so the numbers of"
    ),
}
"""With large numbers, and with long names."""


def written(**changes):
    Path("c.yaml").write_text(configuration(**COMMON | changes), encoding="utf-8")


@pytest.mark.parametrize("line", CONFIGURATIONS, ids=lambda line: line[:60])
def test_a_configuration_is_refused(folder, invoke, line):
    section, _, value = line.partition(": ")
    written(**{section: value})
    said = invoke("config", "check", "c.yaml", code=2).stderr
    assert CONFIGURATIONS[line] in said
    heading, *rest = said.splitlines()
    assert (heading, len(rest)) == ("1 error in c.yaml", 1)


@pytest.mark.parametrize("command", ["run", "sweep"])
def test_too_many_runs_are_refused_before_they_are_planned(folder, invoke, command):
    more = {"run": [], "sweep": ["--grid", "gains.kp=1,2", "--dry-run"]}[command]
    written(ensemble="{runs: 1000000000000}")
    said = invoke(command, "c.yaml", *more, code=2).stderr
    assert "ensemble.runs: expected a number of at most 100,000,000" in said


def test_a_grid_is_not_added_to_what_is_no_list(folder, invoke):
    written(sweep="5")
    said = invoke("sweep", "c.yaml", "--grid", "gains.kp=1,2", code=2).stderr
    assert said == (
        "1 error in c.yaml\n"
        "c.yaml:10:1: sweep: expected a list of blocks such as {grid: {gains.kp: [1, 2]}}, "
        "got 5\n"
    )


def test_a_reference_that_ends_with_the_horizon_is_fine(folder, invoke):
    written(
        reference="{kind: slew, to: {euler: {sequence: ZYX, angles: [0.5, 0, 0]}}, duration: 1}"
    )
    invoke("config", "check", "c.yaml")


def test_a_reference_is_followed_for_a_bounded_time(folder, invoke):
    written(reference='{torque: ["cos(t)", "sin(t)", "0"], velocity: [1.0e+6, 1.0e+6, 1]}')
    assert "evaluations" in invoke("config", "check", "c.yaml").stdout


# Results ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good(tmp_path_factory, invoke):
    place = tmp_path_factory.mktemp("good")
    config = place / "c.yaml"
    config.write_text(configuration(**COMMON), encoding="utf-8")
    invoke("run", config, "--out", place / "out")
    return (place / "out/results.h5").read_bytes()


@pytest.fixture
def result(good, tmp_path):
    path = tmp_path / "results.h5"
    path.write_bytes(good)
    return path


def refused(invoke, path, command, reason):
    said = invoke(command, path, code=2)
    again = "eqt writes no such file: copy it again or run the experiment again"
    assert said.stderr == f"eqt: {path}: refused: {reason}; {again}\n"
    assert said.stdout == ""


@pytest.mark.parametrize(
    ("name", "command"),
    [
        *((name, "show") for name in ("bound", "difference", "method", "runs")),
        *(("runs", command) for command in ("compare", "plot", "report", "verify")),
    ],
)
def test_a_cross_check_that_is_not_whole(result, invoke, name, command):
    with h5py.File(result, "a") as file:
        del file.attrs[f"cross_check_{name}"]
    refused(invoke, result, command, f"it lacks the attribute 'cross_check_{name}'")


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("cross_check_bound", "x", "a number"),
        ("cross_check_difference", "", "a number"),
        ("cross_check_method", 3, "text"),
        ("cross_check_runs", 1.5, "a whole number of at least 0"),
        ("cross_check_runs", -1, "a whole number of at least 0"),
        ("title", 1.0, "text"),
        ("provenance", '{"eqt": 1}', "versions and times in JSON"),
        ("provenance", "[" * 500, "versions and times in JSON"),
        *(("experiment", text, "a description in JSON") for text in ('{"kinds": 5}', "[]")),
    ],
)
def test_an_attribute_of_another_type(result, invoke, name, value, expected):
    with h5py.File(result, "a") as file:
        file.attrs[name] = value
    refused(invoke, result, "show", f"its attribute '{name}' is not {expected}")


@pytest.mark.parametrize(
    "value",
    [
        '{"functions": {"eqt": "L", "uaternion": "V"}}',
        '{"unclaimed": ["uaternion"]}',
        '{"not_matched": ["uaternion"]}',
    ],
)
def test_an_attribute_about_a_controller_that_is_not_there(result, invoke, value):
    with h5py.File(result, "a") as file:
        file.attrs["experiment"] = value
    reason = "its attribute 'experiment' names 'uaternion', which is not a controller"
    refused(invoke, result, "show", reason)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("time", np.inf, "its 'time' does not rise from one finite number to the next"),
        ("time", np.nan, "its 'time' does not rise from one finite number to the next"),
        ("time", 0.0, "its 'time' does not rise from one finite number to the next"),
        ("status", -1, "its 'status' is -1 for a run"),
        ("run", 2**31 - 1, "its 'run' counts to 2147483647, and there are 2"),
        ("run", -1, "its 'run' does not count from 0"),
    ],
)
def test_numbers_that_no_run_has(result, invoke, name, value, reason):
    with h5py.File(result, "a") as file:
        if file[name].ndim > 1:
            file[name][...] = value
        else:
            file[name][-1] = value
    refused(invoke, result, "compare", reason)


@pytest.mark.ci("writes a whole report")
def test_a_report_of_a_reference_that_is_no_number(result, invoke):
    with h5py.File(result, "a") as file:
        file["desired_pose"][...] = np.nan
    page = result.with_name("page.html")
    invoke("report", result, "--out", page)
    assert "its &#39;desired_pose&#39; is not finite at the start" in page.read_text("utf-8")


@pytest.fixture
def huge(result):
    """A result with numbers whose squares overflow."""
    with h5py.File(result, "a") as file:
        file["effort"][0] = [1e308, -1e308]
    return result


def test_a_figure_of_numbers_that_no_axis_can_show(huge, invoke):
    words = "--figure distributions --option metrics=[effort] --out".split()
    assert invoke("plot", huge, *words, huge.parent / "f", code=2).stderr == (
        "eqt: the figure cannot be drawn: its numbers are too large for an axis; look for runs "
        "that diverge with `eqt show --table metrics`\n"
    )


def test_a_comparison_of_numbers_whose_squares_overflow(huge, invoke):
    assert invoke("compare", huge).stdout


@pytest.mark.ci("starts an interpreter")
def test_numbers_that_overflow_are_no_warning_of_a_library(result):
    with h5py.File(result, "a") as file:
        for name in ("effort", "mean_pose_error", "energy_residual"):
            file[name][0] = [1.7e308, -1.7e308]
    start = "from eqt_cli.cli import main; main()"
    for command in ("show", "compare"):
        done = subprocess.run(
            [sys.executable, "-c", start, command, str(result)], capture_output=True, text=True
        )
        assert (done.returncode, "Warning" in done.stderr) == (0, False), done.stderr
        assert done.stdout


@pytest.mark.ci("writes a whole report")
def test_a_report_of_numbers_whose_squares_overflow(huge, invoke):
    invoke("report", huge, "--quick", "--out", huge.with_name("page.html"))


def test_thrusters_of_any_size_are_checked(tmp_path, invoke):
    path = tmp_path / "c.yaml"
    path.write_text(
        """\
group: SO3
inertia: [1, 1, 1]
gains: {kp: 1, kd: 1}
reference: {torque: ["cos(t)", "sin(t)", 0]}
controllers: [eqt]
actuators: [{kind: thrusters, matrix: [[1.0e299, 0, 0], [0, 1, 0], [0, 0, 1]], low: -1, high: 1}]
initial: {pose: {kind: exp_normal, std: 0.5}, velocity: {kind: normal, std: 0.1}}
ensemble: {runs: 2}
time: {duration: 2.0, samples: 11}
"""
    )
    assert f"{path}: valid" in invoke("config", "check", path).stderr
    assert (
        "left out: actuators[0] (only the limits of the thrusters)"
        in invoke("margins", path).stdout
    )


def test_a_file_with_more_datasets_than_eqt_writes_is_refused_at_once(result, invoke):
    with h5py.File(result, "a") as file:
        for number in range(1000):
            file[f"x{number}"] = 1.0
        count = len(file)
    refused(invoke, result, "show", f"it holds {count} datasets in '/'")


def test_a_damaged_result_leaves_nothing_half_said(result, invoke):
    with h5py.File(result, "a") as file:
        del file["final_pose_error"]
    assert invoke("show", result, code=2).stdout == ""
