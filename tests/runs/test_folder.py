"""The folder of a result: whose it is, what it holds, and that nothing in it is lost."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest
from said import error_of, says

from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.runs.lock import locked
from eqt_cli.runs.provenance import provenance

OWN_FIGURE = b"%PDF-1.4\n<< /Creator (eqt 0.0.1) >>"


def contents(folder="out"):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def finished(folder, default_result):
    """What `run` makes without a change lies in the folder `out`, and its configuration beside."""
    shutil.copytree(default_result.parent, folder, dirs_exist_ok=True)


def refusal(run, *overrides, **options):
    return error_of(run, *overrides, **options)


def test_what_it_holds(run):
    outcome = run()
    assert list(contents()) == ["config.yaml", "manifest.json", "results.h5"]
    manifest = json.loads(contents()["manifest.json"])
    keys = (
        "name digest points runs controllers plan config begun provenance finished seconds failed "
        "checksum"
    )
    assert set(manifest) == set(keys.split())
    assert (manifest["name"], manifest["runs"], manifest["failed"]) == ("c", 3, 0)
    steps = {"simulation", "writing", "cross-check"}
    assert set(manifest["seconds"]) == set(outcome.seconds) == steps


def test_its_configuration_is_that_of_the_experiment(finished):
    kept, given = build(read_config(Path("out/config.yaml"))), build(read_config(Path("c.yaml")))
    assert kept.resolved == given.resolved
    assert json.loads(contents()["manifest.json"])["digest"] == given.digest


def test_a_lost_result_is_made_again(finished, run):
    Path("out/results.h5").unlink()
    assert not run().was_complete
    assert "results.h5" in contents()


def test_another_experiment_is_refused_with_what_differs(finished, run):
    before = contents()
    changes = ["time.duration=2", "solver.block=1", "inertia=[[2, 0, 0.1], [0, 1, 0], [0.1, 0, 3]]"]
    law = "controllers[1]={kind: family, label: gt, gyroscopic: 0.5}"
    heading, *found, remedy = refusal(run, *changes, law).splitlines()
    assert says(heading, "out: holds another experiment…")
    assert {
        "  inertia[0]: 2.0 there, [2.0, 0.0, 0.1] here",
        "  controllers[1].kind: 'gt' there, 'family' here",
        "  time.duration: 1.0 there, 2.0 here",
        "  solver.block: not given there, 1 here",
    } <= {*found}
    assert len(found) == 12 and says(remedy, "…out=…force=True")
    assert contents() == before


def test_another_number_of_controllers_is_shown_as_a_whole(finished, run):
    assert says(
        refusal(run, "controllers=[eqt]").splitlines()[1],
        "  controllers: [{kind: 'eqt', label: 'eqt'}…: 'eqt'}] here",
    )


def test_force_replaces_and_says_what_it_removed(finished, run):
    Path("out/figures").mkdir()
    Path("out/figures/paper.pdf").write_bytes(OWN_FIGURE)
    Path("out/notes.txt").write_text("mine", encoding="utf-8")
    outcome = run("time.duration=2", force=True)
    assert outcome.removed == [
        f"out{os.sep}{name}" for name in ("results.h5", "figures", "config.yaml", "manifest.json")
    ]
    assert list(contents()) == ["config.yaml", "manifest.json", "notes.txt", "results.h5"]


def test_force_removes_no_drawing_or_page_of_others(finished, run):
    Path("out/figures/point_3").mkdir(parents=True)
    Path("out/figures/empty").mkdir()
    Path("out/figures/paper.pdf").write_bytes(OWN_FIGURE)
    Path("out/figures/point_3/paper.pdf").write_bytes(OWN_FIGURE)
    for name in ("figures/mine.pdf", "figures/paper.svg", "report.html"):
        Path("out", name).write_text("mine", encoding="utf-8")
    outcome = run("time.duration=2", force=True)
    assert [Path(path).as_posix() for path in outcome.removed] == (
        "out/results.h5 out/figures/paper.pdf out/figures/point_3 out/config.yaml out/manifest.json"
    ).split()
    kept = ["figures/mine.pdf", "figures/paper.svg", "report.html"]
    assert [contents()[str(Path(name))] for name in kept] == [b"mine"] * 3
    assert [path.name for path in sorted(Path("out/figures").iterdir())] == [
        "empty",
        "mine.pdf",
        "paper.svg",
    ]


def test_the_folder_of_other_results_takes_none_itself(finished, run):
    for name in ("a", "b", "c", "d"):
        Path("results", name).mkdir(parents=True)
        Path("results", name, "manifest.json").write_bytes(contents()["manifest.json"])
    for force in (False, True):
        assert refusal(run, out="results", force=force) == (
            "results: is the folder of other results: a, b, c, …; choose another folder with "
            f"out=…, such as {Path('results/c')}"
        )
    assert not Path("results/results.h5").exists()


def test_figures_alone_are_not_lost_either(finished, run):
    Path("out/figures").mkdir()
    Path("out/results.h5").unlink()
    assert refusal(run, "gains.kp=2") == (
        "out: holds another experiment, which differs in\n"
        "  gains.kp: 1.0 there, 2.0 here\n"
        "choose another folder with out=…, or replace it with force=True"
    )
    told = refusal(run, "ensemble.runs=7").splitlines()
    assert "keep the runs that are equal with grow=True, or replace" in told[-1]


def test_what_was_begun_and_left_without_results_is_replaced(finished, run):
    Path("out/results.h5").unlink()
    outcome = run("gains.kp=2")
    assert outcome.removed == []
    assert "kp: 2.0" in contents()["config.yaml"].decode()


@pytest.mark.parametrize("name", ["config.yaml", "results.h5", "manifest.json"])
@pytest.mark.parametrize("force", [False, True])
def test_files_of_others_are_never_replaced(run, name, force):
    Path("out").mkdir()
    Path("out", name).write_text("mine", encoding="utf-8")
    said = refusal(run, force=force)
    assert name in said and "choose another folder with out=…" in said
    assert contents() == {name: b"mine"}


def test_a_file_is_no_folder(run):
    Path("out").write_text("mine", encoding="utf-8")
    assert refusal(run) == (
        "out: cannot be used: not a directory; choose another folder with out=…"
    )


def test_a_folder_that_cannot_be_made(run, monkeypatch):
    def refused(self, *arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refused)
    assert refusal(run) == (
        "out: cannot be used: permission denied; choose another folder with out=…"
    )


def test_a_full_disk_leaves_no_half_result(run, monkeypatch):
    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert refusal(run) == (
        "out: cannot be used: no space left on device; choose another folder with out=…"
    )
    assert list(contents()) == []


def test_what_a_kill_after_packing_left_is_tidied_by_the_next_command(run, experiment):
    first = run("solver.max_steps=20")
    folder = first.folder
    manifest = folder.manifest
    (folder.path / "parts").mkdir()
    (folder.path / "parts/000001.npy").touch()
    (folder.path / ".lock").touch()
    for key in ("finished", "failed", "seconds"):
        del manifest[key]
    (folder.path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    again = run("solver.max_steps=20")
    assert again.was_complete
    assert again.failed == first.failed == 6
    assert sorted(path.name for path in folder.path.iterdir()) == [
        "config.yaml",
        "manifest.json",
        "results.h5",
    ]
    assert folder.manifest["failed"] == 6
    assert "finished" in folder.manifest


def test_what_another_process_is_about_is_left_to_it(run):
    folder = run().folder
    (folder.path / "parts").mkdir()
    with locked(folder.path):
        assert run().was_complete
        assert (folder.path / "parts").exists()


def test_a_name_that_is_not_utf_8_is_recorded_with_an_escape(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["eqt", "run", os.fsdecode(b"r\xe9sum\xe9.yaml")])
    assert provenance(tmp_path, {})["command"] == r"eqt run r\xe9sum\xe9.yaml"
