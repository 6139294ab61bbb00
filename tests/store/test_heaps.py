import struct
from mmap import ACCESS_READ, mmap

import pytest

from eqt_cli.store.safety import Refusal, read_heaps


def header(size):
    return b"GCOL\x01\0\0\0" + struct.pack("<Q", size)


def entry(index, size, room):
    return struct.pack("<HHIQ", index, 1, 0, size) + bytes(room)


@pytest.fixture
def read(tmp_path):
    def read(content, gaps=None):
        path = tmp_path / "heap"
        path.write_bytes(content)
        with path.open("rb") as stream, mmap(stream.fileno(), 0, access=ACCESS_READ) as view:
            return read_heaps(view, gaps or [(0, len(content))])

    return read


GOOD = header(88) + entry(3, 5, 8) + entry(1, 0, 0) + entry(0, 24, 8) + bytes(8)


def test_finds_every_string_of_every_collection(read):
    content = b"before" + GOOD + b"between" + GOOD
    assert read(content) == {6: {3: 5, 1: 0, 0: 24}, 101: {3: 5, 1: 0, 0: 24}}


def test_looks_only_where_no_data_are(read):
    content = GOOD + header(7)  # the second would be broken
    assert list(read(content, [(0, 88)])) == [0]


def test_refuses_a_collection_that_reaches_into_data(read):
    with pytest.raises(Refusal, match="its strings are damaged"):
        read(GOOD, [(0, 80)])


@pytest.mark.parametrize(
    "content",
    [
        header(32) + entry(0, 0, 0),
        header(32) + entry(0, 8, 0),
        header(64) + entry(1, 5, 8) + entry(1, 5, 8),
        header(40) + entry(1, 9, 16),
        header(32) + entry(1, 2**64 - 1, 0),
        header(8) + bytes(100),
        header(0) + bytes(100),
        header(200) + bytes(100),
        header(2**64 - 1) + bytes(100),
    ],
    ids=[
        "free space of no size, on which HDF5 loops",
        "free space smaller than its header",
        "an index twice",
        "an object beyond the end of the collection",
        "a size that wraps around 64 bits",
        "a collection smaller than its header",
        "a collection of no size",
        "a collection beyond the end of the file",
        "a collection that wraps around 64 bits",
    ],
)
def test_refuses_what_hdf5_would_trust(read, content):
    with pytest.raises(Refusal, match="its strings are damaged"):
        read(content)
