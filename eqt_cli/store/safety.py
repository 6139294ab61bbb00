"""Checks the heaps in which HDF5 keeps strings, because HDF5 trusts their contents.

A broken object size makes the HDF5 library loop for ever (its issue 1707, open in 2.0). Unlike the
rest of a result file, these heaps have no checksum.
"""

import re
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from math import prod
from mmap import mmap
from typing import Any

import h5py
import numpy as np

from eqt_cli.store.reserved_names import (
    COORDINATES,
    FORMAT_ATTRIBUTE,
    NAME,
    PLACEHOLDER,
    POINT,
    POINT_GROUP,
    RESERVED,
    VERSION_ATTRIBUTE,
    point_group,
)
from eqt_cli.store.writer import Attribute

_SIGNATURE = b"GCOL\x01"
_HEADER = 16  # size of the header of a collection, and of each object in it, bytes
_DAMAGED = "its strings are damaged"

Heaps = dict[int, dict[int, int]]
"""The sizes of all strings of a file: address of collection → index of object → bytes."""


class Refusal(Exception):
    """Raised for a refused file; the message follows the file's path in a sentence."""


def read_heaps(view: mmap, gaps: Iterable[tuple[int, int]]) -> Heaps:
    """Return the sizes of all strings in a file.

    Parameters
    ----------
    view
        The bytes of the file.
    gaps
        The spans, begin and end, outside the data of datasets, where data could look like heaps.

    Raises
    ------
    Refusal
        If the objects of a collection do not fill it exactly.
    """
    heaps = {}
    for begin, end in gaps:
        at = view.find(_SIGNATURE, begin, end)
        while at >= 0:
            stop = at + int.from_bytes(view[at + 8 : at + 16], "little")
            if stop > end:
                raise Refusal(_DAMAGED)
            heaps[at] = _objects(view, at + _HEADER, stop)
            at = view.find(_SIGNATURE, stop, end)
    return heaps


def _objects(view: mmap, at: int, stop: int) -> dict[int, int]:
    """Return the sizes in a collection; object 0, and a rest shorter than a header, are free."""
    sizes: dict[int, int] = {}
    while at + _HEADER <= stop:
        index, size = struct.unpack_from("<H6xQ", view, at)
        step = _HEADER + -(-size // 8) * 8 if index else size
        if index in sizes or step < _HEADER:
            raise Refusal(_DAMAGED)
        sizes[index] = size
        at += step
    if at > stop:
        raise Refusal(_DAMAGED)
    return sizes


_LINKS = {h5py.h5l.TYPE_SOFT: "a soft link", h5py.h5l.TYPE_EXTERNAL: "an external link"}
_OBJECTS = {h5py.h5o.TYPE_GROUP: "a group", h5py.h5o.TYPE_NAMED_DATATYPE: "a named type"}
_SHUFFLE, _DEFLATE = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE
_FILTERS: tuple[list[int], ...] = ([], [_DEFLATE], [_SHUFFLE, _DEFLATE])
# One byte of a deflate stream expands to at most 1032 bytes (RFC 1951: 258 bytes from 2 bits).
_DEFLATE_RATIO = 1032
_ATTACHMENT = np.dtype([("address", "<u8"), ("axis", "<u4"), ("padding", "<u4")])
_VERSION = re.compile(r"[0-9A-Za-z.+-]{1,32}")
_REFERENCE = np.dtype([("length", "<u4"), ("collection", "<u8"), ("index", "<u4")])


MOST_DATASETS = 1000
"""Largest number of datasets in the root or in a group of a point; eqt writes about 40."""


@dataclass(frozen=True)
class CheckedArray:
    """An array of a checked file."""

    dataset: Any
    dims: tuple[str, ...]
    attributes: dict[str, Attribute]
    is_text: bool


@dataclass(frozen=True)
class Contents:
    """Contents of a checked file or group; entries and dimensions are in the order of writing."""

    entries: dict[str, CheckedArray]
    coordinates: set[str]
    dimensions: dict[str, int]
    attributes: dict[str, Attribute]


def format_of(file: Any) -> int | None:
    """Return the number of eqt's layout, or None if eqt did not write the file."""
    number = _without_heap(file, FORMAT_ATTRIBUTE, h5py.h5t.INTEGER)
    return None if number is None else int(number)


def version_of(file: Any) -> str | None:
    """Return the version of eqt that wrote the file; None if it is missing or invalid."""
    version = bytes(_without_heap(file, VERSION_ATTRIBUTE, h5py.h5t.STRING) or b"")
    text = version.decode("ascii", "replace")
    return text if _VERSION.fullmatch(text) else None


def _without_heap(file: Any, name: str, kind: int) -> Any:
    """Return a single value that lies in no heap of strings; None if there is none of its kind."""
    if name not in file.attrs:
        return None
    handle = h5py.h5a.open(file.id, name.encode())
    is_kind = handle.shape == () and handle.get_type().get_class() == kind
    return None if not is_kind or _is_text(handle) else file.attrs[name]


def inspect(file: Any, view: mmap) -> tuple[Contents, Sequence[Callable[[], Contents]], Heaps]:
    """Check the structure, the heaps and the attributes of an open file, whose bytes are `view`.

    Returns its root, the groups of its points, and its heaps. The places of all datasets are
    checked here. Because there may be hundreds of groups, the attributes and dimensions of a group
    are checked when its point is first used.
    """
    size = len(view)
    version, offset_bytes, length_bytes = view[8:11]
    if version not in (2, 3) or (offset_bytes, length_bytes) != (8, 8):
        raise Refusal("it has an HDF5 layout without checksums")
    root = h5py.h5g.open(file.id, b"/")
    groups = _groups(root)
    inside = {raw for raw, _ in groups}
    datasets = _datasets(root, [raw for raw in root if raw not in inside], "")
    by_group = [_datasets(group, list(group), raw.decode() + "/") for raw, group in groups]
    heaps = _heaps([data for scope in (datasets, *by_group) for data in scope.values()], view)
    contents = _contents(file, datasets, size)
    if groups and contents.dimensions.get(POINT) != len(groups):
        raise Refusal(f"it has {len(groups)} groups of points, and another number of points")
    points = [
        cache(partial(_contents, h5py.Group(group), within, size))
        for (_, group), within in zip(groups, by_group, strict=True)
    ]
    return contents, points, heaps


def _contents(owner: Any, datasets: Mapping[str, Any], size: int) -> Contents:
    """Check the datasets of the root, or of one group."""
    labels = {name: _scale_label(dataset, size) for name, dataset in datasets.items()}
    scales = [name for name, label in labels.items() if label]
    stored = {k: v for k, v in datasets.items() if not labels[k].startswith(PLACEHOLDER)}
    for dataset in stored.values():
        if prod(dataset.shape) and not dataset.id.get_storage_size():
            where = dataset.name[1:]
            raise Refusal(f"'{where}' has the shape {dataset.shape} and holds no data")
    dims = _dimensions(datasets, scales)
    further = " ".join(
        str(attribute(dataset, COORDINATES, size))
        for dataset in stored.values()
        if COORDINATES in dataset.attrs
    )
    return Contents(
        entries={
            name: CheckedArray(
                dataset, dims[name], attributes_of(dataset, size), _is_text(dataset.id)
            )
            for name, dataset in stored.items()
        },
        coordinates={*scales, *further.split()},
        dimensions={name: len(datasets[name]) for name in scales},
        attributes=attributes_of(owner, size),
    )


def _heaps(datasets: Iterable[Any], view: mmap) -> Heaps:
    """Check the places of the datasets, and return the heaps of strings between them."""
    spans = [span for data in datasets for span in _spans(data.name[1:], data, len(view))]
    gaps, position = [], 0
    for begin, end in sorted(spans):
        if begin < position:
            raise Refusal("two of its datasets share the same bytes")
        gaps.append((position, begin))
        position = end
    gaps.append((position, len(view)))
    return read_heaps(view, gaps)


def attributes_of(owner: Any, size: int) -> dict[str, Attribute]:
    """Return the user's attributes of an open file or dataset."""
    names = [name for name in owner.attrs if name not in RESERVED]
    return {name: attribute(owner, name, size) for name in names}


def attribute(owner: Any, name: str, size: int) -> Attribute:
    """Return an attribute, which must be a single number or string."""
    handle = h5py.h5a.open(owner.id, name.encode())
    space, kind = handle.get_space(), handle.get_type()
    if space.get_simple_extent_npoints() != 1 or not _is_plain(kind, size):
        where = f" of '{owner.name[1:]}'" if owner.name != "/" else ""
        raise Refusal(f"its attribute {name!r}{where} is not one number or string")
    value = np.asarray(owner.attrs[name]).item()
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, str):
        value.encode()  # fails for bytes that are not UTF-8, which h5py accepts
    return value


def _is_plain(kind: Any, size: int) -> bool:
    """Whether a type is an integer, a float or a string of a plausible size."""
    if kind.get_class() == h5py.h5t.STRING:
        return bool(kind.is_variable_str() or kind.get_size() <= size)
    return _is_number(kind)


def _is_number(kind: Any) -> bool:
    return bool(kind.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT) and kind.get_size() <= 8)


def _groups(root: Any) -> list[tuple[bytes, Any]]:
    """Open the groups of the points; the root may hold only these and datasets."""
    groups = {}
    for raw in list(root):
        if POINT_GROUP.fullmatch(raw.decode()) and _kind(root, raw, "") == h5py.h5o.TYPE_GROUP:
            groups[raw] = h5py.h5g.open(root, raw)
    names = [point_group(k).encode() for k in range(len(groups))]
    if set(names) != set(groups):
        raise Refusal("its groups of points are not numbered from 0")
    return [(name, groups[name]) for name in names]


def _kind(parent: Any, raw: bytes, path: str) -> int:
    """Return the kind of the object of a name, without following a link out of the file."""
    name = raw.decode()
    if not NAME.fullmatch(name):
        raise Refusal(f"it holds something called {path + name!r}")
    link = parent.links.get_info(raw).type
    if link != h5py.h5l.TYPE_HARD:
        raise Refusal(f"'{path}{name}' is {_LINKS.get(link, 'an unknown kind of link')}")
    return int(h5py.h5o.get_info(parent, raw).type)


def _datasets(parent: Any, names: list[bytes], path: str) -> dict[str, Any]:
    """Open objects in `path`, which must all be datasets."""
    if len(names) > MOST_DATASETS:
        raise Refusal(f"it holds {len(names)} datasets in '{path or '/'}'")
    return {raw.decode(): _dataset(parent, raw, path) for raw in names}


def _dataset(parent: Any, raw: bytes, path: str) -> Any:
    kind, name = _kind(parent, raw, path), path + raw.decode()
    if kind != h5py.h5o.TYPE_DATASET:
        raise Refusal(f"'{name}' is {_OBJECTS.get(kind, 'an unknown kind of object')}")
    identifier = h5py.h5d.open(parent, raw)
    creation = identifier.get_create_plist()
    # This check comes first, because even the shape of a virtual dataset may open other files.
    if creation.get_layout() == h5py.h5d.VIRTUAL:
        raise Refusal(f"'{name}' is a virtual dataset")
    if creation.get_external_count():
        raise Refusal(f"'{name}' keeps its data in another file")
    if _filters(creation) not in _FILTERS:
        raise Refusal(f"'{name}' uses filters other than shuffle and gzip")
    if not (_is_text(identifier) or _is_number(identifier.get_type())):
        raise Refusal(f"'{name}' holds neither numbers nor variable-length strings")
    if identifier.get_space().get_simple_extent_type() == h5py.h5s.NULL:
        raise Refusal(f"'{name}' has no shape")
    return h5py.Dataset(identifier)


def _is_text(identifier: Any) -> bool:
    kind = identifier.get_type()
    return bool(kind.get_class() == h5py.h5t.STRING and kind.is_variable_str())


def _filters(creation: Any) -> list[int]:
    return [creation.get_filter(k)[0] for k in range(creation.get_nfilters())]


def _spans(name: str, dataset: Any, size: int) -> list[tuple[int, int]]:
    """Return the spans of a dataset's bytes in the file; refuse fewer bytes than its shape needs.

    A dataset that was never written has none, which is valid only for a dimension without values.
    """
    identifier, is_text = dataset.id, _is_text(dataset.id)
    creation = identifier.get_create_plist()
    layout = creation.get_layout()
    item = _REFERENCE.itemsize if is_text else identifier.get_type().get_size()
    declared, ratio = item * prod(dataset.shape), 1
    spans: list[tuple[int, int]] = []
    if layout == h5py.h5d.CONTIGUOUS:
        if (offset := identifier.get_offset()) is not None:
            spans.append((offset, offset + identifier.get_storage_size()))
    elif is_text:
        raise Refusal(f"'{name}' does not hold its strings in one piece")
    elif layout == h5py.h5d.CHUNKED:
        identifier.chunk_iter(lambda c: spans.append((c.byte_offset, c.byte_offset + c.size)))
        # Chunks are decoded completely, also those that extend beyond the shape.
        counts = zip(dataset.shape, creation.get_chunk(), strict=True)
        declared = item * prod(-(-length // chunk) * chunk for length, chunk in counts)
        ratio = _DEFLATE_RATIO if _filters(creation) else 1
    else:
        return []  # a compact dataset is part of the metadata, which have checksums and a limit
    if any(end > size for _, end in spans):
        raise Refusal(f"'{name}' lies beyond the end of the file")
    stored = sum(end - begin for begin, end in spans)
    if spans and declared > ratio * stored:
        raise Refusal(f"'{name}' declares {declared} bytes and holds {stored}")
    return spans


def _scale_label(dataset: Any, size: int) -> str:
    """Return the label of a dimension scale; empty for other datasets."""
    name = dataset.name[1:]
    if "CLASS" not in dataset.attrs or attribute(dataset, "CLASS", size) != "DIMENSION_SCALE":
        return ""
    if dataset.ndim != 1:
        raise Refusal(f"'{name}' is a dimension scale of shape {dataset.shape}")
    return str(attribute(dataset, "NAME", size)) if "NAME" in dataset.attrs else name


def _dimensions(datasets: Mapping[str, Any], scales: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the dimensions of each dataset, from the attachments stored with the scales.

    The datasets also hold them, but as references in a heap, which would have to be followed.
    """
    # Only these datasets count, so that a group cannot refer to another group.
    names = {h5py.h5o.get_info(dataset.id).addr: name for name, dataset in datasets.items()}
    dims = {name: [""] * dataset.ndim for name, dataset in datasets.items()}
    for scale in scales:
        dims[scale] = [scale]
        for address, axis in _attached(datasets[scale]):
            name = names.get(address, "")
            if not name or axis >= len(dims[name]) or dims[name][axis]:
                raise Refusal(f"'{datasets[scale].name[1:]}' is attached where it cannot be")
            dims[name][axis] = scale
    for name, dataset in datasets.items():
        for dim, length in zip(dims[name], dataset.shape, strict=True):
            if not dim:
                raise Refusal(f"'{dataset.name[1:]}' has an axis without a dimension")
            if datasets[dim].shape != (length,):
                has = f"{length} entries along '{dim}', which has {len(datasets[dim])}"
                raise Refusal(f"'{dataset.name[1:]}' has {has}")
    return {name: tuple(words) for name, words in dims.items()}


def _attached(scale: Any) -> list[tuple[int, int]]:
    """Return the addresses of the datasets that a scale is attached to, with the axes."""
    if "REFERENCE_LIST" not in scale.attrs:
        return []
    handle = h5py.h5a.open(scale.id, b"REFERENCE_LIST")
    kind = handle.get_type()
    if kind.get_class() != h5py.h5t.COMPOUND or kind.get_size() != _ATTACHMENT.itemsize:
        raise Refusal(f"'{scale.name[1:]}' is attached in an unknown way")
    raw = np.empty(handle.shape, f"V{_ATTACHMENT.itemsize}")
    handle.read(raw, kind)  # as bytes, so that no reference is followed
    return [(int(address), int(axis)) for address, axis, _ in raw.view(_ATTACHMENT)]


def check_text(dataset: Any, view: mmap, heaps: Heaps) -> None:
    """Refuse strings that are not in the file's heaps, or declare more text than the file has.

    Each string is a reference (length, address) into a heap. Many references to one long string
    could fill the memory from a small file, so their lengths are added up before HDF5 reads them.
    """
    offset = dataset.id.get_offset()
    if offset is None:
        return  # the dataset has no elements
    name = dataset.name[1:]
    references = np.frombuffer(view[offset : offset + dataset.id.get_storage_size()], _REFERENCE)
    total = 0
    for length, collection, index in references[references["collection"] != 0].tolist():
        if heaps.get(collection, {}).get(index, -1) < length:
            raise Refusal(f"'{name}' has damaged strings")
        total += length
    if total > len(view):
        raise Refusal(f"'{name}' declares {total} bytes of text in a file of {len(view)}")
