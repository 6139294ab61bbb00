"""Plants of a textbook in several conventions are right; planted faults in them are named."""

from functools import cache
from pathlib import Path

import pytest
import yaml
from case_tables import from_yaml

from eqt_cli.base.errors import EqtError
from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.extensions.firmware import plant_verdict

HERE = Path(__file__).parent
CONVENTIONS = yaml.safe_load((HERE / "conventions.yaml").read_text(encoding="utf-8"))
"""Configuration, file, function and adapter of the right plants, by name."""


@cache
def experiment(name):
    return study(read_config(HERE / f"{name}.yaml", [], False)).experiment(0)


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def written(convention, *changes, **adapter):
    """Write a plant with parts of its text replaced, and its adapter; return its place."""
    how = CONVENTIONS[convention]
    text = (HERE / how["file"]).read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    Path("sim.py").write_text(text, encoding="utf-8")
    data = how["adapter"] | adapter
    Path("sim.adapter.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return f"sim.py:{how['function']}"


def judged(convention, *changes, simulator=False, **adapter):
    """Return what is said of a plant."""
    place = written(convention, *changes, **adapter)
    of = experiment(CONVENTIONS[convention]["config"])
    return plant_verdict.judged(of, place, None, simulator)[0]


@pytest.mark.parametrize(
    "convention",
    [
        pytest.param(name, marks=[] if name == "turns" else pytest.mark.ci("one of them is fast"))
        for name in CONVENTIONS
    ],
)
def test_a_right_plant_is_the_plant(convention):
    record = judged(convention)
    assert (record["finding"], record["sentences"]) == ("is", [])
    assert {part["finding"] for part in record["parts"]} == {""}


@from_yaml
def test_a_planted_fault_is_named(plant, was, becomes, said):
    assert "; ".join(judged(plant, (was, becomes))["sentences"]) == said


@from_yaml
def test_a_plant_that_cannot_be_judged(plant, was, becomes, adapter, said):
    with pytest.raises(EqtError) as error:
        judged(plant, (was, becomes), **adapter)
    assert said in str(error.value)
