"""Checks on an untrusted HDF5 file before any of its data are read; it must not read data itself.

HDF5 lets a file point elsewhere and declare sizes that it does not hold. Only what eqt's own files
need is let through: datasets directly in the root, of numbers or strings, whose sizes agree with
the file's.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from eqt_cli.store.layout import COORDINATES, LABELS, PLACEHOLDER, RESERVED
from eqt_cli.store.variables import Attribute

_LINKS = {h5py.h5l.TYPE_SOFT: "a soft link", h5py.h5l.TYPE_EXTERNAL: "an external link"}
_OBJECTS = {h5py.h5o.TYPE_GROUP: "a group", h5py.h5o.TYPE_NAMED_DATATYPE: "a named type"}
_SHUFFLE, _DEFLATE = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE
_FILTERS: tuple[list[int], ...] = ([], [_DEFLATE], [_SHUFFLE, _DEFLATE])
# One byte of a deflate stream expands to at most 1032 bytes (RFC 1951: 258 bytes from 2 bits).
_DEFLATE_RATIO = 1032
_REFERENCE = np.dtype([("length", "<u4"), ("collection", "<u8"), ("index", "<u4")])


class Refusal(Exception):
    """What is wrong with a file, as the end of a sentence that begins with the file's path."""


@dataclass(frozen=True)
class Entry:
    """One dataset that passed the checks."""

    dataset: Any
    dims: tuple[str, ...]
    attributes: dict[str, Attribute]
    is_text: bool
    is_scale: bool
    is_placeholder: bool
    further_coordinates: tuple[str, ...]


def inspect(file: Any, size: int) -> dict[str, Entry]:
    """Every dataset of the open `file` of `size` bytes, by name, in the order of writing."""
    root = h5py.h5g.open(file.id, b"/")
    return {raw.decode(): _entry(root, raw, size) for raw in list(root)}


def attributes_of(owner: Any, size: int) -> dict[str, Attribute]:
    """The user's attributes of an open file or dataset."""
    names = [name for name in owner.attrs if name not in RESERVED]
    return {name: attribute(owner, name, size) for name in names}


def attribute(owner: Any, name: str, size: int) -> Attribute:
    """One attribute, which must be a single number or string."""
    handle = h5py.h5a.open(owner.id, name.encode())
    space, kind = handle.get_space(), handle.get_type()
    if space.get_simple_extent_npoints() != 1 or not _is_plain(kind, size):
        raise Refusal(f"its attribute '{name}' is not one number or string")
    value = np.asarray(owner.attrs[name]).reshape(())[()]
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, str):
        return str(value)
    number: int | float = value.item()
    return number


def _is_plain(kind: Any, size: int) -> bool:
    """Whether a type is an integer, a float or a string, no larger than makes sense."""
    if kind.get_class() == h5py.h5t.STRING:
        return bool(kind.is_variable_str() or kind.get_size() <= size)
    return _is_number(kind)


def _is_number(kind: Any) -> bool:
    return bool(kind.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT) and kind.get_size() <= 8)


def _entry(root: Any, raw: bytes, size: int) -> Entry:
    name = raw.decode()
    link = root.links.get_info(raw).type
    if link != h5py.h5l.TYPE_HARD:
        raise Refusal(f"'{name}' is {_LINKS.get(link, 'an unknown kind of link')}")
    kind = h5py.h5o.get_info(root, raw).type
    if kind != h5py.h5o.TYPE_DATASET:
        raise Refusal(f"'{name}' is {_OBJECTS.get(kind, 'an unknown kind of object')}")
    identifier = h5py.h5d.open(root, raw)
    _check_storage_kind(name, identifier)
    is_text = _check_type(name, identifier)
    shape = _shape(name, identifier)
    dataset = h5py.Dataset(identifier)
    scale = ""
    if "CLASS" in dataset.attrs and attribute(dataset, "CLASS", size) == "DIMENSION_SCALE":
        scale = str(attribute(dataset, "NAME", size)) if "NAME" in dataset.attrs else name
        if len(shape) != 1:
            raise Refusal(f"'{name}' is a dimension scale of shape {shape}")
    is_placeholder = scale.startswith(PLACEHOLDER)
    if not is_placeholder:
        _check_size(name, identifier, shape, is_text, size)
    further = ""
    if COORDINATES in dataset.attrs:
        further = str(attribute(dataset, COORDINATES, size))
    return Entry(
        dataset=dataset,
        dims=(name,) if scale else _labels(name, dataset, len(shape)),
        attributes=attributes_of(dataset, size),
        is_text=is_text,
        is_scale=bool(scale),
        is_placeholder=is_placeholder,
        further_coordinates=tuple(further.split()),
    )


def _check_storage_kind(name: str, identifier: Any) -> None:
    """First of all: asking a virtual dataset even for its shape may open other files."""
    creation = identifier.get_create_plist()
    if creation.get_layout() == h5py.h5d.VIRTUAL:
        raise Refusal(f"'{name}' is a virtual dataset")
    if creation.get_external_count():
        raise Refusal(f"'{name}' keeps its data in another file")
    if _filters(creation) not in _FILTERS:
        raise Refusal(f"'{name}' uses filters other than shuffle and gzip")


def _filters(creation: Any) -> list[int]:
    return [creation.get_filter(k)[0] for k in range(creation.get_nfilters())]


def _check_type(name: str, identifier: Any) -> bool:
    kind = identifier.get_type()
    if kind.get_class() == h5py.h5t.STRING and kind.is_variable_str():
        return True
    if not _is_number(kind):
        raise Refusal(f"'{name}' holds neither numbers nor variable-length strings")
    return False


def _shape(name: str, identifier: Any) -> tuple[int, ...]:
    space = identifier.get_space()
    if space.get_simple_extent_type() == h5py.h5s.NULL:
        raise Refusal(f"'{name}' has no shape")
    return tuple(map(int, space.get_simple_extent_dims()))


def _check_size(
    name: str, identifier: Any, shape: tuple[int, ...], is_text: bool, size: int
) -> None:
    """Compare the bytes that a dataset declares with those that it has, and with the file's."""
    creation = identifier.get_create_plist()
    layout = creation.get_layout()
    item = _REFERENCE.itemsize if is_text else identifier.get_type().get_size()
    declared, stored = item * prod(shape), identifier.get_storage_size()
    most = stored
    if is_text and layout != h5py.h5d.CONTIGUOUS:
        raise Refusal(f"'{name}' holds strings in chunks")
    if layout == h5py.h5d.CHUNKED:
        # Whole chunks are decoded, also those that reach beyond the edge.
        counts = zip(shape, creation.get_chunk(), strict=True)
        declared = item * prod(-(-length // chunk) * chunk for length, chunk in counts)
        most *= _DEFLATE_RATIO if _filters(creation) else 1
    elif layout == h5py.h5d.CONTIGUOUS and stored:
        offset = identifier.get_offset()
        if offset is None or offset + stored > size:
            raise Refusal(f"'{name}' lies beyond the end of the file")
    if declared > most or stored > size or (is_text and declared != stored):
        raise Refusal(
            f"'{name}' declares {declared} bytes and has {min(stored, size)} in a file of {size}"
        )


def _labels(name: str, dataset: Any, rank: int) -> tuple[str, ...]:
    if rank == 0:
        return ()
    if LABELS not in dataset.attrs:
        raise Refusal(f"'{name}' does not name its dimensions")
    handle = h5py.h5a.open(dataset.id, LABELS.encode())
    kind = handle.get_type()
    if handle.shape != (rank,) or kind.get_class() != h5py.h5t.STRING:
        raise Refusal(f"'{name}' does not name each of its {rank} dimensions once")
    labels = dataset.attrs[LABELS]
    return tuple(map(str, labels))


def check_text_lengths(dataset: Any, path: Path, size: int) -> None:
    """Refuse strings that claim more room together than the file has.

    Each string is a reference (length, address) into the file. Many references to one long string
    would fill the memory from a small file, so their lengths are added up before HDF5 follows them.
    """
    offset = dataset.id.get_offset()
    if offset is None:
        return  # no element was ever written: all are empty
    references = np.fromfile(path, dtype=_REFERENCE, count=dataset.size, offset=offset)
    total = int(references["length"].sum(dtype=np.uint64))
    if total > size:
        name = dataset.name.lstrip("/")
        raise Refusal(f"'{name}' declares {total} bytes of text in a file of {size}")
