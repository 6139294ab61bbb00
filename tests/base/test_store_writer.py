import errno
import io
import os
import shutil
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from made_up import Table, write
from said import error_of

from eqt_cli.base.errors import ResultError
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.store_writer import Variable


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results.h5"


@pytest.mark.parametrize("compression", [None, "gzip"])
def test_xarray_opens_it_with_names_units_and_labels(path, table, compression):
    import xarray

    write(path, table, compression)
    with xarray.open_dataset(path, engine="h5netcdf") as dataset:
        sizes = {"controller": 2, "time": 11, "run": 5, "axis": 3, "message_text": 5}
        assert dict(dataset.sizes) == sizes
        assert set(dataset.data_vars) == set(table.variables)
        assert set(dataset.coords) == {"controller", "time", "message_text"}
        assert dataset.torque.dims == ("controller", "run", "time", "axis")
        assert dataset.torque.attrs == {"units": "N m", "long_name": "control torque τ"}
        assert dataset.attrs["config"] == "name: paper\n"
        assert dataset.time.dtype == np.float64
        chosen = dataset.sel(controller="gt")
        np.testing.assert_array_equal(chosen.torque, table.variables["torque"].data[1])
        messages = chosen.message_text.values[chosen.message]
        np.testing.assert_array_equal(messages, table.variables["message"].data[1])


def test_further_coordinates_are_coordinates_of_every_variable_along_them(path):
    import xarray

    point = Variable(("point",), np.array([0.5, 1.0]))
    table = Table(
        {
            "effort": Variable(("point", "run"), np.zeros((2, 3))),
            "time_step": Variable(("run",), np.zeros(3)),
        },
        {"gains.kp": point},
    )
    write(path, table)
    with xarray.open_dataset(path, engine="h5netcdf") as dataset:
        assert set(dataset.coords) == {"gains.kp"}
        assert set(dataset.effort.coords) == {"gains.kp"}
        assert set(dataset.time_step.coords) == set()
    with open_results(path) as results:
        assert results.coordinates == ("gains.kp",)
        assert results.names == ("effort", "time_step")
        np.testing.assert_array_equal(results.coordinate("gains.kp"), point.data)


def test_every_dimension_is_a_labelled_scale(path, table):
    write(path, table)
    with h5py.File(path) as file:
        for name, variable in table.variables.items():
            scales = [[scale.name for scale in dim.values()] for dim in file[name].dims]
            assert scales == [[f"/{dim}"] for dim in variable.dims]
        assert {h5py.h5ds.get_scale_name(file[dim].id) for dim in ("time", "run")} == {
            b"time",
            b"This is a netCDF dimension but not a netCDF variable.         5",
        }


def test_layout_is_that_of_hdf5_1_8(path, table):
    write(path, table)
    with h5py.File(path) as file:
        assert file.id.get_create_plist().get_version()[0] == 2  # of the superblock; 3 is 1.10's


def test_strings_have_one_length_and_numbers_stand_for_those_of_variables(path, table):
    write(path, table, "gzip")
    with h5py.File(path) as file:
        assert file["controller"].dtype == "S4"  # each ends with a NUL, as in C
        assert file["controller"].chunks is None
        assert file["controller"].asstr()[()].tolist() == ["eqt", "gt"]
        assert file["message"].dtype == "<i4"
        texts = file["message_text"].asstr("utf-8")[()]
        assert texts[file["message"][1]].tolist() == ["", "ok", "‖Q‖ = ∞", "a", "b"]
        assert file.attrs["config"] == b"name: paper\n"
        assert file["torque"].attrs["long_name"].decode() == "control torque τ"


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_both_engines_of_xarray_return_text(path, table, engine):
    import xarray

    if engine == "netcdf4":
        pytest.importorskip("netCDF4")
    labels = {"controller": Variable(("controller",), np.array(["", "ω₁"]))}
    write(path, replace(table, coordinates=labels))
    with xarray.open_dataset(path, engine=engine) as dataset:
        assert dataset.controller.values.tolist() == ["", "ω₁"]
        assert dataset.message_text.values.tolist() == ["", "a", "b", "ok", "‖Q‖ = ∞"]
        assert dataset.settling_time.attrs["units"] == "s"  # not a character


@pytest.mark.ci("starts Octave")
def test_octave_loads_the_whole_file(path, table):
    if not (octave := shutil.which("octave-cli")):
        pytest.skip("needs Octave")
    write(path, table)
    show = "printf('%s;', fieldnames(s){:}); printf('%.17g;', s.torque); disp(s.message_text(5, :))"
    command = [octave, "--norc", "--eval", f"s = load('{path}'); {show}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "warning" not in done.stderr
    *words, text = done.stdout.split(";")
    names = ["controller", "time", *table.variables, "run", "axis", "message_text"]
    assert sorted(words[: len(names)]) == sorted(names)
    torque = table.variables["torque"].data.ravel()
    np.testing.assert_array_equal(np.array(words[len(names) :], float), torque)
    assert text.strip() == "‖Q‖ = ∞"


@pytest.mark.parametrize("text", ["a\0b", "a\0"])
def test_a_nul_would_end_a_text(path, text):
    about = Table({}, attributes={"title": text})
    labels = Table({}, {"x": Variable(("x",), np.array([text], dtype=object))})
    for wrong in (about, labels):
        with pytest.raises(ValueError, match="texts in results hold no NUL"):
            write(path, wrong)
    assert list(path.parent.iterdir()) == []


def test_attributes_may_exceed_64_kb(path):
    text = "0123456789abcdé" * 13_000  # 208 kB in UTF-8; older layouts end at 64 kB
    write(path, Table({}, attributes={"config": text}))
    with open_results(path) as results:
        assert results.attributes["config"] == text


def test_gzip_takes_less_room(tmp_path):
    table = Table({"x": Variable(("run", "time"), np.zeros((500, 401)))})
    write(tmp_path / "plain.h5", table)
    write(tmp_path / "gzip.h5", table, "gzip")
    assert (tmp_path / "gzip.h5").stat().st_size < (tmp_path / "plain.h5").stat().st_size / 10


def test_gzip_chunks_share_the_outer_axis_equally(path):
    write(path, Table({"x": Variable(("run", "time"), np.zeros((500, 401)))}), "gzip")
    with h5py.File(path) as file:
        assert file["x"].chunks == (250, 401)  # 1 MiB holds 326 rows; two chunks are needed
        assert file["x"].shuffle


@pytest.mark.parametrize("step", ["fill", "flush", "rename"])
def test_a_failure_leaves_the_old_file_and_no_other(path, table, monkeypatch, step):
    def fail(*_, **__):
        raise OSError(errno.EIO, "Input/output error")

    path.write_text("old", encoding="utf-8")
    owner, name = {
        "fill": (h5py.File, "create_dataset"),
        "flush": (os, "fsync"),
        "rename": (Path, "replace"),
    }[step]
    monkeypatch.setattr(owner, name, fail)
    with pytest.raises(ResultError):
        write(path, table)
    assert [entry.name for entry in path.parent.iterdir()] == ["results.h5"]
    assert path.read_text(encoding="utf-8") == "old"


WITHIN_LIMIT = """
import resource, sys
import numpy as np
from eqt_cli.base.errors import ResultError
from eqt_cli.base.store_writer import Variable, assemble

wide = {"pose": Variable(("sample",), np.ones(200_000))}
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    with assemble(sys.argv[1], {"sample": 200_000}, {}, wide) as file:
        file.describe({"note": "x" * 2000})
except ResultError as error:
    print(error)
"""


AGAIN = pytest.mark.ci("starts an interpreter")


@pytest.mark.parametrize(
    "room", [pytest.param(500, marks=AGAIN), 4_000, pytest.param(1_000_000, marks=AGAIN)]
)
def test_a_full_disk_leaves_the_old_file_and_no_other(path, room):
    """The limit on file sizes fails within HDF5 as a full disk does: in a write or in closing.

    In a process of its own, since the limit would also meet whatever else the test run writes.
    """
    pytest.importorskip("resource", reason="only POSIX limits file sizes")
    path.write_text("old", encoding="utf-8")
    command = [sys.executable, "-c", WITHIN_LIMIT, str(path), str(room)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == (
        f"{path}: cannot be written: File too large; "
        "free some space or choose another folder with out=…\n"
    )
    assert [entry.name for entry in path.parent.iterdir()] == ["results.h5"]
    assert path.read_text(encoding="utf-8") == "old"


@pytest.mark.parametrize("call", [1, 3, 6])
def test_an_interruption_within_hdf5_waits_for_its_end(path, table, monkeypatch, call):
    calls = []

    class Interrupted(io.FileIO):
        def write(self, data):
            calls.append(data)
            if len(calls) == call:
                raise KeyboardInterrupt
            return super().write(data)

    monkeypatch.setattr(io, "FileIO", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(path, table)
    assert len(calls) == call
    assert list(path.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "reason", "remedy"),
    [
        (
            errno.ENOSPC,
            "No space left on device",
            "free some space or choose another folder with out=…",
        ),
        (errno.EACCES, "Permission denied", "choose a folder that you may write to with out=…"),
        (errno.EROFS, "Read-only file system", "choose a folder that you may write to with out=…"),
        (errno.EIO, "Input/output error", "check the folder {folder}"),
    ],
)
def test_the_error_says_what_to_do(path, table, monkeypatch, number, reason, remedy):
    def fail(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(ResultError) as caught:
        write(path, table)
    remedy = remedy.format(folder=path.parent)
    assert str(caught.value) == f"{path}: cannot be written: {reason}; {remedy}"


def test_a_missing_folder_is_named(tmp_path, table):
    path = tmp_path / "missing" / "results.h5"
    assert error_of(write, path, table, kind=ResultError) == (
        f"{path}: cannot be written: No such file or directory; "
        f"create the folder {path.parent} first"
    )


@pytest.fixture
def folder_fails(monkeypatch):
    """Let bringing a folder to the disk fail, but not a file."""
    synchronise = os.fsync

    def install(number):
        def fail(handle):
            if stat.S_ISDIR(os.fstat(handle).st_mode):
                raise OSError(number, os.strerror(number))
            synchronise(handle)

        monkeypatch.setattr(os, "fsync", fail)

    return install


def test_a_disk_that_cannot_synchronise_folders_is_no_failure(path, table, folder_fails):
    """Some network disks refuse it; the file itself is then complete all the same."""
    folder_fails(errno.EINVAL)
    write(path, table)
    assert path.exists()


def test_a_folder_that_does_not_reach_the_disk_is_a_failure(path, table, folder_fails):
    folder_fails(errno.EIO)
    with pytest.raises(ResultError, match="cannot be written: Input/output error"):
        write(path, table)


def test_a_text_takes_four_bytes_wherever_it_stands_again(tmp_path):
    for count in (1000, 2000):
        text = np.full(count, "after t = 1 s: a step became too small")
        write(tmp_path / f"{count}.h5", Table({"x": Variable(("run",), text)}))
    sizes = [(tmp_path / f"{count}.h5").stat().st_size for count in (1000, 2000)]
    assert sizes[1] - sizes[0] == 1000 * 4
    with open_results(tmp_path / "1000.h5") as results:
        assert results["x"].tolist() == [text[0]] * 1000


def test_dimensions_come_with_the_coordinates_first():
    time = Variable(("time",), np.zeros(3))
    table = Table({"x": Variable(("run", "time"), np.zeros((2, 3)))}, {"time": time})
    assert list(table.dimensions.items()) == [("time", 3), ("run", 2)]
