"""Reads result files safely, even files from others."""

import copy
import operator
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from mmap import ACCESS_READ, mmap
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from eqt_cli.core.errors import Remedy, ResultError, suggestion
from eqt_cli.core.files import YAML, NotRegularError, near, open_regular
from eqt_cli.core.version import __version__
from eqt_cli.store import safety
from eqt_cli.store.reserved_names import FILE_NAME, FORMAT, FORMAT_ATTRIBUTE, POINT
from eqt_cli.store.writer import Attribute

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

    def __init__(self, path: str | Path) -> None:
        self.path = path = _find(Path(path))
        with ExitStack() as stack, _guard(path):
            stream = stack.enter_context(open_regular(path))
            self._view = stack.enter_context(mmap(stream.fileno(), 0, access=ACCESS_READ))
            # No locks: result files never change, and some network disks refuse to lock.
            self._file = stack.enter_context(_opened(path))
            _check_format(path, safety.format_of(self._file), safety.version_of(self._file))
            self._root, self._points, self._heaps = safety.inspect(self._file, self._view)
            self.attributes: Mapping[str, Attribute] = _Attributes(path, self._root.attributes)
            self._show(self._root)
            self._check()
            self._open = stack.pop_all()

    def _check(self) -> None:
        """Refuse attributes and coordinates that eqt does not write; here, any are accepted."""

    def _show(self, contents: safety.Contents, fixed: Mapping[str, int] | None = None) -> None:
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
        points = self.dimensions.get(POINT)
        if points is None:
            raise ResultError(
                f"{self.path}: is no sweep, so it has no point to choose; leave it out"
            )
        if not 0 <= point < points:
            raise ResultError(f"{self.path}: has no point {point}; choose one of 0 to {points - 1}")
        view = copy.copy(self)
        merged = dict(self.attributes)
        if self._points:
            with _guard(self.path):
                contents = self._points[point]()
            merged |= contents.attributes
            view._show(contents)
        else:
            view._show(self._root, {POINT: point})
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
        points = self.dimensions.get(POINT)
        if points is not None:
            raise ResultError(
                f"{self.path}: {what}, and this is a sweep of {points} points",
                Remedy(
                    f"choose one of 0 to {points - 1} with {{}}, as `eqt show {self.path.parent} "
                    "--table` lists them",
                    "point",
                ),
            )
        return self

    @property
    def has_groups(self) -> bool:
        """Whether the points differ in shape, so that each has its arrays in a group."""
        return bool(self._points) and POINT in self.dimensions

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
                safety.check_text(entry.dataset, self._view, self._heaps)
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

    def _entry(self, name: str) -> safety.CheckedArray:
        if name not in self._entries:
            raise ResultError(
                f"{self.path}: holds no variable '{name}'{suggestion(name, self._entries)}; "
                f"it holds: {', '.join(self._entries)}"
            )
        return self._entries[name]


def open_results(path: str | Path) -> ResultFile:
    """Open a result file, after checking that it is safe to read.

    Parameters
    ----------
    path
        The file, or the result folder that holds it as ``results.h5``.

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
    return ResultFile(path)


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
            file = path / FILE_NAME
        with open_regular(file) as stream:
            start = stream.read(len(_SIGNATURE))
    except (NotRegularError, IsADirectoryError) as error:
        advice = f"give a result folder or its {FILE_NAME}"
        raise ResultError(f"{file}: is not a file; {advice}") from error
    except FileNotFoundError as error:
        if file == path:
            hint = near(path, lambda entry: (entry / FILE_NAME).is_file())
            hint = hint or f"; give a result folder or its {FILE_NAME}"
            raise ResultError(f"{path}: not found{hint}") from error
        raise ResultError(
            f"{path}: the folder holds no {FILE_NAME}; run its experiment to the end first"
        ) from error
    except OSError as error:
        raise ResultError(
            f"{file}: cannot be read: {error.strerror}; check the path and its permissions"
        ) from error
    if start != _SIGNATURE and file.suffix in YAML:
        raise ResultError(
            f"{file} is a configuration, not a result; run it with `eqt run {file}`, then give the "
            f"result folder, such as results/{file.stem}"
        )
    if start != _SIGNATURE:
        raise ResultError(f"{file}: is not an HDF5 file; give the {FILE_NAME} that eqt wrote")
    return file


@contextmanager
def _guard(path: Path, name: str = "") -> Iterator[None]:
    """Turn every error of the HDF5 library for a bad file into a `ResultError`."""
    subject = f"{path}: '{name}'" if name else f"{path}:"
    try:
        yield
    except ResultError:
        raise
    except safety.Refusal as refusal:
        raise _refused(path, str(refusal)) from refusal
    except MemoryError as error:
        raise ResultError(f"{subject} does not fit the memory; read it in parts") from error
    except Exception as error:  # of any class: OS, Runtime, Value, Key, Type were seen
        if "truncated file" in str(error):
            raise ResultError(f"{subject} is cut short; {_AGAIN}") from error
        raise ResultError(f"{subject} is damaged; {_AGAIN}") from error


def _refused(path: Path, reason: str) -> ResultError:
    return ResultError(f"{path}: refused: {reason}; {_RESTORE}")


def _check_format(path: Path, number: int | None, writer: str | None) -> None:
    if number is None:
        raise ResultError(
            f"{path}: is an HDF5 file, but not one of eqt's (it has no attribute "
            f"'{FORMAT_ATTRIBUTE}'); give the {FILE_NAME} that eqt wrote"
        )
    if number != FORMAT:
        wrote = f"eqt {writer}" if writer else "the version of eqt that wrote it"
        raise ResultError(
            f"{path}: has format {number}, but eqt {__version__} reads format {FORMAT}; "
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
