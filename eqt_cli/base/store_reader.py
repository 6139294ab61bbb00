"""Reads result files, which may be damaged or hostile: their structure is checked first."""

import operator
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from math import prod
from mmap import ACCESS_READ, mmap
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from eqt_cli.base import files
from eqt_cli.base.errors import Remedy, ResultError, suggestion
from eqt_cli.base.store_writer import Attribute
from eqt_cli.base.version import __version__

# Checks the heaps in which HDF5 keeps strings, because HDF5 trusts their contents -----------------
#
# A broken object size makes the HDF5 library loop for ever (its issue 1707, open in 2.0). Unlike
# the rest of a result file, these heaps have no checksum.


_COLLECTION = b"GCOL\x01"
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
        at = view.find(_COLLECTION, begin, end)
        while at >= 0:
            stop = at + int.from_bytes(view[at + 8 : at + 16], "little")
            if stop > end:
                raise Refusal(_DAMAGED)
            heaps[at] = _objects(view, at + _HEADER, stop)
            at = view.find(_COLLECTION, stop, end)
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
    number = _without_heap(file, files.FORMAT_ATTRIBUTE, h5py.h5t.INTEGER)
    return None if number is None else int(number)


def version_of(file: Any) -> str | None:
    """Return the version of eqt that wrote the file; None if it is missing or invalid."""
    version = bytes(_without_heap(file, files.VERSION_ATTRIBUTE, h5py.h5t.STRING) or b"")
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
    if groups and contents.dimensions.get(files.POINT) != len(groups):
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
    stored = {k: v for k, v in datasets.items() if not labels[k].startswith(files.PLACEHOLDER)}
    for dataset in stored.values():
        if prod(dataset.shape) and not dataset.id.get_storage_size():
            where = dataset.name[1:]
            raise Refusal(f"'{where}' has the shape {dataset.shape} and holds no data")
    dims = _dimensions(datasets, scales)
    further = " ".join(
        str(attribute(dataset, files.COORDINATES, size))
        for dataset in stored.values()
        if files.COORDINATES in dataset.attrs
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
    names = [name for name in owner.attrs if name not in files.RESERVED]
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
        if (
            files.POINT_GROUP.fullmatch(raw.decode())
            and _kind(root, raw, "") == h5py.h5o.TYPE_GROUP
        ):
            groups[raw] = h5py.h5g.open(root, raw)
    names = [files.point_group(k).encode() for k in range(len(groups))]
    if set(names) != set(groups):
        raise Refusal("its groups of points are not numbered from 0")
    return [(name, groups[name]) for name in names]


def _kind(parent: Any, raw: bytes, path: str) -> int:
    """Return the kind of the object of a name, without following a link out of the file."""
    name = raw.decode()
    if not files.NAME.fullmatch(name):
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


# Reads result files safely, even files from others ------------------------------------------------


Positions = int | slice | Sequence[int] | NDArray[np.integer[Any]]
"""Positions along one dimension; counted from the end when negative, as in NumPy."""

Selection = Positions | str | Sequence[str]
"""Positions along one dimension, or labels."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_AGAIN = "copy it again or run the experiment again"
_RESTORE = f"eqt writes no such file: {_AGAIN}"


class ResultFile:
    """An open result file; arrays are read from the disk each time they are requested.

    Parameters
    ----------
    path
        The file, or the result folder that holds it.
    oldest
        The oldest format that is read.

    Attributes
    ----------
    path : Path
        The file itself.
    attributes : Mapping
        The attributes of the whole file.
    dimensions : Mapping
        The size of every dimension.
    names, coordinates : tuple of str
        The variables and the coordinates, in the order of writing.
    """

    of_all_points: tuple[str, ...] = (*"path _view _file _root _points _heaps _open".split(),)
    """Attributes that a view of one point shares."""

    def __init__(self, path: str | Path, oldest: int = files.FORMAT) -> None:
        self.path = path = _find(Path(path))
        with ExitStack() as stack, _guard(path):
            stream = stack.enter_context(files.open_regular(path))
            self._view = stack.enter_context(mmap(stream.fileno(), 0, access=ACCESS_READ))
            # No locks: result files never change, and some network disks refuse to lock.
            self._file = stack.enter_context(_opened(path))
            _check_format(path, format_of(self._file), version_of(self._file), oldest)
            self._root, self._points, self._heaps = inspect(self._file, self._view)
            if files.is_intact(self._view) is False:
                raise ResultError(f"{path}: is damaged: its checksum differs; {_AGAIN}")
            self.attributes: Mapping[str, Attribute] = _Attributes(path, self._root.attributes)
            self._show(self._root)
            self._check()
            self._open = stack.pop_all()

    def _check(self) -> None:
        """Refuse attributes and coordinates that eqt does not write; here, any are accepted."""

    def _show(self, contents: Contents, fixed: Mapping[str, int] | None = None) -> None:
        """Show the root or a group, at a position along the `fixed` dimensions."""
        self._fixed = fixed or {}
        self._entries = {
            name: entry
            for name, entry in contents.entries.items()
            if not (self._fixed and set(entry.dims) <= set(self._fixed))
        }
        self.dimensions: Mapping[str, int] = MappingProxyType(
            {dim: size for dim, size in contents.dimensions.items() if dim not in self._fixed}
        )
        self.coordinates = tuple(k for k in self._entries if k in contents.coordinates)
        self.names = tuple(k for k in self._entries if k not in contents.coordinates)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; nothing can be read from it afterwards."""
        self._open.close()

    # One point of a sweep.

    def at(self, point: int, attributes: Mapping[str, Attribute] | None = None) -> Self:
        """Return one point of a sweep, as the result of a single experiment.

        It has no dimension ``point``, no swept keys, and the shapes of this point. Both results
        read from the same file: closing one closes the other.

        Parameters
        ----------
        point
            The number of the point, from 0.
        attributes
            Attributes of this point, which replace those of the sweep.

        Raises
        ------
        ResultError
            If there is no such point.
        """
        points = self.dimensions.get(files.POINT)
        if points is None:
            raise ResultError(f"{self.path}: is not a sweep; leave the point out")
        if not 0 <= point < points:
            raise ResultError(f"{self.path}: has no point {point}; choose one of 0 to {points - 1}")
        view = type(self).__new__(type(self))  # which has computed nothing of another point
        for name in (name for name in self.of_all_points if hasattr(self, name)):
            setattr(view, name, getattr(self, name))
        merged = dict(self.attributes)
        if self._points:
            with _guard(self.path):
                contents = self._points[point]()
            merged |= contents.attributes
            view._show(contents)
        else:
            view._show(self._root, {files.POINT: point})
        view.attributes = _Attributes(self.path, merged | dict(attributes or {}))
        if self._points:  # each group has its own attributes and coordinates
            view._check()
        return view

    def single(self, what: str) -> Self:
        """Return this result, unless it is a sweep; `what` says what takes no sweep.

        Raises
        ------
        ResultError
            If it is a sweep; the message says how to choose a point.
        """
        points = self.dimensions.get(files.POINT)
        if points is not None:
            raise ResultError(
                f"{self.path}: {what}, and this is a sweep of {points} points",
                Remedy(
                    f"choose one of 0 to {points - 1} with {{}}, as `eqt show {self.path.parent} "
                    "--table metrics` lists them",
                    "point",
                ),
            )
        return self

    @property
    def has_groups(self) -> bool:
        """Whether the points differ in shape, so that each has its arrays in a group."""
        return bool(self._points) and files.POINT in self.dimensions

    def refusal(self, reason: str) -> ResultError:
        """Return the error for a feature that eqt's files do not have."""
        return _refused(self.path, reason)

    # Reading.

    def has(self, name: str) -> bool:
        """Whether the file holds a variable or coordinate of this name."""
        return name in self._entries

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a whole variable or coordinate; strings are an object array of `str`."""
        return self.read(name)

    def coordinate(self, name: str) -> NDArray[Any]:
        """Return the values of a coordinate, usually one per position along its dimension."""
        if name not in self.coordinates:
            raise ResultError(
                f"{self.path}: holds no coordinate '{name}'{suggestion(name, self.coordinates)}; "
                f"its coordinates are: {', '.join(self.coordinates)}"
            )
        return self.read(name)

    def read(self, name: str, /, **selection: Selection) -> NDArray[Any]:
        """Return part of a variable or coordinate, and read no more than this from the disk.

        Parameters
        ----------
        name
            The variable.
        **selection
            The positions to read along some dimensions: an integer (which drops the axis), a slice,
            or a list of integers in any order. If the coordinate of the dimension is text, labels
            may replace positions: ``controller="eqt"``.

        Raises
        ------
        ResultError
            If there is no such variable, dimension, position or label, or its data are damaged.
        """
        entry, dims = self._entry(name), self.dims(name)
        for dim in selection:
            if dim not in dims:
                raise ResultError(
                    f"{self.path}: '{name}' has no dimension '{dim}'"
                    f"{suggestion(dim, dims)}; its dimensions are: {', '.join(dims)}"
                )
        positions: list[int | slice | NDArray[Any]] = []
        for dim in entry.dims:
            if dim in self._fixed:
                positions.append(self._fixed[dim])
                continue
            place = f"{self.path}: '{name}': {dim}"
            chosen = self._labelled(place, dim, selection.get(dim))
            positions.append(_positions(place, chosen, self.dimensions[dim]))
        if not self._file:
            raise ResultError(f"{self.path}: is closed; read within its `with` block")
        with _guard(self.path, name):
            if entry.is_text:
                check_text(entry.dataset, self._view, self._heaps)
                return _read(entry.dataset.asstr(), positions).astype(object)
            return _read(entry.dataset, positions)

    def _labelled(self, place: str, dim: str, selection: Selection | None) -> Positions | None:
        """Return a selection with positions in place of labels."""
        if isinstance(selection, str):
            return self._position_of(place, dim, selection)
        if isinstance(selection, Sequence):
            return [self._position_of(place, dim, label) for label in selection]
        return selection

    def _position_of(self, place: str, dim: str, label: int | str) -> int:
        if not isinstance(label, str):
            return label
        if dim not in self.coordinates or not self._entry(dim).is_text:
            raise ResultError(
                f"{place}: has no labels, so '{label}' selects nothing; use positions"
            )
        known = [str(other) for other in self.coordinate(dim)]
        if label not in known:
            hint = suggestion(label, known) or f"; there are: {', '.join(known)}"
            raise ResultError(f"{place}: has no '{label}'{hint}")
        return known.index(label)

    def __repr__(self) -> str:
        sizes = ", ".join(f"{dim} {size}" for dim, size in self.dimensions.items())
        state = "" if self._file else ", closed"
        return f"<results {self.path}: {len(self.names)} variables over {sizes}{state}>"

    def dims(self, name: str) -> tuple[str, ...]:
        """Return the dimensions of a variable or coordinate, one per axis."""
        return tuple(dim for dim in self._entry(name).dims if dim not in self._fixed)

    def units(self, name: str) -> str:
        """Return the units of a variable or coordinate; empty if the file has none."""
        return str(self._entry(name).attributes.get("units", ""))

    def long_name(self, name: str) -> str:
        """Return the description of a variable or coordinate, or its name if there is none."""
        return str(self._entry(name).attributes.get("long_name", name))

    def attributes_of(self, name: str) -> Mapping[str, Attribute]:
        """Return all attributes of a variable or coordinate."""
        return self._entry(name).attributes

    def _entry(self, name: str) -> CheckedArray:
        if name not in self._entries:
            raise ResultError(
                f"{self.path}: holds no variable '{name}'{suggestion(name, self._entries)}; "
                f"it holds: {', '.join(self._entries)}"
            )
        return self._entries[name]


def open_results(path: str | Path, oldest: int = files.FORMAT) -> ResultFile:
    """Open a result file, after checking that it is safe to read.

    Parameters
    ----------
    path
        The file, or the result folder that holds it as ``results.h5``.
    oldest
        The oldest format that is read.

    Returns
    -------
    ResultFile
        A context manager, which closes the file.

    Raises
    ------
    ResultError
        If there is no such file, it was not written by eqt, is damaged, points to other files or
        declares more data than it holds.
    """
    return ResultFile(path, oldest)


def _opened(path: Path) -> Any:
    """Open the file for reading, without locks if possible.

    Result files never change, and some network disks refuse locks. But HDF5 opens a file twice in
    one process only with equal flags, and xarray in a notebook opens it with locks.
    """
    try:
        return h5py.File(path, "r", locking=False)
    except OSError as error:
        if "locking flag" not in str(error):
            raise
        return h5py.File(path, "r")


class MissingAttributeError(ResultError, KeyError):
    """Raised where a result lacks an attribute that every result has."""

    __str__ = ResultError.__str__  # KeyError's would quote the message


class _Attributes(dict[str, Attribute]):
    """Root attributes; a missing one is an error of the file."""

    def __init__(self, path: Path, attributes: Mapping[str, Attribute]) -> None:
        super().__init__(attributes)
        self._path = path

    def __missing__(self, name: str) -> Attribute:
        raise MissingAttributeError(f"{self._path}: lacks the attribute '{name}'; {_RESTORE}")


def _find(path: Path) -> Path:
    file = path
    try:
        if path.is_dir():
            file = path / files.FILE_NAME
        with files.open_regular(file) as stream:
            start = stream.read(len(_SIGNATURE))
    except (files.NotRegularError, IsADirectoryError) as error:
        advice = f"give a result folder or its {files.FILE_NAME}"
        raise ResultError(f"{file}: is not a file; {advice}") from error
    except FileNotFoundError as error:
        if file == path:
            hint = files.near(path, lambda entry: (entry / files.FILE_NAME).is_file())
            hint = hint or f"; give a result folder or its {files.FILE_NAME}"
            raise ResultError(f"{path}: not found{hint}") from error
        raise ResultError(
            f"{path}: the folder holds no {files.FILE_NAME}; run its experiment to the end first"
        ) from error
    except OSError as error:
        raise ResultError(
            f"{file}: cannot be read: {error.strerror}; check the path and its permissions"
        ) from error
    if start != _SIGNATURE and file.suffix in files.YAML:
        raise ResultError(
            f"{file} is a configuration, not a result; run it with `eqt run {file}`, then give the "
            f"result folder, such as results/{file.stem}"
        )
    if start != _SIGNATURE:
        raise ResultError(f"{file}: is not an HDF5 file; give the {files.FILE_NAME} that eqt wrote")
    return file


@contextmanager
def _guard(path: Path, name: str = "") -> Iterator[None]:
    """Turn every error of the HDF5 library for a bad file into a `ResultError`."""
    subject = f"{path}: '{name}'" if name else f"{path}:"
    try:
        yield
    except ResultError:
        raise
    except Refusal as refusal:
        raise _refused(path, str(refusal)) from refusal
    except MemoryError as error:
        raise ResultError(f"{subject} does not fit the memory; read it in parts") from error
    except Exception as error:  # of any class: OS, Runtime, Value, Key, Type were seen
        if "truncated file" in str(error):
            raise ResultError(f"{subject} is cut short; {_AGAIN}") from error
        raise ResultError(f"{subject} is damaged; {_AGAIN}") from error


def _refused(path: Path, reason: str) -> ResultError:
    return ResultError(f"{path}: refused: {reason}; {_RESTORE}")


def _check_format(path: Path, number: int | None, writer: str | None, oldest: int) -> None:
    if number is None:
        raise ResultError(
            f"{path}: is an HDF5 file, but not one of eqt's (it has no attribute "
            f"'{files.FORMAT_ATTRIBUTE}'); give the {files.FILE_NAME} that eqt wrote"
        )
    if not oldest <= number <= files.FORMAT:
        wrote = f"eqt {writer}" if writer else "the version of eqt that wrote it"
        raise ResultError(
            f"{path}: has format {number}, but eqt {__version__} reads format {files.FORMAT}; "
            f"read it with {wrote}"
        )


def _positions(place: str, selection: Positions | None, size: int) -> int | slice | NDArray[Any]:
    """Return a selection in a form that h5py accepts: in range, with rising slices."""
    if selection is None:
        return slice(None)
    try:
        if isinstance(selection, slice):
            selection = range(size)[selection]
            if selection.step > 0:
                return slice(selection.start, selection.stop, selection.step)
        if isinstance(selection, (Sequence, np.ndarray)):
            listed = [_position(place, k, size) for k in selection]
            return np.array(listed) if listed else slice(0, 0)
        return _position(place, selection, size)
    except TypeError:
        raise ResultError(
            f"{place}: cannot select {selection!r}; expected an integer, a slice or a list of "
            "integers"
        ) from None


def _position(place: str, selection: int, size: int) -> int:
    if isinstance(selection, (bool, np.bool_)):
        raise TypeError
    position = operator.index(selection)
    if not -size <= position < size:
        raise ResultError(f"{place}: {position} is out of range; expected {-size} to {size - 1}")
    return position % size


def _read(dataset: Any, selection: Sequence[int | slice | NDArray[Any]]) -> NDArray[Any]:
    """Read with one rising list of positions, the most that h5py takes, and select the rest."""
    stored: list[int | slice | NDArray[Any]] = []
    picks: list[NDArray[Any] | None] = []  # one for each remaining axis
    for choice in selection:
        if isinstance(choice, int):
            stored.append(choice)
        elif isinstance(choice, slice):
            stored.append(choice)
            picks.append(None)
        elif any(isinstance(other, np.ndarray) for other in stored):
            low, high = int(choice.min()), int(choice.max())
            stored.append(slice(low, high + 1))
            picks.append(choice - low)
        else:
            rising, pick = np.unique(choice, return_inverse=True)
            stored.append(rising)
            picks.append(pick)
    data = np.asarray(dataset[tuple(stored)])
    for axis, order in enumerate(picks):
        if order is not None:
            data = np.take(data, order, axis=axis)
    return data
