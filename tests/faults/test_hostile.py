"""Files of strangers, given to the commands: each is refused with exit code 2 and a clear error."""

import json
import re

import h5py
import numpy as np
import pytest

from eqt_cli.cli import main
from eqt_cli.config.source import read_config
from eqt_cli.execution.run_study import execute
from eqt_cli.experiment.read_study import study

CONFIG = """\
group: SO3
inertia: 1.0
gains: {kp: 1.0, kd: 0.5}
reference: {torque: [0, 0, 0]}
controllers: [eqt]
time: {duration: 0.1, samples: 2}
solver: {rtol: 1.0e-3, cross_check: 0}
"""


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    config = folder / "config.yaml"
    config.write_text(CONFIG, encoding="utf-8")
    execute(study(read_config(config)), folder / "out")
    return (folder / "out/results.h5").read_bytes()


@pytest.fixture
def result(good, tmp_path):
    path = tmp_path / "results.h5"
    path.write_bytes(good)
    return path


def eqt(monkeypatch, capsys, *words):
    """The exit code and stderr of a command, run in this process."""
    monkeypatch.setattr("sys.argv", ["eqt", *map(str, words)])
    with pytest.raises(SystemExit) as caught:
        main()
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return caught.value.code, captured.err


def _external_link(file, folder):
    secret = folder / "secret.h5"
    with h5py.File(secret, "w") as other:
        other["effort"] = np.ones((1, 1))
    del file["effort"]
    file["effort"] = h5py.ExternalLink(str(secret), "/effort")


@pytest.mark.parametrize("command", ["show", "plot", "run"])
def test_hostile_results_are_refused(result, tmp_path, monkeypatch, capsys, command):
    """As one kind is, others are: store/test_safety.py."""
    with h5py.File(result, "a") as file:
        _external_link(file, tmp_path)
    code, error = eqt(monkeypatch, capsys, command, result)
    assert code == 2
    assert error == (
        f"eqt: {result}: refused: 'effort' is an external link; eqt writes no such file: "
        "copy it again or run the experiment again\n"
    )


@pytest.mark.parametrize("command", ["show", "plot", "run"])
def test_damaged_results_are_refused(result, monkeypatch, capsys, command):
    result.write_bytes(result.read_bytes()[:-5000])
    code, error = eqt(monkeypatch, capsys, command, result)
    assert code == 2
    assert error.startswith(f"eqt: {result}: ")
    assert error.count("\n") == 1


HOSTILE_YAML = {
    "object": ("name: !!python/object/apply:os.system [id]", "tag !!python/object/apply:os.system"),
    "sweep of everything": (CONFIG + "sweep: [{grid: {ensemble: [1]}}]", "ensemble"),
    "code": (
        CONFIG.replace("[0, 0, 0]", "[\"__import__('os').system('id')\", 0, 0]"),
        "reference.torque[0]",
    ),
    "path": (CONFIG + "name: ../../etc/passwd", "name: expected letters, digits, '.', '_' and '-'"),
    "many points": (
        CONFIG + "sweep: [{sobol: {points: -5, axes: {gains.kp: {low: 1, high: 2}}}}]",
        "expected a whole number of at least 1, got -5",
    ),
}


@pytest.mark.parametrize("case", HOSTILE_YAML)
def test_hostile_configurations_are_refused(tmp_path, monkeypatch, capsys, case):
    text, reason = HOSTILE_YAML[case]
    config = tmp_path / "config.yaml"
    config.write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    code, error = eqt(monkeypatch, capsys, "sweep" if "sweep" in text else "run", config)
    assert code == 2
    assert reason in error
    assert not (tmp_path / "results").exists()


def test_a_result_executes_no_stored_plugin_unasked(tmp_path, monkeypatch, capsys):
    plugin = tmp_path / "law.py"
    plugin.write_text(
        "import os\nfrom dataclasses import dataclass\n"
        "from eqt_cli.controllers.family import Family\n"
        "with open(os.environ['WITNESS'], 'a') as witness: witness.write('x')\n"
        "@dataclass(frozen=True)\nclass Law(Family):\n    name = 'law_of_test_hostile'\n",
        encoding="utf-8",
    )
    witness = tmp_path / "witness"
    monkeypatch.setenv("WITNESS", str(witness))
    config = tmp_path / "config.yaml"
    text = CONFIG.replace("[eqt]", "[law_of_test_hostile]") + "plugins: [law.py]\n"
    config.write_text(text, encoding="utf-8")
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["eqt", "run", str(config), "--out", str(out)])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 0
    before = witness.read_text(encoding="utf-8")
    code, error = eqt(monkeypatch, capsys, "run", out / "results.h5", "--out", tmp_path / "again")
    assert code == 2
    assert "which eqt executes only on request" in error
    assert witness.read_text(encoding="utf-8") == before


# What a terminal, or a page, would obey --------------------------------------------------------

UNSEEN = "\x1b[2J\x9b31m\u202e\u2066\n"


def unseen(text):
    return {c for c in text if not c.isprintable() and c not in "\n\u00a0"}


HOSTILE_NAMES = {
    "key": f"{json.dumps(UNSEEN)}: 1",
    "nested key": f"ensemble: {{{json.dumps(UNSEEN)}: 1}}",
    "value": f"name: {json.dumps(UNSEEN)}",
    "component": f"task: {json.dumps(UNSEEN)}",
    "file": f"plugins: [{json.dumps(UNSEEN)}]",
    "sweep": f"sweep: [{{grid: {{{json.dumps(UNSEEN)}: [1, 2]}}}}]",
    "label": f"sweep: [{{grid: {{gains.kp: [{json.dumps(UNSEEN)}, 2]}}}}]",
}


@pytest.mark.parametrize("json_wanted", [False, True])
@pytest.mark.parametrize("case", HOSTILE_NAMES)
def test_names_in_a_configuration_reach_no_terminal_raw(
    tmp_path, monkeypatch, capsys, case, json_wanted
):
    config = tmp_path / "config.yaml"
    config.write_text(CONFIG + HOSTILE_NAMES[case] + "\n", encoding="utf-8")
    words = ["config", "check", config, *(["--json"] if json_wanted else [])]
    monkeypatch.setattr("sys.argv", ["eqt", *map(str, words)])
    with pytest.raises(SystemExit) as caught:
        main()
    printed = capsys.readouterr()
    assert caught.value.code == 2
    assert not unseen(printed.out + printed.err)
    assert r"\u202e" in printed.out + printed.err
    if json_wanted:
        assert "\u202e" in str(json.loads(printed.out)) or r"\u202e" in str(json.loads(printed.out))


@pytest.fixture(scope="module")
def strange(good, tmp_path_factory):
    """A result with text that a terminal would obey wherever a file of results holds text."""
    path = tmp_path_factory.mktemp("strange") / "results.h5"
    path.write_bytes(good)
    with h5py.File(path, "a") as file:
        config = file.attrs["config"].replace("label: eqt", f"label: {json.dumps(UNSEEN)}")
        file.attrs["config"] = config
        file.attrs["title"] = file.attrs["group"] = UNSEEN
        file.attrs["titles"] = json.dumps({UNSEEN: UNSEEN})
        file.attrs["plugins"] = f"{json.dumps(UNSEEN)}: {json.dumps(UNSEEN)}\n"
        file.attrs["provenance"] = json.dumps(
            json.loads(file.attrs["provenance"]) | {"started": UNSEEN, "eqt": UNSEEN}
        )
        file["controller"][...] = UNSEEN
        file["message"][...] = UNSEEN
        file["status"][...] = 1
        file["effort"].attrs["long_name"] = UNSEEN
    return path


@pytest.mark.parametrize(
    "words",
    [
        ["show"],
        ["show", "--json"],
        ["show", "--config"],
        ["show", "--plugins"],
        ["show", "--variables"],
        ["show", "--failed"],
        ["show", "--failed", "--json"],
        ["show", "--table"],
        ["show", "--table", "--format", "jsonl"],
        ["compare"],
        ["compare", "--json"],
        ["compare", "--list"],
        ["verify"],
        ["run"],
        ["config", "check", "--resolved"],
    ],
    ids=" ".join,
)
def test_text_in_a_result_reaches_no_terminal_raw(strange, monkeypatch, capsys, words):
    command = words[: 2 if words[0] == "config" else 1]
    options = words[len(command) :]
    monkeypatch.setattr("sys.argv", ["eqt", *command, str(strange), *options])
    with pytest.raises(SystemExit):
        main()
    printed = capsys.readouterr()
    assert printed.out + printed.err
    assert not unseen(printed.out + printed.err)


def test_text_in_a_result_reaches_no_page_raw(strange, tmp_path, monkeypatch, capsys):
    page = tmp_path / "page.html"
    monkeypatch.setattr("sys.argv", ["eqt", "report", str(strange), "--out", str(page)])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code in (None, 0), capsys.readouterr().err
    text = page.read_text(encoding="utf-8")
    data = re.findall(r'<script id="data[^>]*>(.*?)</script>', text, re.DOTALL)
    assert not unseen(text)
    assert data
    assert not any(r"\u202e" in part.replace(r"\\u202e", "") for part in data)
