"""A full disk: what cannot fit is refused before it is begun, and what is computed is not lost."""

import errno
import io
import os
import shutil
from pathlib import Path

import pytest
from said import error_of, says

from eqt_cli.base.errors import ConfigError, FullDiskError
from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.runs import preflight
from eqt_cli.runs.executors import _portable
from eqt_cli.runs.run_study import Shard, execute, pack_folder


@pytest.fixture(autouse=True)
def _small_parts(monkeypatch):
    """Parts of two runs, so that a small experiment has several."""
    monkeypatch.setattr("eqt_cli.config.study.PART_RUNS", 2)


@pytest.fixture
def begun(run):
    """Four parts of six runs; all are computed, and none is packed."""
    run("solver.block=2")  # writes c.yaml
    shutil.rmtree("out")
    found = study(read_config(Path("c.yaml"), ["solver.block=2"]))
    execute(found, Path("out"), shard=Shard(1, 1))
    return found, Path("out")


def full_when(monkeypatch, name):
    """Have no room for files of this name."""
    opened = io.FileIO

    class Full(opened):  # a name for the class that is replaced
        def write(self, data):
            if name in str(self.name):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return int(super().write(data))

    monkeypatch.setattr(io, "FileIO", Full)


@pytest.mark.ci("computes an experiment on a full disk")
def test_parts_and_result_are_counted_together(begun, monkeypatch):
    """What is estimated is less than what was written, and no less than half of it."""
    found, out = begun
    parts = sum(path.stat().st_size for path in (out / "parts").iterdir())
    assert parts / 2 < preflight.parts_size(found) < parts
    result = preflight.result_size(found)
    monkeypatch.setattr(
        preflight, "_free_disk", lambda folder: result + preflight.parts_size(found) - 1
    )
    assert says(
        error_of(preflight.check_resources, found, Path("new"), kind=ConfigError),
        "c.yaml:7:12: ensemble.runs: 46.1 kB are needed on the disk…",
    )
    preflight.check_resources(found, out, missing=0.5)  # the other half is there


def test_parts_that_are_there_are_not_counted_again(begun, monkeypatch):
    found, out = begun
    monkeypatch.setattr(preflight, "_free_disk", lambda folder: preflight.result_size(found))
    assert execute(found, out).packed


@pytest.mark.ci("computes an experiment on a full disk")
@pytest.mark.parametrize(
    ("name", "command"), [("results.h5", execute), ("manifest.json", pack_folder)]
)
def test_what_cannot_be_packed_is_kept(begun, monkeypatch, name, command):
    """Nothing is computed again: not here, and not on another disk."""
    found, out = begun
    with monkeypatch.context() as patch:
        full_when(patch, name)
        with pytest.raises(FullDiskError) as caught:
            command(found, out)
    said = {
        "results.h5": f"{out / name}: cannot be written: No space left on device",
        "manifest.json": f"{out}: cannot be used: no space left on device",
    }
    assert str(caught.value) == (
        f"{said[name]}; 6 of 6 runs are kept in out; free some space and run `eqt pack out`, or "
        "move the folder to another disk and run `eqt pack` there"
    )
    shutil.move(out, "other disk")
    monkeypatch.setattr("eqt_cli.runs.compute_part.compute_part", None)  # is not called
    moved = study(read_config(Path("other disk/config.yaml")))
    assert pack_folder(moved, Path("other disk")).packed
    assert Path("other disk/results.h5").exists()


@pytest.mark.ci("computes an experiment on a full disk")
def test_a_part_that_does_not_fit_tells_what_is_kept(begun, monkeypatch):
    found, out = begun
    (out / "parts/000002.npy").unlink()
    with monkeypatch.context() as patch:
        full_when(patch, "000002.npy")
        patch.setattr("eqt_cli.runs.run_study.UNSAVED_SECONDS", 0.0)
        with pytest.raises(FullDiskError) as caught:
            execute(found, out)
    assert str(caught.value) == (
        f"{out.resolve() / 'parts/000002.npy'}: cannot be written: No space left on device; 5 of 6 "
        "runs are kept in out; free some space and run the same command again, or move the folder "
        "to another disk and name it with out=…"
    )
    assert execute(found, out).resumed == 5


def test_the_error_of_a_worker_is_known_as_one_of_the_disk():
    assert isinstance(_portable(FullDiskError("x")), FullDiskError)


@pytest.mark.parametrize("step", ["write", "fsync"])
def test_a_new_configuration_is_whole_or_not_there(folder, invoke, monkeypatch, step):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        if step == "write":
            full_when(patch, "new.yaml")
        else:
            patch.setattr(os, "fsync", full)
        done = invoke("config", "new", "new.yaml", code=2)
    assert done.stderr == "eqt: error: new.yaml: cannot be written: no space left on device\n"
    assert not Path("new.yaml").exists()
    invoke("config", "new", "new.yaml")
