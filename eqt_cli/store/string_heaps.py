"""Checks the heaps in which HDF5 keeps strings, because HDF5 trusts their contents.

A broken object size makes the HDF5 library loop for ever (its issue 1707, open in 2.0). Unlike the
rest of a result file, these heaps have no checksum.
"""

from collections.abc import Iterable
from mmap import mmap

_SIGNATURE = b"GCOL\x01"
_HEADER = 16  # size of the header of a collection, and of each object in it, bytes


class BrokenHeapError(Exception):
    """Raised for a collection whose objects do not fill it exactly."""


def read_heaps(view: mmap, gaps: Iterable[tuple[int, int]]) -> dict[int, dict[int, int]]:
    """Return the sizes of all strings in a file: address of collection → index of object → bytes.

    Parameters
    ----------
    view
        The bytes of the file.
    gaps
        The spans, begin and end, outside the data of datasets, where data could look like heaps.

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
    """Return the sizes in a collection; object 0, and a rest shorter than a header, are free."""
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
