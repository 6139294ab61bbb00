"""Files that nobody should have to trust; each is made with h5py, or by spoiling bytes."""

import os
import struct

import h5py
import numpy as np
import pytest
from made_up import Table, write
from said import says

from eqt_cli.base.errors import ResultError
from eqt_cli.base.files import SEAL
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.store_writer import Variable
from eqt_cli.base.stored import FORMAT
from eqt_cli.base.version import __version__

AGAIN = "copy it again or run the experiment again"


@pytest.fixture(scope="module")
def content(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("written") / "results.h5"
    write(path, table)
    return path.read_bytes()


@pytest.fixture
def path(tmp_path, content):
    (tmp_path / "results.h5").write_bytes(content)
    return tmp_path / "results.h5"


def refusal(path):
    with pytest.raises(ResultError) as caught, open_results(path):
        pass
    return str(caught.value)


def refused_as(path, reason):
    return f"{path}: refused: {reason}; eqt writes no such file: {AGAIN}"


def unsealed(path):
    """The bytes of a file without its checksum, as a stranger may write it."""
    return path.read_bytes().partition(SEAL)[0]


def spoil(path, old, new):
    """Replace the only occurrence of some bytes."""
    content = unsealed(path)
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))


def test_a_missing_path(tmp_path):
    path = tmp_path / "none"
    assert refusal(path) == f"{path}: not found; give a result folder or its results.h5"


def test_a_folder_without_results(tmp_path):
    assert refusal(tmp_path) == (
        f"{tmp_path}: the folder holds no results.h5; run its experiment to the end first"
    )


def test_a_pipe_is_not_waited_for(tmp_path):
    path = tmp_path / "results.h5"
    os.mkfifo(path)
    assert refusal(tmp_path) == f"{path}: is not a file; give a result folder or its results.h5"


def test_a_path_through_a_file(path):
    below = path / "results.h5"
    assert refusal(below) == (
        f"{below}: cannot be read: Not a directory; check the path and its permissions"
    )


@pytest.mark.parametrize("content", [b"", b"\x89HDF", b"name: paper\n", bytes(range(256)) * 40])
def test_a_file_of_another_kind(tmp_path, content):
    path = tmp_path / "results.h5"
    path.write_bytes(content)
    assert refusal(path) == f"{path}: is not an HDF5 file; give the results.h5 that eqt wrote"


def test_an_hdf5_file_of_another_program(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["group/data"] = 1.0
    assert says(refusal(path), f"{path}: is an HDF5 file, but not one…'s (it has no attribute '…")


@pytest.mark.parametrize(
    ("version", "said"),
    [
        (np.bytes_("0.9.1"), "eqt 0.9.1"),
        (np.bytes_("\x1b[31m"), "the version of eqt that wrote it"),
        ("0.9.1" * 1000, "the version of eqt that wrote it"),
        (7, "the version of eqt that wrote it"),
        (None, "the version of eqt that wrote it"),
    ],
)
def test_another_format(path, version, said):
    with h5py.File(path, "r+") as file:
        assert file.attrs["eqt_version"] == __version__.encode()
        file.attrs["eqt_format"] = 1
        del file.attrs["eqt_version"]
        if version is not None:
            file.attrs["eqt_version"] = version
    assert refusal(path) == (
        f"{path}: has format 1, but eqt {__version__} reads format {FORMAT}; read it with {said}"
    )


@pytest.mark.parametrize("kept", [0.25, 0.9, -1 - len(SEAL) - 4])
def test_a_file_cut_short(path, kept):
    content = path.read_bytes()
    path.write_bytes(content[: kept if kept < 0 else int(kept * len(content))])
    assert refusal(path) == f"{path}: is cut short; {AGAIN}"


def test_only_a_signature(tmp_path):
    path = tmp_path / "results.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + np.random.default_rng(0).bytes(5000))
    assert refusal(path) == f"{path}: is damaged; {AGAIN}"


def test_spoiled_metadata(path):
    spoil(path, b"control torque", b"cOntrol torque")
    assert refusal(path) == f"{path}: is damaged; {AGAIN}"


def test_text_that_is_no_utf8(path):
    with h5py.File(path, "r+") as file:
        file["torque"].attrs["long_name"] = np.bytes_(b"\xffontrol torque")
    assert refusal(path) == f"{path}: is damaged; {AGAIN}"


def _virtual(file):
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource("/etc/other.h5", "data", (5,))
    file.create_virtual_dataset("evil", layout)


def _two_deflations(file):
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk((50,))
    creation.set_deflate(9)
    creation.set_deflate(9)
    kind, space = h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple((50,))
    h5py.h5d.create(file.id, b"evil", kind, space, creation)


def _one_compressed_chunk_of_many(file):
    file.create_dataset("evil", (2**34,), "f8", chunks=(1000,), compression="gzip")[:1000] = 1.0


def _of_another_size(file):
    file["evil"] = np.zeros(6)
    file["evil"].dims[0].attach_scale(file["run"])


def _attached_to_no_dataset(file):
    attached = file["run"].attrs["REFERENCE_LIST"]
    attached[0] = (file.ref, 0)
    file["run"].attrs["REFERENCE_LIST"] = attached


def _attached_beyond_the_last_axis(file):
    attached = file["run"].attrs["REFERENCE_LIST"]
    attached[0] = (attached[0][0], 4)
    file["run"].attrs["REFERENCE_LIST"] = attached


def _attached_by_text(file):
    del file["run"].attrs["REFERENCE_LIST"]
    file["run"].attrs["REFERENCE_LIST"] = "torque"


def _scale_with_two_axes(file):
    file["evil"] = np.zeros((5, 5))
    file["evil"].make_scale("evil")


def holding(value):
    return lambda file: file.update(evil=value)


def dataset(**options):
    return lambda file: file.create_dataset("evil", **options)


NO_KIND = "'evil' holds neither numbers nor strings of fixed length"
OTHER_FILTERS = "'evil' uses filters other than shuffle and gzip"
MISPLACED = "'run' is attached where it cannot be"
NOT_ONE = "its attribute 'evil' of 'torque' is not one number or string of fixed length"
FOREIGN = h5py.ExternalLink("/etc/other.h5", "/data")
COMPOUND = np.zeros(5, dtype=[("a", "f8"), ("b", "i4")])
STORED = [("/etc/passwd", 0, 40)]
EVIL = {
    "soft link": (holding(h5py.SoftLink("/torque")), "'evil' is a soft link"),
    "external link": (holding(FOREIGN), "'evil' is an external link"),
    "named type": (holding(np.dtype("f8")), "'evil' is a named type"),
    "compound": (holding(COMPOUND), NO_KIND),
    "text of variable length": (dataset(shape=2, dtype=h5py.string_dtype()), NO_KIND),
    "an attribute of variable length": (
        lambda file: file["torque"].attrs.create("evil", "text"),
        NOT_ONE,
    ),
    "no shape": (holding(h5py.Empty("f8")), "'evil' has no shape"),
    "without dimension": (holding(np.zeros(5)), "'evil' has an axis without a dimension"),
    "external storage": (
        dataset(shape=5, dtype="f8", external=STORED),
        "'evil' keeps its data in another file",
    ),
    "other filter": (dataset(data=np.zeros(50), compression="lzf"), OTHER_FILTERS),
    "two deflations": (_two_deflations, OTHER_FILTERS),
    "beyond 64 bits": (
        dataset(shape=(2**40, 2**40), dtype="f8", chunks=(1000, 1000)),
        f"'evil' declares {2**83} bytes and holds 0",
    ),
    "one compressed chunk of many": (
        _one_compressed_chunk_of_many,
        "'evil' declares 137438953472 bytes and holds 41",
    ),
    "text in chunks": (
        dataset(shape=5, dtype="S4", chunks=(5,)),
        "'evil' does not hold its strings in one piece",
    ),
    "group": (lambda file: file.create_group("evil"), "'evil' is a group"),
    "strange name": (
        lambda file: file.create_dataset("\x1b[31m", data=1.0),
        "it holds something called '\\x1b[31m'",
    ),
    "virtual": (_virtual, "'evil' is a virtual dataset"),
    "another size": (_of_another_size, "'evil' has 6 entries along 'run', which has 5"),
    "two dimensions on an axis": (
        lambda file: file["torque"].dims[0].attach_scale(file["run"]),
        MISPLACED,
    ),
    "attached to no dataset": (_attached_to_no_dataset, MISPLACED),
    "attached beyond the last axis": (_attached_beyond_the_last_axis, MISPLACED),
    "attached by text": (_attached_by_text, "'run' is attached in an unknown way"),
    "scale with two axes": (_scale_with_two_axes, "'evil' is a dimension scale of shape (5, 5)"),
    "twice the same": (
        lambda file: file.update(evil=file["torque"]),
        "'torque' has another name, too",
    ),
    "huge attribute": (lambda file: file["torque"].attrs.create("evil", np.zeros(10**6)), NOT_ONE),
}
"""What eqt never writes: how it comes into a file, and what is said of it."""


@pytest.mark.parametrize("case", EVIL)
def test_what_eqt_never_writes_is_refused(path, case):
    build, reason = EVIL[case]
    with h5py.File(path, "r+") as file:
        build(file)
    assert refusal(path) == refused_as(path, reason)


def test_the_layout_without_checksums(tmp_path):
    path = tmp_path / "results.h5"
    with h5py.File(path, "w", libver=("earliest", "v108")) as file:
        file.attrs["eqt_format"] = FORMAT
    assert refusal(path) == refused_as(path, "it has an HDF5 layout without checksums")


@pytest.mark.parametrize(
    "head", [struct.pack("<HHIQ", 0, 0, 0, 0), struct.pack("<HHIQ", 1, 1, 0, 2**64 - 16)]
)
def test_a_heap_without_end_is_not_walked(path, head):
    """HDF5 itself does so for ever (its issue 1707)."""
    with h5py.File(path, "r+") as file:
        file["torque"].attrs["note"] = "to find"
    content = unsealed(path)
    path.write_bytes(content[: (at := content.index(b"to find") - 16)] + head + content[at + 16 :])
    reason = NOT_ONE.replace("evil", "note")
    assert refusal(path) == refused_as(path, reason)


@pytest.mark.parametrize(
    ("name", "value"), [("message", 5), ("message", -6), ("message_text", b"\xff")]
)
def test_numbers_without_a_text(path, name, value):
    with h5py.File(path, "r+") as file:
        file[name][-1] = value
    with open_results(path) as results, pytest.raises(ResultError) as caught:
        results["message"]
    assert str(caught.value) == f"{path}: 'message' is damaged; {AGAIN}"


def test_spoiled_compressed_data(tmp_path, table):
    path = tmp_path / "results.h5"
    write(path, table, "gzip")
    with h5py.File(path) as file:
        chunk = file["torque"].id.get_chunk_info(0)
    content = bytearray(unsealed(path))
    content[chunk.byte_offset : chunk.byte_offset + 20] = bytes(20)
    path.write_bytes(content)
    with open_results(path) as results, pytest.raises(ResultError) as caught:
        results["torque"]
    assert str(caught.value) == f"{path}: 'torque' is damaged; {AGAIN}"


def test_a_file_that_becomes_shorter_while_it_is_open(path):
    write(path, Table({"torque": Variable(("time",), np.zeros(100_000))}))  # beyond any buffer
    with h5py.File(path) as file:
        offset = file["torque"].id.get_offset()
    with open_results(path) as results:
        os.truncate(path, offset + 8)
        with pytest.raises(ResultError) as caught:
            results["torque"]
    assert str(caught.value) == f"{path}: 'torque' is damaged; {AGAIN}"


def test_more_than_the_memory_holds(path, monkeypatch):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr(h5py.Dataset, "__getitem__", fail)
    with open_results(path) as results, pytest.raises(ResultError) as caught:
        results["torque"]
    assert str(caught.value) == f"{path}: 'torque' does not fit the memory; read it in parts"
