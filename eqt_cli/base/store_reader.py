"""Reads result files, which may be damaged, or come from strangers.

h5py reads them. What eqt never writes is refused before it is used: links, data in other files or
larger than the file, other types, and dimensions that do not fit.
"""

import io
import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import prod
from mmap import ACCESS_READ, mmap
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from eqt_cli.base import files, stored
from eqt_cli.base.errors import Remedy, ResultError, suggestion
from eqt_cli.base.stored import Attribute
from eqt_cli.base.version import __version__


class Refusal(Exception):
    """Raised for a refused file; the message follows the file's path in a sentence."""


_OBJECTS = {h5py.Group: "a group", h5py.Datatype: "a named type"}
_SHUFFLE, _DEFLATE = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE
_FILTERS: tuple[list[int], ...] = ([], [_DEFLATE], [_SHUFFLE, _DEFLATE])
# One byte of a deflate stream expands to at most 1032 bytes (RFC 1951: 258 bytes from 2 bits).
_DEFLATE_RATIO = 1032
_ATTACHMENT = np.dtype([("address", "<u8"), ("axis", "<u4"), ("padding", "<u4")])
_VERSION = re.compile(rb"[0-9A-Za-z.+-]{1,32}")


MOST_DATASETS = 1000
"""Largest number of datasets in a file; eqt writes about 40."""


@dataclass(frozen=True)
class CheckedArray:
    """An array of a checked file."""

    dataset: Any
    dims: tuple[str, ...]
    attributes: dict[str, Attribute]


@dataclass(frozen=True)
class Contents:
    """Contents of a checked file; entries and dimensions are in the order of writing."""

    entries: dict[str, CheckedArray]
    coordinates: set[str]
    dimensions: dict[str, int]
    attributes: dict[str, Attribute]


def _outside_heaps(file: Any, name: str) -> Any:
    """Return an attribute that is no string of variable length; otherwise None."""
    is_there = name in file.attrs and file.attrs.get_id(name).dtype.kind in "iuS"
    return file.attrs[name] if is_there else None


class CheckedStream(io.BufferedReader):
    """A file for HDF5 to read."""

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer, or fail where the file has become shorter."""
        count = super().readinto(buffer)
        if count < len(buffer):
            raise EOFError("the file became shorter")
        return count


def contents_of(file: Any, size: int) -> Contents:
    """Check a file of `size` bytes, and the datasets in it."""
    names = list(file)
    if len(names) > MOST_DATASETS:
        raise Refusal(f"it holds {len(names)} datasets")
    datasets = {name: _dataset(file, name) for name in names}
    labels = {name: _scale_label(dataset) for name, dataset in datasets.items()}
    scales = [name for name, label in labels.items() if label]
    # A placeholder is never written: only its length counts.
    held = [name for name in names if not labels[name].startswith(stored.PLACEHOLDER)]
    coordinates = set(scales)
    for name in held:
        _require_data(datasets[name], size)
        if stored.COORDINATES in datasets[name].attrs:
            coordinates.update(str(attribute(datasets[name], stored.COORDINATES)).split())
    dims = _dimensions(datasets, scales)
    return Contents(
        {
            name: CheckedArray(datasets[name], dims[name], attributes_of(datasets[name]))
            for name in held
        },
        coordinates,
        {name: len(datasets[name]) for name in scales},
        attributes_of(file),
    )


def attributes_of(owner: Any) -> dict[str, Attribute]:
    """Return the user's attributes of an open file or dataset."""
    return {name: attribute(owner, name) for name in owner.attrs if name not in stored.RESERVED}


def attribute(owner: Any, name: str) -> Attribute:
    """Return an attribute, which must be a single number or string."""
    handle = h5py.h5a.open(owner.id, name.encode())
    kind = handle.get_type()
    # Not of variable length: HDF5 walks for ever in a heap of strings that is damaged (issue 1707).
    is_plain = _is_text(kind) or _is_number(kind)
    if handle.get_space().get_simple_extent_npoints() != 1 or not is_plain:
        where = f" of '{_path(owner)}'" if _path(owner) else ""
        raise Refusal(f"its attribute {name!r}{where} is not one number or string of fixed length")
    value = np.asarray(owner.attrs[name]).item()
    return value.decode() if isinstance(value, bytes) else value


def _path(owner: Any) -> str:
    return owner.name[1:]


def _is_number(kind: Any) -> bool:
    return kind.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT) and kind.get_size() <= 8


def _is_text(kind: Any) -> bool:
    return kind.get_class() == h5py.h5t.STRING and not kind.is_variable_str()


def _object(file: Any, name: str) -> Any:
    """Open what a file holds, without following a link out of it."""
    if not stored.NAME.fullmatch(name):
        raise Refusal(f"it holds something called {name!r}")
    link = file.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        kind = "a soft link" if isinstance(link, h5py.SoftLink) else "an external link"
        raise Refusal(f"'{name}' is {kind}")
    entry = file[name]
    if h5py.h5o.get_info(entry.id).rc > 1:
        raise Refusal(f"'{name}' has another name, too")
    return entry


def _dataset(file: Any, name: str) -> Any:
    """Open a dataset whose data are numbers or strings in this file."""
    dataset = _object(file, name)
    if not isinstance(dataset, h5py.Dataset):
        raise Refusal(f"'{name}' is {_OBJECTS[type(dataset)]}")
    creation = dataset.id.get_create_plist()
    # This check comes first, because even the shape of a virtual dataset may open other files.
    if creation.get_layout() == h5py.h5d.VIRTUAL:
        raise Refusal(f"'{name}' is a virtual dataset")
    if creation.get_external_count():
        raise Refusal(f"'{name}' keeps its data in another file")
    if [creation.get_filter(k)[0] for k in range(creation.get_nfilters())] not in _FILTERS:
        raise Refusal(f"'{name}' uses filters other than shuffle and gzip")
    is_text = _is_text(dataset.id.get_type())
    if not (is_text or _is_number(dataset.id.get_type())):
        raise Refusal(f"'{name}' holds neither numbers nor strings of fixed length")
    if is_text and dataset.chunks:
        raise Refusal(f"'{name}' does not hold its strings in one piece")
    if dataset.shape is None:
        raise Refusal(f"'{name}' has no shape")
    return dataset


def _require_data(dataset: Any, size: int) -> None:
    """Refuse a dataset that declares more data than a file of `size` bytes can hold."""
    declared = prod(dataset.shape) * dataset.dtype.itemsize
    held = min(dataset.id.get_storage_size(), size)
    if declared > _DEFLATE_RATIO * held:
        raise Refusal(f"'{_path(dataset)}' declares {declared} bytes and holds {held}")


def _scale_label(dataset: Any) -> str:
    """Return the label of a dimension scale; empty for other datasets."""
    name = _path(dataset)
    if "CLASS" not in dataset.attrs or attribute(dataset, "CLASS") != "DIMENSION_SCALE":
        return ""
    if dataset.ndim != 1:
        raise Refusal(f"'{name}' is a dimension scale of shape {dataset.shape}")
    return str(attribute(dataset, "NAME")) if "NAME" in dataset.attrs else name


def _dimensions(datasets: Mapping[str, Any], scales: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the dimensions of each dataset, from the attachments stored with the scales.

    The datasets also hold them, but as references in a heap, which would have to be followed.
    """
    names = {h5py.h5o.get_info(dataset.id).addr: name for name, dataset in datasets.items()}
    dims = {name: [""] * dataset.ndim for name, dataset in datasets.items()}
    for scale in scales:
        dims[scale] = [scale]
        for address, axis in _attached(datasets[scale]):
            name = names.get(address, "")
            if not name or axis >= len(dims[name]) or dims[name][axis]:
                raise Refusal(f"'{_path(datasets[scale])}' is attached where it cannot be")
            dims[name][axis] = scale
    for name, dataset in datasets.items():
        for dim, length in zip(dims[name], dataset.shape, strict=True):
            if not dim:
                raise Refusal(f"'{_path(dataset)}' has an axis without a dimension")
            if datasets[dim].shape != (length,):
                has = f"{length} entries along '{dim}', which has {len(datasets[dim])}"
                raise Refusal(f"'{_path(dataset)}' has {has}")
    return {name: tuple(words) for name, words in dims.items()}


def _attached(scale: Any) -> list[tuple[int, int]]:
    """Return the addresses of the datasets that a scale is attached to, with the axes."""
    if "REFERENCE_LIST" not in scale.attrs:
        return []
    handle = h5py.h5a.open(scale.id, b"REFERENCE_LIST")
    kind = handle.get_type()
    if kind.get_class() != h5py.h5t.COMPOUND or kind.get_size() != _ATTACHMENT.itemsize:
        raise Refusal(f"'{_path(scale)}' is attached in an unknown way")
    raw = np.empty(handle.shape, f"V{_ATTACHMENT.itemsize}")
    handle.read(raw, kind)  # as bytes, so that no reference is followed
    return [(int(address), int(axis)) for address, axis, _ in raw.view(_ATTACHMENT)]


# Results of eqt -----------------------------------------------------------------------------------


Positions = int | slice | Sequence[int] | NDArray[np.integer[Any]]
"""Positions along one dimension; counted from the end when negative, as in NumPy."""

Selection = Positions | str | Sequence[str]
"""Positions along one dimension, or labels."""

Chosen = int | slice | NDArray[Any]
"""Positions along one dimension, in range and rising."""

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

    of_all_points: tuple[str, ...] = (*"path _view _file _root _sums _by_shape _open".split(),)
    """Attributes that a view of one point shares."""

    def __init__(self, path: str | Path, oldest: int = stored.FORMAT) -> None:
        self.path = path = _find(Path(path))
        with ExitStack() as stack, _guard(path):
            stream = stack.enter_context(CheckedStream(files.open_regular(path).detach()))
            self._view = stack.enter_context(mmap(stream.fileno(), 0, access=ACCESS_READ))
            # Before HDF5 sees the file, so that what a bad disk changed does not reach it.
            if files.is_intact(self._view) is False:
                raise ResultError(f"{path}: is damaged: its checksum differs; {_AGAIN}")
            self._file = stack.enter_context(h5py.File(stream, "r"))
            _check_format(path, self._file, oldest)
            version, *sizes = self._view[8:11]
            if version not in (2, 3) or sizes != [8, 8]:
                raise Refusal("it has an HDF5 layout without checksums")
            self._root = contents_of(self._file, len(self._view))
            self._sums = (_outside_heaps(self._file, files.SHAPES) or b"").decode().split()
            self._by_shape: dict[int, Self] = {}  # opened when each is first used
            self.attributes: Mapping[str, Attribute] = _Attributes(path, self._root.attributes)
            self._show(self._root)
            self._check()
            self._open = stack.pop_all()

    def _check(self) -> None:
        """Refuse attributes and coordinates that eqt does not write; here, any are accepted."""

    def _show(self, contents: Contents, fixed: Mapping[str, int] | None = None) -> None:
        """Show the contents, at a position along the `fixed` dimensions."""
        self._fixed = fixed or {}
        hidden = {*self._fixed, *(dim for dim in contents.dimensions if dim.endswith(stored.TEXTS))}
        self._entries = {
            name: entry
            for name, entry in contents.entries.items()
            if not (entry.dims and hidden.issuperset(entry.dims))
        }
        self.dimensions: Mapping[str, int] = MappingProxyType(
            {dim: size for dim, size in contents.dimensions.items() if dim not in hidden}
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

        It has no dimension ``point``, no swept keys, and the shapes of this point. Closing one
        result closes the other.

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
        points = self.dimensions.get(stored.POINT)
        if points is None:
            raise ResultError(f"{self.path}: is not a sweep; leave the point out")
        if not 0 <= point < points:
            raise ResultError(f"{self.path}: has no point {point}; choose one of 0 to {points - 1}")
        if self._sums:
            shape, row = self.source(point)
            of_shape = {**self.attributes, **shape.attributes, **(attributes or {})}
            view = shape.at(row, of_shape)
            for name in set(self.of_all_points) - set(ResultFile.of_all_points):
                if name in vars(self):
                    setattr(view, name, getattr(self, name))
            view.path, view._open = self.path, self._open
            return view
        view = type(self).__new__(type(self))  # which has computed nothing of another point
        for name in (name for name in self.of_all_points if hasattr(self, name)):
            setattr(view, name, getattr(self, name))
        view._show(self._root, {stored.POINT: point})
        view.attributes = _Attributes(self.path, {**self.attributes, **(attributes or {})})
        return view

    def source(self, point: int) -> tuple[Self, int]:
        """Return the result that holds a point's arrays, and their position along ``point``."""
        if not self._sums:
            return self, point
        shapes = self.read(stored.SHAPE)
        row = int(np.count_nonzero(shapes[:point] == shapes[point]))
        return self.of_shape(int(shapes[point])), row

    @property
    def shapes(self) -> range:
        """The numbers of the shapes of points; none where all points have the same."""
        return range(len(self._sums) if stored.POINT in self.dimensions else 0)

    def of_shape(self, shape: int) -> Self:
        """Return the result of the points of one shape, which is closed with this one.

        Raises
        ------
        ResultError
            If it is not there, or was written with another result.
        """
        if shape not in self._by_shape:
            if shape not in self.shapes:
                raise _refused(self.path, f"it has no shape {shape}")
            path = files.shape_file(self.path.parent, shape)
            if not path.exists():
                raise ResultError(f"{path}: not found; copy the whole folder {self.path.parent}")
            result = type(self)(path)
            self._open.push(result)
            if files.checksum_of(path) != self._sums[shape]:
                raise ResultError(f"{path}: was written with another {self.path.name}; {_AGAIN}")
            self._by_shape[shape] = result
        return self._by_shape[shape]

    def single(self, what: str) -> Self:
        """Return this result, unless it is a sweep; `what` says what takes no sweep.

        Raises
        ------
        ResultError
            If it is a sweep; the message says how to choose a point.
        """
        points = self.dimensions.get(stored.POINT)
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

    def refusal(self, reason: str) -> ResultError:
        """Return the error for a feature that eqt's files do not have."""
        return _refused(self.path, reason)

    # Reading.

    def has(self, name: str) -> bool:
        """Whether the file holds a variable or coordinate of this name."""
        return name in self._entries

    def __contains__(self, name: object) -> bool:
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
        positions = [
            self._fixed[dim] if dim in self._fixed else self._chosen(name, dim, selection.get(dim))
            for dim in entry.dims
        ]
        if not self._file:
            raise ResultError(f"{self.path}: is closed; read within its `with` block")
        with _guard(self.path, name):
            data = _read(entry.dataset, positions)
            table = self._root.entries.get(name + stored.TEXTS)
            texts = data if table is None else table.dataset[()]
            if texts.dtype.kind == "S":
                texts = np.char.decode(texts, "utf-8").astype(object)
            return texts if table is None else np.asarray(texts[data], texts.dtype)

    def _chosen(self, name: str, dim: str, selection: Selection | None) -> Chosen:
        """Return a selection in a form that h5py accepts: in range, with rising slices."""
        place = f"{self.path}: '{name}': {dim}"
        if selection is None:
            return slice(None)
        try:
            if isinstance(selection, slice):
                selection = range(self.dimensions[dim])[selection]
                if selection.step > 0:
                    return slice(selection.start, selection.stop, selection.step)
            if isinstance(selection, str) or not isinstance(selection, (Sequence, np.ndarray)):
                return self._position(place, dim, selection)
            listed = [self._position(place, dim, position) for position in selection]
            return np.array(listed) if listed else slice(0, 0)
        except TypeError:
            raise ResultError(
                f"{place}: cannot select {selection!r}; expected an integer, a slice or a list of "
                "integers"
            ) from None

    def _position(self, place: str, dim: str, selected: int | str) -> int:
        """Return the position of a label or number."""
        if isinstance(selected, str):
            if dim not in self.coordinates or self._entry(dim).dataset.dtype.kind != "S":
                raise ResultError(
                    f"{place}: has no labels, so '{selected}' selects nothing; use positions"
                )
            labels = [str(label) for label in self.coordinate(dim)]
            if selected not in labels:
                hint = suggestion(selected, labels) or f"; there are: {', '.join(labels)}"
                raise ResultError(f"{place}: has no '{selected}'{hint}")
            return labels.index(selected)
        if isinstance(selected, (bool, np.bool_)):
            raise TypeError
        position, size = operator.index(selected), self.dimensions[dim]
        if not -size <= position < size:
            raise ResultError(
                f"{place}: {position} is out of range; expected {-size} to {size - 1}"
            )
        return position % size

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


def open_results(path: str | Path, oldest: int = stored.FORMAT) -> ResultFile:
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


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read what `store_writer.write_arrays` wrote.

    Raises
    ------
    ResultError
        If it is damaged.
    """
    with _guard(path), files.open_regular(path) as stream:
        if not files.is_intact_file(path):
            raise ResultError(f"{path}: is damaged; {_AGAIN}")
        names = np.lib.format.read_array(stream, allow_pickle=False).tolist()
        return {name: np.lib.format.read_array(stream, allow_pickle=False) for name in names}


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


def _check_format(path: Path, file: Any, oldest: int) -> None:
    number = _outside_heaps(file, stored.FORMAT_ATTRIBUTE)
    if not isinstance(number, np.integer):  # the number of eqt's layout
        raise ResultError(
            f"{path}: is an HDF5 file, but not one of eqt's (it has no attribute "
            f"'{stored.FORMAT_ATTRIBUTE}'); give the {files.FILE_NAME} that eqt wrote"
        )
    if not oldest <= number <= stored.FORMAT:
        version = _outside_heaps(file, stored.VERSION_ATTRIBUTE)
        is_valid = isinstance(version, bytes) and _VERSION.fullmatch(version)
        writer = f"eqt {version.decode()}" if is_valid else "the version of eqt that wrote it"
        raise ResultError(
            f"{path}: has format {number}, but eqt {__version__} reads format {stored.FORMAT}; "
            f"read it with {writer}"
        )


DENSE = 8
"""Most numbers that are read for a wanted one. Of 20,000 runs, curves over time then take a
hundredth of 520,000 calls of the file, 1 s of the processor."""


def _read(dataset: Any, selection: Sequence[Chosen]) -> NDArray[Any]:
    """Read with one rising list of positions, the most that h5py takes, and select the rest.

    Of a list that is dense in the last axis, all between is read: HDF5 reads every number apart.
    """
    held: list[Chosen] = []
    orders: list[NDArray[Any] | None] = []  # of each remaining axis, where it is a list
    for axis, choice in enumerate(selection):
        if not isinstance(choice, np.ndarray):
            held.append(choice)
            if isinstance(choice, slice):
                orders.append(None)
            continue
        rising = np.unique(choice)
        span = int(np.ptp(rising)) if len(rising) else np.inf
        dense = axis == len(selection) - 1 and span < DENSE * len(rising)
        if dense or any(order is not None for order in orders):
            rising = np.arange(rising[0], rising[-1] + 1)
            held.append(slice(rising[0], rising[-1] + 1))
        else:
            held.append(rising)
        orders.append(np.searchsorted(rising, choice))
    data = np.asarray(dataset[tuple(held)])
    for axis, order in enumerate(orders):
        if order is not None:
            data = np.take(data, order, axis=axis)
    return data
