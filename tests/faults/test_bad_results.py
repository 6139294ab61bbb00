"""What mutation has found, each case by itself: one message that says the place and the bound."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from case_tables import from_yaml
from said import mentions, says
from small_experiment import configuration
from stored import fixed

COMMON = {
    "controllers": "[eqt]",
    "ensemble": "{runs: 2, seed: 1}",
    "time": "{duration: 1.0, samples: 5}",
    "solver": "{rtol: 1.0e-3, cross_check: 1}",
}


def written(**changes):
    Path("c.yaml").write_text(configuration(**COMMON | changes), encoding="utf-8")


@from_yaml
def test_a_configuration_is_refused(folder, invoke, line, said):
    section, _, value = line.partition(": ")
    written(**{section: value})
    heading, found = invoke("config", "check", "c.yaml", code=2).stderr.splitlines()
    assert heading == "1 error in c.yaml"
    assert mentions(found, said)


NAME = "a" * 1000
LONG = {
    "initial": (f"{{file: {NAME}}}", f"initial.file: {NAME}: cannot be read: file name too long"),
    "group": (
        "*".join(["SO3"] * 600),
        "group: group 'SO3*…': its 600 factors have more than 64 axes, so the numbers of",
    ),
}


@pytest.mark.parametrize("section", LONG)
def test_a_long_name_is_refused(folder, invoke, section):
    value, said = LONG[section]
    written(**{section: value})
    heading, found = invoke("config", "check", "c.yaml", code=2).stderr.splitlines()
    assert heading == "1 error in c.yaml"
    assert mentions(found, said)


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
    assert said.stderr == f"eqt: error: {path}: refused: {reason}; {again}\n"
    assert said.stdout == ""


@pytest.mark.needs("proofs", "report")
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
        file.attrs[name] = fixed(value)
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
        file.attrs["experiment"] = fixed(value)
    reason = "its attribute 'experiment' names 'uaternion', which is not a controller"
    refused(invoke, result, "show", reason)


@from_yaml
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
    assert says(
        invoke("plot", huge, *words, huge.parent / "f", code=2).stderr,
        "eqt: error: the figure cannot be drawn: its numbers…\n",
    )


def test_a_comparison_of_numbers_whose_squares_overflow(huge, invoke):
    assert invoke("compare", huge, "--table", "controllers").stdout


@pytest.mark.ci("starts an interpreter")
def test_numbers_that_overflow_are_no_warning_of_a_library(result):
    with h5py.File(result, "a") as file:
        for name in ("effort", "mean_pose_error", "energy_residual"):
            file[name][0] = [1.7e308, -1.7e308]
    start = "from eqt_cli.cli import main; main()"
    for command in (["show"], ["compare", "--table", "controllers"]):
        done = subprocess.run(
            [sys.executable, "-c", start, *command, str(result)], capture_output=True, text=True
        )
        assert (done.returncode, "Warning" in done.stderr) == (0, False), done.stderr
        assert done.stdout


@pytest.mark.ci("writes a whole report")
def test_a_report_of_numbers_whose_squares_overflow(huge, invoke):
    invoke("report", huge, "--quick", "--out", huge.with_name("page.html"))


@pytest.mark.needs("thrusters")
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
    assert f"✓ {path}: valid" in invoke("config", "check", path).stdout
    assert (
        "left out: actuators[0] (only the limits of the thrusters)"
        in invoke("margins", path).stdout
    )


def test_a_file_with_more_datasets_than_eqt_writes_is_refused_at_once(result, invoke):
    with h5py.File(result, "a") as file:
        for number in range(1000):
            file[f"x{number}"] = 1.0
        count = len(file)
    refused(invoke, result, "show", f"it holds {count} datasets")


def test_a_damaged_result_leaves_nothing_half_said(result, invoke):
    with h5py.File(result, "a") as file:
        del file["final_pose_error"]
    assert invoke("show", result, code=2).stdout == ""
