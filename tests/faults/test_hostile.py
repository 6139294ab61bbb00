"""Files of strangers, given to the commands: each is refused with exit code 2 and a clear error."""

import os

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


def _external_storage(file, folder):
    (folder / "secret").write_bytes(b"12345678")
    del file["effort"]
    place = [(str(folder / "secret"), 0, 8)]
    file.create_dataset("effort", shape=(1, 1), dtype="f8", external=place)


def _virtual(file, folder):
    with h5py.File(folder / "secret.h5", "w") as other:
        other["effort"] = np.ones((1, 1))
    del file["effort"]
    layout = h5py.VirtualLayout((1, 1), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "secret.h5"), "effort", (1, 1))
    file.create_virtual_dataset("effort", layout)


def _huge(file, folder):
    del file["effort"]
    file.create_dataset("effort", shape=(131072, 131072), dtype="f8")  # 137 GB


def _shared(file, folder):
    del file["effort"]
    file["effort"] = h5py.SoftLink("/peak_torque")


BAD = {
    "external link": (_external_link, "'effort' is an external link"),
    "external storage": (_external_storage, "'effort' keeps its data in another file"),
    "virtual dataset": (_virtual, "'effort' is a virtual dataset"),
    "137 GB": (_huge, "'effort' has the shape (131072, 131072) and holds no data"),
    "soft link": (_shared, "'effort' is a soft link"),
}


@pytest.mark.parametrize("command", ["show", "plot", "run"])
@pytest.mark.parametrize("case", BAD)
def test_hostile_results_are_refused(result, tmp_path, monkeypatch, capsys, command, case):
    damage, reason = BAD[case]
    with h5py.File(result, "a") as file:
        damage(file, tmp_path)
    code, error = eqt(monkeypatch, capsys, command, result)
    assert code == 2
    assert error == (
        f"eqt: {result}: refused: {reason}; eqt writes no such file: "
        "copy it again or run the experiment again\n"
    )


@pytest.mark.parametrize("command", ["show", "plot", "run"])
@pytest.mark.parametrize("kind", ["truncated", "noise", "signature", "empty"])
def test_damaged_results_are_refused(result, monkeypatch, capsys, command, kind):
    noise = np.random.default_rng(1).bytes(10_000)
    result.write_bytes(
        {
            "truncated": result.read_bytes()[:-5000],
            "noise": noise,
            "signature": b"\x89HDF\r\n\x1a\n" + noise,
            "empty": b"",
        }[kind]
    )
    code, error = eqt(monkeypatch, capsys, command, result)
    assert code == 2
    assert error.startswith(f"eqt: {result}: ")
    assert error.count("\n") == 1


HOSTILE_YAML = {
    "bomb": (
        "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
        + "".join(
            f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n"
            for a, b in zip("abcdef", "bcdefg", strict=True)
        ),
        "expected at most 100000 keys and values, aliases followed, got more",
    ),
    "deep": ("a: " + "[" * 5000 + "]" * 5000, "nested more than 64 deep"),
    "object": ("name: !!python/object/apply:os.system [id]", "tag !!python/object/apply:os.system"),
    "duplicate": ("group: SO3\ngroup: SE3", "duplicate key"),
    "binary": (b"\xff\xfe\x00a", "is not UTF-8"),
    "sweep of everything": (CONFIG + "sweep: [{grid: {ensemble: [1]}}]", "ensemble"),
    "code": (
        CONFIG.replace("[0, 0, 0]", "[\"__import__('os').system('id')\", 0, 0]"),
        "reference.torque[0]",
    ),
    "path": (CONFIG + "name: ../../etc/passwd", "name: expected a letter or digit"),
    "many points": (
        CONFIG + "sweep: [{sobol: {points: -5, axes: {gains.kp: {low: 1, high: 2}}}}]",
        "expected a whole number of at least 1, got -5",
    ),
}


@pytest.mark.parametrize("case", HOSTILE_YAML)
def test_hostile_configurations_are_refused(tmp_path, monkeypatch, capsys, case):
    text, reason = HOSTILE_YAML[case]
    config = tmp_path / "config.yaml"
    config.write_bytes(text if isinstance(text, bytes) else text.encode())
    monkeypatch.chdir(tmp_path)
    code, error = eqt(monkeypatch, capsys, "sweep" if "sweep" in str(text) else "run", config)
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
    assert "executed only on request" in error
    assert witness.read_text(encoding="utf-8") == before


@pytest.mark.skipif(os.name != "posix", reason="has no pipes in folders")
def test_a_pipe_is_not_waited_for(tmp_path, monkeypatch, capsys):
    os.mkfifo(tmp_path / "pipe.h5")
    code, error = eqt(monkeypatch, capsys, "show", tmp_path / "pipe.h5")
    assert code == 2
    assert "is not a file" in error
