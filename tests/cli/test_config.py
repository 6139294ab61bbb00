"""`eqt config`: write, check and describe configurations."""

import json
import re
from pathlib import Path

import pytest
from case_tables import from_yaml
from ci_cases import mostly_ci
from said import says

from eqt_cli.cli import options
from eqt_cli.config import shipped
from eqt_cli.config.json_schema import json_schema, of_files
from eqt_cli.config.remarks import FUNCTION_WORDS

# new --------------------------------------------------------------------------------------------


def test_new_writes_a_shipped_configuration(eqt):
    done = eqt("config", "new")
    assert (done.code, done.out, done.err) == (0, "paper.yaml\n", "next: eqt run paper.yaml\n")
    assert Path("paper.yaml").read_text(encoding="utf-8") == shipped.text("paper")


FAST = ("paper", "se2_vehicle", "satellite_panels")
"""test_resolved.py reads all of them."""


@mostly_ci("name", shipped.names(), FAST, "builds every one")
def test_every_shipped_configuration_is_fine(eqt, name):
    assert eqt("config", "new", "mine.yaml", "--from", name).out == "mine.yaml\n"
    assert eqt("config", "check", "mine.yaml").code == 0


def test_new_to_stdout(eqt, folder):
    done = eqt("config", "new", "-")
    assert (done.code, done.out, done.err) == (0, shipped.text("paper"), "")
    assert not (folder / "paper.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["c.yaml"], "c.yaml: already exists; give another name, or remove it\n"),
        (["c.yaml/c.yaml"], f"{Path('c.yaml/c.yaml')}: cannot be written: file exists\n"),
        (["--from", "papre"], "unknown configuration 'papre'; did you mean 'paper'?\n"),
        (
            ["--from", "xyz"],
            f"unknown configuration 'xyz'; shipped are: {', '.join(shipped.names())}\n",
        ),
    ],
)
def test_new_refuses(refused, folder, arguments, said):
    before = (folder / "c.yaml").read_bytes()
    assert refused("config", "new", *arguments) == said
    assert (folder / "c.yaml").read_bytes() == before


def test_a_shipped_configuration_by_its_name(eqt, refused, folder):
    done = eqt("config", "check", "so2")
    assert done.out.splitlines()[1].startswith("so2: SO2, 2 controllers")
    assert refused("config", "check", "papr") == "papr: not found; did you mean 'paper'?\n"
    (folder / "so2.yaml").write_text((folder / "c.yaml").read_text())
    said = refused("config", "check", "so2")  # which of the two is meant?
    assert said == "so2: not found; did you mean 'so2.yaml'?\n"


# check ------------------------------------------------------------------------------------------


def checked(out):
    """The first lines of what a check prints, the rows of the table, and the lines below it."""
    first, table, *last = out.split("\n\n")
    header, _, *rows = (" ".join(line.split()) for line in table.splitlines())
    assert header == "law axis bandwidth, rad/s damping"
    return first.splitlines(), rows, [line for text in last for line in text.splitlines()]


def test_runs_that_are_one_run_are_refused_on_the_reference_and_remarked_beside_it(eqt):
    """Three runs without a draw: on the reference there is nothing to track."""
    done = eqt("config", "check", "c.yaml", "--set", "initial={}")
    assert done.code == 2
    assert done.err.endswith(
        "initial: all 3 runs start on the reference, and nothing is drawn, so they are one run; "
        "add `initial: { pose: haar, velocity: { kind: normal, std: 1 } }`, or set ensemble.runs "
        "to 1\n"
    )
    one = eqt("config", "check", "c.yaml", "--set", "initial={}", "--set", "ensemble.runs=1")
    noisy = "--set=sensors={pose: [{kind: noise, std: 0.01}]}", "--set=control={period: 0.1}"
    drawn = eqt("config", "check", "c.yaml", "--set", "initial={}", *noisy)
    beside = "initial={velocity: {kind: fixed, coordinates: [0, 0, 1]}}"
    fixed = eqt("config", "check", "c.yaml", "--set", beside)
    assert (one.code, drawn.code, fixed.code) == (0, 0, 0), drawn.err
    assert "ensemble.runs: all 3 runs of a law are equal, as nothing is drawn" in fixed.err
    assert "are equal" not in one.err + drawn.err


@pytest.mark.needs("proofs")
def test_check_says_what_would_run(eqt, folder):
    done = eqt("config", "check", "c.yaml")
    assert (done.code, done.err) == (0, "")
    first, rows, gains = checked(done.out)
    said = "c: SO3, 2 controllers × 3 runs, 1 s, engine solve_ivp"
    assert first == ["✓ c.yaml: valid", said]
    # ω² = 2 kp/J, ζ = kd/(2 √(2 kp J)), J = 2, 1, 3; the pole is −kd/(2 max J)
    assert rows == ["EqT, GT ωx 1 0.12", "EqT, GT ωy 1.41 0.18", "EqT, GT ωz 0.816 0.1"]
    assert gains == [
        "EqT, GT: kp 1, kd 0.5 (k_R 2, k_Omega 0.5)",
        "slowest pole of EqT, GT at rest: −0.0833 ± 0.812i rad/s at all times",
    ]
    assert not (folder / "results").exists()


@pytest.mark.needs("proofs")
def test_poles_without_the_integral_of_a_law_say_so(eqt):
    """With its integral, the slowest pole of Goodarzi 2013 is another one; `margins` has it."""
    done = eqt("config", "check", "c.yaml", "--set", "controllers=[eqt, goodarzi2013]")
    poles = " ".join(done.out.split("slowest pole of ", 1)[1].split())
    said = "EqT at rest: …Goodarzi 2013 at rest, without the law's own states…margins…"
    assert says(poles, said)


def test_a_label_that_is_a_function_word_is_remarked_on(eqt):
    laws = "controllers=[{kind: eqt, label: none}, {kind: gt, label: no rates}]"
    done = eqt("config", "check", "c.yaml", "--set", laws)
    assert (done.code, done.err) == (
        0,
        "eqt: warning: --set controllers=…: controllers: the label 'none' reads as a word of a "
        "sentence; write one such as 'no rates'\n",
    )


def test_no_shipped_label_is_a_function_word():
    labels = re.findall(r"label: ([^,}\n]+)", "".join(map(shipped.text, shipped.names())))
    assert len(labels) > 10
    assert not FUNCTION_WORDS & {label.strip() for label in labels}


def test_check_reports_everything(eqt):
    Path("c.yaml").write_text("gian: 1\ntime: {duration: -1}\n", encoding="utf-8")
    done = eqt("config", "check", "c.yaml")
    assert done.code == 2
    lines = done.err.splitlines()
    assert lines[0] == "5 errors in c.yaml"  # `gian` is probably `gains`, which is not missing then
    places = [tuple(line.split(": ")[:2]) for line in lines[1:]]
    missing = ("group", "inertia", "controllers")
    assert sorted(places[:-1]) == sorted(("c.yaml:1:1", key) for key in (*missing, "gian"))
    assert places[-1] == ("c.yaml:2:8", "time.duration")


def test_check_refuses_what_a_run_would_for_its_size(refused):
    """A million runs of 10⁷ samples; a run says the same, and nothing else."""
    size = ["--set", "ensemble.runs=1000000", "--set", "time.samples=10000000"]
    said = refused("config", "check", "c.yaml", *size)
    assert "time.samples: a part of the runs takes at least " in said
    assert refused("run", "c.yaml", *size) == said


def test_the_resolved_configuration_is_fine_and_resolved(eqt):
    once = eqt("config", "check", "c.yaml", "--resolved").out
    Path("c.yaml").write_text(once, encoding="utf-8")
    assert eqt("config", "check", "c.yaml", "--resolved").out == once
    assert "method: DOP853\n" in once


def test_check_as_json(eqt):
    done = eqt("config", "check", "c.yaml", "--json")
    assert (done.code, done.err) == (0, "")
    assert json.loads(done.out) == {
        "config": "c.yaml",
        "fine": True,
        "problems": [],
        "name": "c",
        "group": "SO3",
        "points": 1,
        "controllers": ["eqt", "gt"],
        "runs": 3,
        "duration": 1.0,
        "engine": "solve_ivp",
    }


def test_check_reports_everything_as_json(eqt):
    done = eqt("config", "check", "c.yaml", "--json", "--set", "time.samples=1")
    assert (done.code, done.err) == (2, "")
    assert json.loads(done.out) == {
        "config": "c.yaml",
        "fine": False,
        "problems": [
            {
                "path": "time.samples",
                "message": "expected a whole number of at least 2, got 1",
                "place": "--set time.samples=1",
            }
        ],
    }


def test_the_resolved_configuration_as_json(eqt):
    document = json.loads(eqt("config", "check", "c.yaml", "--resolved", "--json").out)
    assert document["time"] == {"duration": 1.0, "samples": 11}


def test_check_of_a_result(eqt, result):
    done = eqt("config", "check", result, "--resolved")
    assert done.out == Path("out/config.yaml").read_text(encoding="utf-8")


# schema -----------------------------------------------------------------------------------------


def test_schema_is_one_document(eqt):
    done = eqt("config", "schema")
    assert (done.code, done.err) == (0, "")
    assert json.loads(done.out) == of_files(json_schema())


# Keys -------------------------------------------------------------------------------------------


def test_keys_of_a_section(eqt):
    done = eqt("config", "keys", "time")
    assert (done.code, done.err) == (0, "")
    header, _, *rows = done.out.splitlines()
    assert header.split() == ["key", "value", "default", "meaning"]
    assert [re.split("  +", row) for row in rows] == [
        ["time", "mapping", "required", "The horizon and its samples."],
        ["time.duration", "number", "required", "Length of the horizon, s."],
        ["time.samples", "whole number", "401", "Number of sample times."],
    ]


def test_keys_of_a_component(eqt):
    done = eqt("config", "keys", "controllers.cascade")
    assert done.out == eqt("list", "cascade").out


def test_a_key_with_the_name_of_a_figure_is_a_key(eqt):
    for key in ("initial.pose", "sensors.pose", "target.pose", "sensors.velocity"):
        [heads, _, row, *_] = eqt("config", "keys", key).out.splitlines()
        assert heads.split() == ["key", "value", "default", "meaning"]
        assert row.split()[0] == key


def test_a_key_of_any_controller(eqt):
    [found] = json.loads(eqt("config", "keys", "controllers[3].gyroscopic", "--json").out)
    assert found == {
        "key": "controllers[0].gyroscopic",
        "value": "number",
        "default": found["default"],
        "meaning": "g, the weight of −ad*_Ṽ 𝕀V_d.",
    }


def test_every_key_has_a_meaning_and_all_engines_theirs(eqt):
    found = {each["key"]: each for each in json.loads(eqt("config", "keys", "--json").out)}
    assert [key for key, each in found.items() if not each["meaning"]] == []
    assert found["solver.block"]["meaning"].startswith("solve_ivp: Runs per call of solve_ivp. ")
    assert found["solver.max_steps"]["meaning"] == (
        "native: Most steps of a run. solve_ivp: Most evaluations of the vector field for a block."
    )


@from_yaml
def test_no_such_key(refused, key, hint):
    assert refused("config", "keys", key).startswith(f"no key '{key}' in a configuration{hint}")


def test_new_makes_the_folder_and_can_be_quiet(eqt, folder):
    done = eqt("config", "new", "deep/er/mine.yaml", "-q")
    assert (done.code, done.out, done.err) == (0, "", "")
    assert Path("deep/er/mine.yaml").is_file()


def test_errors_are_a_document_with_json(eqt):
    done = eqt("run", "c.yaml", "--json", "--set", "gains.kq=2")
    assert done.code == 2
    document = json.loads(done.out)
    assert done.err == f"eqt: error: {document['error']}\n"
    assert document["exit_code"] == 2
    [problem] = document["problems"]
    assert (problem["path"], problem["place"]) == ("gains.kq", "--set gains.kq=2")


@pytest.mark.parametrize(
    ("solver", "option", "engine"),
    [("{}", None, "native"), ("{engine: solve_ivp}", None, "solve_ivp"), ("{}", "a", "a")],
)
def test_the_environment_names_the_engine_where_nothing_else_does(
    tmp_path, monkeypatch, solver, option, engine
):
    config = tmp_path / "one.yaml"
    config.write_text(f"group: SO3\nsolver: {solver}\n")
    monkeypatch.setenv("EQT_ENGINE", "native")
    assert options.document_of(config, None, option).data["solver"]["engine"] == engine
