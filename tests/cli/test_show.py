"""`eqt show`: what a result holds."""

import json
import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from case_tables import from_yaml
from said import says

from eqt_cli.api.loading import open_at
from eqt_cli.cli import result_tables
from eqt_cli.results.summary import headline

FAILS = ("--set", "solver.max_steps=20")


def test_the_summary(eqt, result):
    done = eqt("show", result)
    title, origin, digest, blank, header, *_ = done.out.splitlines()
    assert (done.code, done.err) == (0, "")
    assert title == f"c on SO3  ({Path('out/results.h5')})"
    assert re.fullmatch(r"run      \S+ UTC with eqt \S+, python \S+, numpy \S+, scipy \S+", origin)
    assert re.fullmatch(r"digest   [0-9a-f]{16}", digest)
    assert blank == ""
    assert header.startswith(
        "law  settled  mean attitude error, deg  final attitude error, deg  mean"
    )


def test_parts_with_other_units_have_columns_in_words(eqt):
    config = Path(__file__).parents[2] / "configs" / "se3.yaml"
    few = [
        "ensemble.runs=1",
        "time.duration=4",
        "time.samples=41",
        "controllers=[eqt]",
        "solver.cross_check=0",
    ]
    eqt("run", config, *(f"--set={each}" for each in few), "--out", "se3", "--quiet")
    out = eqt("show", "se3").out.splitlines()
    header = next(line for line in out if line.lstrip().startswith("law"))
    assert re.split(" {2,}", header)[2:] == [
        "rms position error, m",
        "final position error, m",
        "mean attitude error, deg",
        "final attitude error, deg",
        "mean torque, N m",
        "mean force, N",
    ]


def test_units_of_a_user_are_in_headings_and_numbers(eqt, result):
    def rows(*options):
        out = eqt("show", result, "--table", "metrics", *options).out
        return [line.split(",") for line in out.splitlines()]

    (header, *usual), (heading, *other) = rows(), rows("--unit", "mN m")
    at = header.index("peak_torque")
    assert heading[at] == "peak_torque (mN m)"
    assert [float(row[at]) for row in other] == pytest.approx(
        [1e3 * float(row[at]) for row in usual], rel=1e-15
    )
    out = eqt("show", result, "--unit", "mN m", "--unit", "arcsec").out
    assert "mean torque, first 5 s, mN m" in out
    assert "mean attitude error, arcsec" in out


def test_a_file_shows_the_same_as_its_folder(eqt, result):
    assert eqt("show", "out/results.h5") == eqt("show", result)


@pytest.mark.needs("growth")
def test_the_summary_tells_of_failed_runs_and_names_versions_of_other_sessions(eqt):
    one = (*FAILS, "--set", "controllers=[eqt]")
    eqt("run", "c.yaml", *one, "--out", "out", "--quiet")
    shown = eqt("show", "out")
    assert (shown.code, "3 runs failed: 3 step limit" in shown.err) == (0, True)
    manifest = json.loads(Path("out/manifest.json").read_text(encoding="utf-8"))
    here = manifest["provenance"]["numpy"]
    manifest["provenance"]["numpy"] = "1.0"
    manifest.pop("checksum")  # of what another version wrote
    Path("out/manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    done = eqt("run", "c.yaml", *one, "--out", "out", "--rerun-failed")
    said = [line for line in done.err.splitlines() if "eqt: warning: out: " in line]
    assert len(said) == 1
    lines = eqt("show", "out").out.splitlines()
    assert re.fullmatch(rf"also     \S+ with numpy {re.escape(here)} \(not 1\.0\)", lines[2])


def test_config_is_the_resolved_one(eqt, result):
    done = eqt("show", result, "--config")
    assert done.out == Path("out/config.yaml").read_text(encoding="utf-8")


def test_failed_lists_every_failed_run(eqt):
    eqt("run", "c.yaml", *FAILS, "--out", "out", "--quiet")
    done = eqt("show", "out", "--failed")
    lines = done.out.splitlines()
    assert [line.split(":")[0] for line in lines] == [
        f"{label} run {run}" for label in ("eqt", "gt") for run in range(3)
    ]
    assert all(line.endswith("step limit: 20 evaluations (solver.max_steps)") for line in lines)


@pytest.mark.parametrize(
    ("option", "said"), [("--failed", "no run failed\n"), ("--plugins", "no plugins\n")]
)
def test_options_say_where_there_is_none(eqt, result, option, said):
    done = eqt("show", result, option)
    assert (done.code, done.out, done.err) == (0, "", said)


@pytest.mark.needs("logs")
def test_runs_that_did_not_settle_are_listed_to_be_run_again(eqt):
    """Starts have all their digits; about a reference that starts at I, every bit comes again."""
    known = ("-q", "--set", "settling_threshold=100 deg", "--out")
    eqt("run", "c.yaml", *known, "out")
    done = eqt("show", "out", "--table", "unsettled")
    header, *rows = done.out.splitlines()
    entries = [f"Q{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
    assert header.split(",") == ["run", "settled_eqt", "settled_gt", *entries, "V1", "V2", "V3"]
    with h5py.File("out/results.h5") as file:
        settled, starts = ~np.isnan(file["settling_time"][:]), file["initial_pose"][:]
    runs = np.flatnonzero(~settled.all(axis=0))
    assert 0 < len(runs) < 3
    told = np.array([row.split(",")[:3] for row in rows], dtype=int)
    np.testing.assert_array_equal(told, np.column_stack([runs, settled.T[runs]]))
    Path("starts.csv").write_text(done.out, encoding="utf-8")
    again = "--set", "initial={file: starts.csv}", "--set", "ensemble={}"
    eqt("run", "c.yaml", *again, *known, "again")
    with h5py.File("again/results.h5") as file:
        np.testing.assert_array_equal(file["initial_pose"][:], starts[runs])
        np.testing.assert_array_equal(~np.isnan(file["settling_time"][:]), settled[:, runs])
    lines = eqt("show", "out", "--table", "unsettled", "--format", "jsonl").out.splitlines()
    assert [json.loads(line)["run"] for line in lines] == runs.tolist()


def test_unsettled_says_where_there_is_none(eqt):
    eqt("run", "c.yaml", "-q", "--set", "settling_threshold=3", "--out", "out")
    done = eqt("show", "out", "--table", "unsettled")
    assert (done.code, done.out.count("\n"), done.err) == (0, 1, "every run settled\n")


def test_unsettled_runs_of_a_sweep_are_of_a_point(eqt):
    eqt("sweep", "c.yaml", "--grid", "gains.kd=1,2", "--out", "swept", "--quiet")
    done = eqt("show", "swept", "--table", "unsettled")
    said = "eqt: error: --table unsettled: a sweep has starts by point; choose one with --point\n"
    assert (done.code, done.err) == (2, said)
    of_a_point = eqt("show", "swept", "--table", "unsettled", "--point", "1").out
    assert of_a_point.startswith("run,settled_eqt,")


def test_few_unsettled_runs_of_many_have_an_exact_interval(make_result):
    times = np.ones((2, 2000))
    times[0, 7] = np.nan
    names = ("early_torque", "mean_pose_error", "final_pose_error", "final_velocity_error")
    metrics = dict.fromkeys((*names, "energy_residual"), 0 * times) | {"settling_time": times}
    result = make_result(["eqt", "gt"], metrics=metrics)
    lines = list(result_tables._shares(result, headline(result)))
    assert lines == [
        "not settled: EqT 1 of 2000, 0.0005 [1.3e-05, 0.0028]; GT 0 of 2000, 0 [0, 0.0018] "
        "(exact 95 % intervals)",
        f"`eqt show {result.path.parent} --table unsettled` lists their starts",
    ]


def test_plugins_are_printed_and_not_executed(eqt, folder):
    source = (
        "from eqt_cli.components.laws import EqT\n\n\n"
        'class Mine(EqT):\n    name = "mine"\n\n\n'
        "print('executed')\n"
    )
    (folder / "mine.py").write_text(source, encoding="utf-8")
    plugin = ("--set", "plugins=[mine.py]", "--set", "controllers=[mine]")
    assert "executed" in eqt("run", "c.yaml", "--out", "out", *plugin).out
    done = eqt("show", "out", "--plugins")
    assert (done.code, done.out, done.err) == (0, f"# mine.py\n{source}", "")


def test_json_is_one_document(eqt, result):
    document = json.loads(eqt("show", result, "--json").out)
    keys = "path title digest config provenance remarks dimensions variables window controllers"
    assert set(document) - {"confirmed"} == set(keys.split())  # which an extension adds
    manifest = json.loads(Path("out/manifest.json").read_text(encoding="utf-8"))
    assert document["digest"] == manifest["digest"]
    assert document["provenance"] == manifest["provenance"]
    assert document["config"]["inertia"] == [2.0, 1.0, 3.0]
    assert document["variables"]["torque"] == {
        "dims": ["controller", "run", "time", "axis"],
        "units": "N m",
    }
    assert [row["controller"] for row in document["controllers"]] == ["eqt", "gt"]


def test_every_part_is_json_too(eqt):
    eqt("run", "c.yaml", *FAILS, "--out", "out", "--quiet")

    def document(*options):
        done = eqt("show", "out", *options, "--json")
        assert (done.code, done.err) == (0, "")
        return json.loads(done.out)

    assert document("--config")["inertia"] == [2.0, 1.0, 3.0]
    assert document("--plugins") == {}
    assert {
        "variable": "effort",
        "dimensions": ["controller", "run"],
        "units": "(N m)^2 s",
        "meaning": "control effort, integral of ||tau||^2",
    } in document("--variables")
    failed = document("--failed")
    assert [(row["controller"], row["run"]) for row in failed] == [
        (label, run) for label in ("eqt", "gt") for run in range(3)
    ]
    assert {row["status"] for row in failed} == {3}
    assert all(row["message"].endswith("(solver.max_steps)") for row in failed)


def test_a_table_is_no_json_document(eqt, result):
    done = eqt("show", result, "--table", "metrics", "--json")
    assert (done.code, json.loads(done.out)["exit_code"]) == (2, 2)
    assert says(done.err, "eqt: error: --json: …table…--format jsonl…\n")


@pytest.mark.parametrize("part", ["--table=metrics", "--config", "--variables", "--failed"])
def test_parts_of_an_unfinished_result_are_not_there(eqt, refused, result, part):
    Path("out/results.h5").unlink()
    assert eqt("show", "out").out.startswith("c, unfinished  (out)\n")
    assert refused("show", "out", part) == (
        "out: the folder holds no results.h5; run its experiment to the end first\n"
    )


@from_yaml
def test_what_is_no_result(refused, path, said):
    assert refused("show", path) == said


def test_a_format_is_of_the_table(refused, result):
    assert (
        refused("show", result, "--format", "csv")
        == "--format: applies to --table only; --json prints the rest for programs\n"
    )


@from_yaml
def test_unknown_tables_and_formats(refused, result, options, message):
    assert says(refused("show", result, *options), f"{message}\n")


@from_yaml
def test_options_of_an_export(refused, result, options, message):
    assert says(refused("show", result, *options), f"{message}\n")


def test_parquet_is_the_same_table(result, tmp_path):
    pytest.importorskip("pyarrow")
    pandas = pytest.importorskip("pandas")
    words = [sys.executable, "-m", "eqt_cli", "show", str(result), "--table", "metrics"]
    for form, name in (("parquet", "m.parquet"), ("csv", "m.csv")):
        with (tmp_path / name).open("wb") as file:
            subprocess.run([*words, "--format", form], stdout=file, check=True)
    pandas.testing.assert_frame_equal(
        pandas.read_parquet(tmp_path / "m.parquet"), pandas.read_csv(tmp_path / "m.csv")
    )


def test_poses_that_leave_the_group_are_told(eqt):
    eqt("run", "c.yaml", "-q", "--set", "solver.cross_check=1")
    with h5py.File("results/c/results.h5", "a") as file:
        file["group_drift"][0, 1] = 2e-3
    said = "eqt: warning: poses leave the group by 0.002…0.001; tighten solver.rtol\n"
    assert says(eqt("show", "results/c").err, said)
    again = eqt("run", "c.yaml", "--json", "--set", "solver.cross_check=1")
    assert (again.code, json.loads(again.out)["causes"]) == (4, ["poses leave the group by 0.002"])


# eqt results ------------------------------------------------------------------------------------


def test_the_results_in_a_folder(eqt, folder):
    """The newest first; a damaged one is listed with what is wrong."""
    eqt("run", "c.yaml", "-q")
    eqt("sweep", "c.yaml", "-q", "--grid", "gains.kp=1,2", "--out", "results/gains")
    inner = folder / "results" / "c" / "generations" / "0"  # as in the result of a search
    inner.mkdir(parents=True)
    (inner / "results.h5").write_bytes(b"part of another result")
    bad = folder / "results" / "bad"
    bad.mkdir()
    (bad / "results.h5").write_bytes(b"no HDF5")
    listed = {Path(each["result"]).name: each for each in json.loads(eqt("results", "--json").out)}
    assert sorted(listed) == ["bad", "c", "gains"]
    assert (listed["c"]["laws"], listed["c"]["runs"]) == ("EqT, GT", "3")
    assert listed["gains"]["runs"] == "2 points × 3"
    with open_at(folder / "results" / "c") as result:
        errors = [result.read("pose_error", controller=c) for c in range(2)]
        turns = np.degrees(2 * np.arcsin(np.array(errors) / np.sqrt(8)))
        times = result.times
    means = np.trapezoid(turns, times).mean(axis=-1) / (times[-1] - times[0])
    assert [float(each) for each in re.findall(r"[\d.]+", listed["c"]["headline"])] == (
        pytest.approx(means, rel=1e-3)
    )
    assert listed["bad"]["headline"].startswith("is not an HDF5 file")
    assert eqt("results").out.splitlines()[0].split() == (
        ["result", "begun,", "UTC", "laws", "runs", "headline"]
    )


def test_results_that_began_in_one_minute_stand_by_their_seconds(eqt, folder, monkeypatch):
    seconds = {"b": "12", "a": "07", "c": "59"}
    for name in seconds:
        (folder / "results" / name).mkdir(parents=True)
        (folder / "results" / name / "results.h5").touch()

    def listed(path):
        cells = dict.fromkeys(("begun", "laws", "runs", "headline"), "")
        begun = f"2026-12-01T12:45:{seconds[path.parent.name]}"
        return begun, {"result": path.parent.name, **cells}

    monkeypatch.setattr("eqt_cli.cli.show._listed", listed)
    names = [record["result"] for record in json.loads(eqt("results", "--json").out)]
    assert names == ["c", "b", "a"]


def test_a_folder_without_results(eqt, refused, folder):
    assert refused("results").startswith("results: expected a folder")
    (folder / "results").mkdir()
    assert eqt("results").err == "results: no results\n"


def test_every_part_of_a_pose_has_its_numbers(eqt):
    """On SE_2(3), whose position is no translation."""
    short = ["--set", "ensemble.runs=2", "--set", "time.duration=1", "--set", "time.samples=11"]
    eqt("run", "se23", *short, "-q")
    header, _, law, *_ = eqt("show", "results/se23").out.partition("\n\n")[2].splitlines()
    at = re.split(" {2,}", header).index("mean ‖p_E‖, m")
    with open_at(Path("results/se23")) as result:
        mean = result.metric("mean_pose_error_position", 0).mean()
    name, *cells = [cell for cell in law.split() if cell != "*"]
    assert name == "EqT" and float(cells[at - 1]) == pytest.approx(mean, rel=1e-3)


@pytest.mark.ci("runs and grows a result, and reads it eight times")
def test_remarks_on_the_configuration_stand_once_with_its_result(eqt):
    """Also after the result grows, and without the folders of this machine."""
    laws = "controllers=[eqt, {kind: gt, label: none}]"
    start = "initial={pose: {kind: fixed, coordinates: [0, 0, 1]}}"
    few = ("c.yaml", "--out", "out", *(f"--set={x}" for x in (laws, start, "time.duration=0.2")))
    for runs, grow in ((2, ()), (3, ("--grow",))):
        done = eqt("run", *few, f"--set=ensemble.runs={runs}", *grow)
        documents = [json.loads(eqt(word, "out", "--json").out) for word in ("show", "compare")]
        first, equal = documents[0]["remarks"]
        assert documents[1]["remarks"] == [first, equal]
        assert says(first, "controllers: the label 'none'…")
        assert says(equal, f"ensemble.runs: all {runs} runs of a law are equal…")
        for text in (" ".join(eqt(word, "out").out.split()) for word in ("show", "compare")):
            assert text.count(equal) == text.count(first) == 1
        assert " ".join(done.err.split()).count(equal) == 1
    assert "/" not in first + equal


def test_what_a_plugin_prints_is_no_part_of_a_document(eqt, folder):
    (folder / "loud.py").write_text('print("not JSON")\n', encoding="utf-8")
    done = eqt("config", "check", "c.yaml", "--set", "plugins=[loud.py]", "--json")
    assert "problems" in json.loads(done.out)
    assert "not JSON" in done.err
