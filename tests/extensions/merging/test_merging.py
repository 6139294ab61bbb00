"""Configurations that extend others: what is merged, where errors stand, what results hold."""

import json
import os
import textwrap
from pathlib import Path

import pytest
import yaml
from case_tables import from_yaml
from said import error_of, says

from eqt_cli.config.document import read_config

VEHICLE = """
group: SO3
inertia: [2, 1, 3]
gains: { kp: 1.0, kd: 0.5 }
actuators: [{ kind: limit, limit: 3 }]
solver: { engine: native }
initial: { pose: { kind: exp_normal, std: 0.1 }, velocity: normal }
"""
TASK = """
name: task
extends: vehicle.yaml
reference: { kind: constant, velocity: 0.1 }
plugins: [law.py]
time: { duration: 0.1, samples: 2 }
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Write files of a project, in whose folder `own` this process then is."""

    def write(own, **others):
        files = {
            "base/vehicle.yaml": VEHICLE,
            "base/task.yaml": TASK,
            "base/law.py": "1\n",
            **others,
        }
        for name, text in {**files, "own/c.yaml": own}.items():
            path = tmp_path / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(textwrap.dedent(text), "utf-8")
        monkeypatch.chdir(tmp_path / "own")
        return read_config(path)

    return write


def test_mappings_merge_and_everything_else_is_replaced(written):
    document = written(
        """
        extends: ../base/task.yaml
        gains: { kd: 2 }
        actuators: null
        initial: { pose: { kind: haar } }
        reference: { velocity: 0.2 }
        controllers: [eqt]
        """
    )
    whole = yaml.safe_load(VEHICLE) | yaml.safe_load(TASK)
    del whole["extends"], whole["actuators"]
    whole["gains"]["kd"] = 2
    whole["initial"]["pose"] = {"kind": "haar"}
    whole["reference"]["velocity"] = 0.2
    whole |= {"controllers": ["eqt"], "name": "c", "plugins": ["../base/law.py"]}
    assert document.data == whole
    places = {
        ("gains", "kp"): "../base/vehicle.yaml:4:10",
        ("gains", "kd"): "c.yaml:3:10",
        ("initial", "velocity"): "../base/vehicle.yaml:7:50",
        ("initial", "pose", "kind"): "c.yaml:5:20",
        ("reference", "kind"): "../base/task.yaml:4:14",
    }
    assert {at: os.path.relpath(document.place(at)) for at in places} == places
    assert sorted(document.home.files) == ["../base/task.yaml", "../base/vehicle.yaml", "c.yaml"]


def test_of_two_files_the_later_one_wins(written):
    more = {"base/a.yaml": "gains: {kp: 7, kd: 7}\n", "base/b.yaml": "gains: {kp: 8}\n"}
    data = written("extends: [../base/a.yaml, ../base/b.yaml]\n", **more).data
    assert data["gains"] == {"kp": 8, "kd": 7}


@from_yaml
def test_wrong_uses_are_refused_at_their_place(written, tmp_path, own, said):
    circle = {"base/circle.yaml": "extends: ../own/c.yaml\n", "base/text.yaml": "text\n"}
    chain = {f"base/{k}.yaml": f"extends: {k + 1}.yaml\n" for k in range(9)}
    message = error_of(written, own, **circle, **chain)
    assert says(message.replace(f"{tmp_path}/own/", "").replace(f"{tmp_path}/", ""), said)


def test_a_link_to_itself_is_refused(written, tmp_path):
    (tmp_path / "base").mkdir(exist_ok=True)
    (tmp_path / "base" / "loop.yaml").symlink_to("loop.yaml")
    assert "1:1: extends: " in (message := error_of(written, "extends: ../base/loop.yaml"))
    assert "loop.yaml: cannot be read: too many" in message


def test_a_result_holds_all_texts_and_extends_nothing(written, eqt, tmp_path):
    written(
        "extends: ../base/vehicle.yaml\ncontrollers: [eqt]\nreference: {torque: [0, 0, 1]}\n"
        "time: {duration: 0.1, samples: 2}\n"
    )
    assert eqt("run", "c.yaml", "--out", "r", "-q").code == 0
    kept = {path.name: path.read_text() for path in (tmp_path / "own/r/stored_files").iterdir()}
    assert kept["0-vehicle.yaml"] == VEHICLE and "extends" in kept["1-c.yaml"]
    stored = tmp_path / "own/r/config.yaml"
    assert "extends" not in yaml.safe_load(stored.read_text())
    stored.write_text("extends: ../../base/task.yaml\n", "utf-8")
    assert says(error_of(read_config, stored), f"{stored}:1:1: extends: a result holds its whole…")


def test_show_prints_each_value_with_its_origin(written, eqt):
    written("extends: ../base/vehicle.yaml\ngains: {kd: 2}\n")
    told = json.loads(eqt("config", "show", "c.yaml", "--set", "gains.kp=3", "--json").out)
    assert told["origins"]["gains.kp"] == "--set gains.kp=3"
    assert told["origins"]["gains.kd"] == "c.yaml:2:9"
    assert told["origins"]["inertia"] == "../base/vehicle.yaml:3:1"
    text = eqt("config", "show", "c.yaml").out
    assert yaml.safe_load(text) == read_config(Path("c.yaml")).data
    assert "  kp: 1.0" in text and "# ../base/vehicle.yaml:4:10" in text
