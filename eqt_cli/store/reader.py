"""Reading result files, also those of strangers; it must not know what the numbers mean."""

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
from eqt_cli.core.files import YAML, near
from eqt_cli.core.regular_files import NotRegularError, open_regular
from eqt_cli.core.version import __version__
from eqt_cli.store import safety
from eqt_cli.store.reserved_names import FILE_NAME, FORMAT, FORMAT_ATTRIBUTE, POINT
from eqt_cli.store.table import Attribute

Positions = int | slice | Sequence[int] | NDArray[np.integer[Any]]
"""Positions along one dimension; counted from the end when negative, as in NumPy."""

Selection = Positions | str | Sequence[str]
"""Positions along one dimension, or labels."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_AGAIN = "copy it again or run the experiment again"
_RESTORE = f"eqt writes no such file: {_AGAIN}"


class ResultFile:
    """An open result file; arrays are read, anew each time, when asked for.

    Parameters
    ----------
    path
        The file, or the result folder that holds it.

    Attributes
    ----------
    path : Path
        The file itself.
    attributes : Mapping
        What the writer said of the whole.
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
            checked = safety.inspect(self._file, self._view)
            self._open = stack.pop_all()
        self._root, self._points, self._heaps = checked.root, checked.points, checked.heaps
        self.attributes: Mapping[str, Attribute] = _Attributes(path, checked.root.attributes)
        self._show(checked.root)

    def _show(self, contents: safety.Contents, fixed: Mapping[str, int] | None = None) -> None:
        """Be about the root or a group, at a position along the `fixed` dimensions."""
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
        """One point of a sweep, as the result of a single experiment.

        It has no dimension ``point`` and no swept keys, and what differs in shape between points is
        that of this one. Both read from one file: closing one closes the other.

        Parameters
        ----------
        point
            Counted from 0.
        attributes
            What is to be said of this point instead of the whole.

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
        told = dict(self.attributes)
        if self._points:
            with _guard(self.path):
                contents = self._points[point]()
            told |= contents.attributes
            view._show(contents)
        else:
            view._show(self._root, {POINT: point})
        view.attributes = _Attributes(self.path, told | dict(attributes or {}))
        return view

    def single(self, what: str) -> Self:
        """Give this result back, unless it is a sweep; `what` says who takes none.

        Raises
        ------
        ResultError
            If it is one; the message says how to choose a point.
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
        """An error that says what no file of eqt's has."""
        return _refused(self.path, reason)

    # Reading.

    def has(self, name: str) -> bool:
        """Whether the file holds a variable or coordinate of this name."""
        return name in self._entries

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A whole variable or coordinate; strings come as an object array of `str`."""
        return self.read(name)

    def coordinate(self, name: str) -> NDArray[Any]:
        """The values of a coordinate, usually one per position along the dimension `name`."""
        if name not in self.coordinates:
            raise ResultError(
                f"{self.path}: holds no coordinate '{name}'{suggestion(name, self.coordinates)}; "
                f"its coordinates are: {', '.join(self.coordinates)}"
            )
        return self.read(name)

    def read(self, name: str, /, **selection: Selection) -> NDArray[Any]:
        """Part of a variable or coordinate: only what is asked for leaves the disk.

        Parameters
        ----------
        name
            The variable.
        **selection
            For some dimensions, the positions to read: an integer (which drops the axis), a slice,
            or a list of integers in any order. Where the coordinate of the dimension is text, a
            label or a list of labels stands for positions: ``controller="eqt"``.

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
        wanted = [
            self._fixed[dim]
            if dim in self._fixed
            else _positions(
                f"{self.path}: '{name}': {dim}",
                self._labelled(name, dim, selection.get(dim)),
                self.dimensions[dim],
            )
            for dim in entry.dims
        ]
        if not self._file:
            raise ResultError(f"{self.path}: is closed; read within its `with` block")
        with _guard(self.path, name):
            if entry.is_text:
                safety.check_text(entry.dataset, self._view, self._heaps)
                return _read(entry.dataset.asstr(), wanted).astype(object)
            return _read(entry.dataset, wanted)

    def _labelled(self, name: str, dim: str, wanted: Selection | None) -> Positions | None:
        """A selection with positions instead of labels."""
        if isinstance(wanted, str):
            return self._position_of(name, dim, wanted)
        if isinstance(wanted, Sequence):
            return [self._position_of(name, dim, label) for label in wanted]
        return wanted

    def _position_of(self, name: str, dim: str, label: int | str) -> int:
        if not isinstance(label, str):
            return label
        place = f"{self.path}: '{name}': {dim}"
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
        """The dimensions of a variable or coordinate, one per axis."""
        return tuple(dim for dim in self._entry(name).dims if dim not in self._fixed)

    def units(self, name: str) -> str:
        """The units of a variable or coordinate; empty if the file says none."""
        return str(self._entry(name).attributes.get("units", ""))

    def long_name(self, name: str) -> str:
        """What a variable or coordinate is, in words; its name if the file says none."""
        return str(self._entry(name).attributes.get("long_name", name))

    def attributes_of(self, name: str) -> Mapping[str, Attribute]:
        """All that the file says of a variable or coordinate."""
        return self._entry(name).attributes

    def _entry(self, name: str) -> safety.Entry:
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
        To be used as a context manager, which closes the file.

    Raises
    ------
    ResultError
        If there is no such file, it was not written by eqt, is damaged, points to other files or
        declares more data than it holds.
    """
    return ResultFile(path)


def _opened(path: Path) -> Any:
    """The file, open for reading and, where HDF5 lets us, without locks.

    Result files never change, and some network disks refuse to lock. But HDF5 opens a file twice in
    one process only with the same flags, and xarray, in a notebook, opens it with locks.
    """
    try:
        return h5py.File(path, "r", locking=False)
    except OSError as error:
        if "locking flag" not in str(error):
            raise
        return h5py.File(path, "r")


class MissingAttributeError(ResultError, KeyError):
    """An attribute that every result has, missing from this one."""

    __str__ = ResultError.__str__  # KeyError's would quote the message


class _Attributes(dict[str, Attribute]):
    """Root attributes, whose absence is a fault of the file."""

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
        wanted = f"give a result folder or its {FILE_NAME}"
        raise ResultError(f"{file}: is not a file; {wanted}") from error
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
    """Turn whatever a bad file makes of the HDF5 library into a `ResultError`."""
    subject = f"{path}: '{name}'" if name else f"{path}:"
    try:
        yield
    except ResultError:
        raise
    except safety.Refusal as refusal:
        raise _refused(path, str(refusal)) from refusal
    except MemoryError as error:
        raise ResultError(f"{subject} does not fit the memory; read it in parts") from error
    except Exception as error:  # h5py promises no class: seen are OS, Runtime, Value, Key, Type
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


def _positions(place: str, wanted: Positions | None, size: int) -> int | slice | NDArray[Any]:
    """A selection in the form that h5py reads: in range, and slices forwards."""
    if wanted is None:
        return slice(None)
    try:
        if isinstance(wanted, slice):
            wanted = range(size)[wanted]
            if wanted.step > 0:
                return slice(wanted.start, wanted.stop, wanted.step)
        if isinstance(wanted, (Sequence, np.ndarray)):
            listed = [_position(place, k, size) for k in wanted]
            return np.array(listed) if listed else slice(0, 0)
        return _position(place, wanted, size)
    except TypeError:
        raise ResultError(
            f"{place}: cannot select {wanted!r}; expected an integer, a slice or a list of integers"
        ) from None


def _position(place: str, wanted: int, size: int) -> int:
    if isinstance(wanted, (bool, np.bool_)):
        raise TypeError
    position = operator.index(wanted)
    if not -size <= position < size:
        raise ResultError(f"{place}: {position} is out of range; expected {-size} to {size - 1}")
    return position % size


def _read(dataset: Any, wanted: Sequence[int | slice | NDArray[Any]]) -> NDArray[Any]:
    """Read with one list of rising positions, which is all that h5py takes, and pick the rest."""
    stored: list[int | slice | NDArray[Any]] = []
    picks: list[NDArray[Any] | None] = []  # one for each axis that is left
    for choice in wanted:
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
