"""What a shell completes at Tab."""

import json
import subprocess
import sys
from typing import get_args

import pytest
from case_tables import from_yaml

from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.option_types import option_names
from eqt_cli.base.registry import summary
from eqt_cli.cli import completion
from eqt_cli.cli.show import FORMATS
from eqt_cli.config import shipped
from eqt_cli.engines.engine import engines
from eqt_cli.figures.figure import figures
from eqt_cli.figures.render import Format


@pytest.fixture(autouse=True)
def caches(tmp_path, monkeypatch):
    """The folder of this user's caches: an empty one."""
    folder = tmp_path / "caches"
    folder.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    completion._completions.cache_clear()
    yield folder
    completion._completions.cache_clear()


@pytest.fixture
def complete(eqt, monkeypatch):
    """What bash is offered for the last word of a line."""

    def offered(line):
        monkeypatch.setenv("_EQT_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        done = eqt()
        assert done.err == ""
        found = done.out.split()
        return found

    return offered


@from_yaml
def test_names_and_keys(complete, line, expected):
    assert complete(line) == expected


def test_the_keys_of_the_given_configuration(complete, folder):
    text = (folder / "c.yaml").read_text(encoding="utf-8")
    laws = "controllers: [eqt, {kind: gt, label: other}]"
    (folder / "c.yaml").write_text(text.replace("controllers: [eqt, gt]", laws), encoding="utf-8")
    assert "controllers[1].label=" in complete("eqt run c.yaml --set controllers[1]")


def test_laws_metrics_and_signals_of_the_given_result(complete, eqt):
    eqt("run", "c.yaml", "-q")
    assert complete("eqt compare results/c --against ") == ["eqt", "gt"]
    assert complete("eqt plot results/c --controller g") == ["gt"]
    assert "mean_torque" in complete("eqt compare results/c --metric mean_")
    assert complete("eqt plot results/c --panel pose_e") == ["pose_error"]
    assert complete("eqt compare no --against ") == []


@pytest.mark.parametrize("text", ["a: [", "\xff", "- 1"])
def test_a_broken_configuration_does_not_disturb(complete, folder, text):
    (folder / "c.yaml").write_bytes(text.encode("latin-1"))
    assert complete("eqt run c.yaml --set gains.kp") == ["gains.kp="]


def test_the_options_are_those_of_the_figures(complete):
    for figure in figures.all():
        offered = complete(f"eqt plot out --figure {figure.name} --option ")
        assert offered == [f"{name}=" for name in option_names(figure)]


def test_words_are_what_is_accepted(complete):
    assert complete("eqt show out --format ") == list(FORMATS)
    assert complete("eqt plot out --format ") == [*get_args(Format), "json"]
    assert complete("eqt list ") == [*all_kinds(), "configs"]
    assert complete("eqt config new --from ") == shipped.names()


def test_nothing_heavy_is_loaded_a_second_time(caches):
    completion._completions()
    code = (
        "import sys\nfrom eqt_cli.cli import completion\n"
        "assert completion.keys('') and completion.words('figures', '')\n"
        "print([m for m in ('numpy', 'pydantic', 'h5py', 'matplotlib') if m in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True
    )
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("kept", ["[1]", '{"state": 0}'])
def test_what_was_kept_of_another_state_is_found_anew(caches, kept):
    path = caches / "eqt" / "completion.json"
    path.parent.mkdir()
    path.write_text(kept, encoding="utf-8")
    assert completion.words("engines", "s") == [("solve_ivp", summary(engines.get("solve_ivp")))]
    assert json.loads(path.read_text(encoding="utf-8"))["state"] == completion._state()


@pytest.mark.parametrize(("key", "value"), [("names", None), ("keys", [1]), ("keys", {"a": 1})])
def test_what_was_kept_and_then_damaged_is_found_anew(caches, key, value):
    whole = completion._completions()
    path = caches / "eqt" / "completion.json"
    kept = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(kept | {key: value}), encoding="utf-8")
    completion._completions.cache_clear()
    assert {**completion._completions()} == whole


def test_a_place_that_cannot_be_written_does_not_disturb(caches):
    (caches / "eqt").write_text("", encoding="utf-8")
    assert completion.words("engines", "s")
