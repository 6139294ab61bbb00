"""Files of strangers, given to the commands: each is refused with exit code 2 and a clear error."""

import json
import re

import h5py
import numpy as np
import pytest
from said import says
from small_experiment import configuration, study_of
from stored import fixed, retext

from eqt_cli.runs.run_study import execute

CONFIG = configuration(
    reference="{torque: [0, 0, 0]}",
    controllers="[eqt]",
    time="{duration: 0.1, samples: 2}",
    solver="{rtol: 1.0e-3, cross_check: 0}",
    initial=None,
    ensemble=None,
)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    return execute(study_of(folder, CONFIG), folder / "out").folder.results.read_bytes()


@pytest.fixture
def result(good, tmp_path):
    path = tmp_path / "results.h5"
    path.write_bytes(good)
    return path


COMMANDS = pytest.mark.parametrize("command", ["show", "plot", "run"])


@COMMANDS
def test_hostile_results_are_refused(result, tmp_path, refused, command):
    """As one kind is, others are: base/test_store_safety.py."""
    with h5py.File(tmp_path / "secret.h5", "w") as other:
        other["effort"] = np.ones((1, 1))
    with h5py.File(result, "a") as file:
        del file["effort"]
        file["effort"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "/effort")
    assert says(refused(command, result), f"{result}: refused: 'effort' is an external link…\n")


@COMMANDS
def test_damaged_results_are_refused(result, refused, command):
    result.write_bytes(result.read_bytes()[:-5000])
    assert re.fullmatch(f"{re.escape(str(result))}: .*\n", refused(command, result))


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
def test_hostile_configurations_are_refused(folder, refused, case):
    text, reason = HOSTILE_YAML[case]
    (folder / "config.yaml").write_text(text, encoding="utf-8")
    said = refused("sweep" if "sweep" in text else "run", "config.yaml")
    assert reason in said and "Traceback" not in said
    assert not (folder / "results").exists()


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


@pytest.mark.parametrize("options", [[], ["--json"]], ids=["text", "json"])
@pytest.mark.parametrize("case", HOSTILE_NAMES)
def test_names_in_a_configuration_reach_no_terminal_raw(tmp_path, eqt, case, options):
    config = tmp_path / "config.yaml"
    config.write_text(CONFIG + HOSTILE_NAMES[case] + "\n", encoding="utf-8")
    done = eqt("config", "check", config, *options)
    assert done.code == 2
    assert not unseen(done.out + done.err)
    assert r"\u202e" in done.out + done.err
    if options:
        told = str(json.loads(done.out))
        assert "\u202e" in told or r"\u202e" in told


@pytest.fixture(scope="module")
def strange(good, tmp_path_factory):
    """A result with text that a terminal would obey wherever a file of results holds text."""
    path = tmp_path_factory.mktemp("strange") / "results.h5"
    path.write_bytes(good)
    with h5py.File(path, "a") as file:
        config = file.attrs["config"].decode().replace("label: eqt", f"label: {json.dumps(UNSEEN)}")
        file.attrs["config"] = fixed(config)
        file.attrs["title"] = file.attrs["group"] = fixed(UNSEEN)
        texts = dict.fromkeys(("signal_path", "exact", "loop", "departures"), UNSEEN)
        maps = {name: {UNSEEN: UNSEEN} for name in ("titles", "kinds")}
        file.attrs["experiment"] = fixed(json.dumps(texts | maps))
        file.attrs["plugins"] = fixed(f"{json.dumps(UNSEEN)}: {json.dumps(UNSEEN)}\n")
        told = json.loads(file.attrs["provenance"]) | {"started": UNSEEN, "eqt": UNSEEN}
        file.attrs["provenance"] = fixed(json.dumps(told))
        retext(file, "controller", [UNSEEN] * len(file["controller"]))
        retext(file, "message_text", [UNSEEN] * len(file["message_text"]))
        file["status"][...] = 1
        file["effort"].attrs["long_name"] = fixed(UNSEEN)
    return path


OF_A_RESULT = """
show | show --json | show --config | show --plugins | show --variables | show --failed
show --failed --json | show --table | show --table --format jsonl | compare | compare --json
compare --list | verify | run | config check --resolved
"""


@pytest.mark.parametrize(
    "words", [words.split() for words in re.split(r"[|\n]", OF_A_RESULT.strip())], ids=" ".join
)
def test_text_in_a_result_reaches_no_terminal_raw(strange, eqt, words):
    at = 2 if words[0] == "config" else 1
    done = eqt(*words[:at], strange, *words[at:])
    assert done.out + done.err
    assert not unseen(done.out + done.err)


@pytest.mark.needs("report")
def test_text_in_a_result_reaches_no_page_raw(strange, tmp_path, eqt):
    done = eqt("report", strange, "--out", tmp_path / "page.html")
    assert done.code == 0, done.err
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    data = re.findall(r'<script id="data[^>]*>(.*?)</script>', text, re.DOTALL)
    assert not unseen(text)
    assert data
    assert not any(r"\u202e" in part.replace(r"\\u202e", "") for part in data)
