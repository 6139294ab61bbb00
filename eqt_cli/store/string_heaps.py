"""The heaps in which HDF5 keeps strings, walked here first because HDF5 trusts what it finds there.

A broken object size makes the HDF5 library loop for ever (its issue 1707, open in 2.0). Unlike the
rest of what eqt writes, these heaps carry no checksum. It must not know what the strings say.
"""

from collections.abc import Iterable
from mmap import mmap

_SIGNATURE = b"GCOL\x01"
_HEADER = 16  # of a collection, and of each object within


class BrokenHeapError(Exception):
    """A collection whose objects do not fill it exactly."""


def read_heaps(view: mmap, gaps: Iterable[tuple[int, int]]) -> dict[int, dict[int, int]]:
    """The sizes of all strings in a file: address of collection → index of object → bytes.

    Parameters
    ----------
    view
        The bytes of the file.
    gaps
        The spans, begin and end, that hold no data of datasets: only there a signature is one.

    Raises
    ------
    BrokenHeapError
        If a collection is broken.
    """
    heaps = {}
    for begin, end in gaps:
        at = view.find(_SIGNATURE, begin, end)
        while at >= 0:
            stop = at + _number(view, at + 8, 8)
            if stop > end:
                raise BrokenHeapError
            heaps[at] = _objects(view, at + _HEADER, stop)
            at = view.find(_SIGNATURE, stop, end)
    return heaps


def _objects(view: mmap, at: int, stop: int) -> dict[int, int]:
    """Walk one collection; a rest too small for a header is free, as is the object of index 0."""
    sizes: dict[int, int] = {}
    while at + _HEADER <= stop:
        index, size = _number(view, at, 2), _number(view, at + 8, 8)
        step = _HEADER + -(-size // 8) * 8 if index else size
        if index in sizes or step < _HEADER:
            raise BrokenHeapError
        sizes[index] = size
        at += step
    if at > stop:
        raise BrokenHeapError
    return sizes


def _number(view: mmap, at: int, size: int) -> int:
    return int.from_bytes(view[at : at + size], "little")
