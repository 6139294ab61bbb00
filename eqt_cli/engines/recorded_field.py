"""A vector field as the NumPy calls that it makes, which are recorded once and then repeated.

The laws are evaluated once on `Recorded` arrays, which note every NumPy call made with them. From
then on only these calls are made, on existing arrays, without the Python code around them. A law
that cannot be recorded, because it branches on a number, is evaluated as it is written. It knows
no group and no law.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from eqt_cli.core.arrays import Array

Field = Callable[[float, Array], Array]
"""A function of a time and flat states ``(runs, n)`` to their time derivatives."""

Held = Mapping[str, Array]
"""Numbers that a field holds between two known instants, by name."""

WORTH_RECORDING = 40
"""Evaluations before the field is recorded, which takes as long as about ten of them."""

COMPARED = 2
"""Number of later evaluations in which the recording is compared with the field."""

ROUNDING = 1e-10
"""Allowed difference of the two, which round differently, relative to the largest entry."""


class RecordedField:
    """A vector field of states of one shape, recorded when it is evaluated often.

    It is recorded after a fixed number of evaluations, so that equal problems have equal solutions.

    Parameters
    ----------
    fields
        Returns the field for the numbers that it holds between two known instants.
    """

    def __init__(self, fields: Callable[[Held], Field]) -> None:
        self._fields = fields
        self._evaluations = 0
        self._recording: RecordedCalls | None = None
        self.hold({})

    def hold(self, held: Held) -> None:
        """Hold other numbers from now on, with the same names and shapes."""
        self._held, self._field = held, self._fields(held)

    def __call__(self, t: float, states: Array) -> Array:
        self._evaluations += 1
        behind = self._evaluations - WORTH_RECORDING
        if self._recording is not None and behind > COMPARED:
            return self._recording.repeat(t, states, *self._held.values())
        rates = self._field(t, states)
        if behind == 0:
            self._recording = self._recorded(t, states)
        elif self._recording is not None:
            repeated = self._recording.repeat(t, states, *self._held.values())
            if not _agree(repeated, rates):  # the field depends on more than it is given
                self._recording = None
        return rates

    def _recorded(self, t: float, states: Array) -> RecordedCalls | None:
        def field(t: Any, states: Any, *numbers: Any) -> Any:
            return self._fields(dict(zip(self._held, numbers, strict=True)))(t, states)

        try:
            return RecordedCalls(field, t, states, *self._held.values())
        except Exception:  # a law may do anything with a stand-in for an array: not recorded then
            return None


def _agree(one: Array, other: Array) -> bool:
    scale = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    return np.allclose(one, other, rtol=0.0, atol=ROUNDING * scale, equal_nan=True)


class NotRecordable(Exception):
    """An operation that depends on more than shapes, so that it cannot be repeated."""


class RecordedCalls:
    """The recorded calls, in order, and the arrays that they read and write.

    All arrays have the runs along their last axis in memory, so that a call processes one entry of
    all runs at once.
    """

    def __init__(self, field: Callable[..., Any], t: float, states: Array, *held: Array) -> None:
        self.calls: list[Callable[[], Any]] = []
        self._runs = len(states)
        self._known: dict[Any, tuple[Recorded, Any]] = {}
        self._given = [self._kept(values) for values in (t, states, *held)]
        rates = field(*(Recorded(self, values) for values in self._given))
        if not isinstance(rates, Recorded) or rates.shape != states.shape:
            raise NotRecordable
        self._rates: Array = rates.value
        self._known.clear()

    def repeat(self, t: float, states: Array, *held: Array) -> Array:
        """Evaluate the field at another time, states and held numbers of the same shapes."""
        for place, values in zip(self._given, (t, states, *held), strict=True):
            place[...] = values
        for call in self.calls:
            call()
        return self._rates.copy(order="C")

    def _kept(self, values: Any) -> Array:
        """Return a new array with these values."""
        values = np.asarray(values)
        array = self.empty(values.shape, values.dtype)
        array[...] = values
        return array

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Array:
        """Return an array with the runs along its last axis in memory."""
        if np.dtype(dtype).hasobject:
            raise NotRecordable
        if len(shape) > 1 and shape[0] == self._runs:
            return np.moveaxis(np.empty((*shape[1:], shape[0]), dtype), -1, 0)
        return np.empty(shape, dtype)

    def call(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Recorded:
        """Record a function that takes `out`; equal calls are made only once."""
        values = [_value(argument) for argument in arguments]
        key = function, *map(_identity, arguments), repr(options)
        if key not in self._known:
            out = self._kept(function(*values, **options))
            result = self._note(out, partial(function, *values, **options, out=out))
            self._known[key] = result, values  # while they live, no other array has their identity
            return result
        result, _ = self._known[key]
        result.memory.shared = True
        return result

    def copied(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Recorded:
        """Record any other function of arrays, whose result is copied."""
        values = [_value(argument) for argument in arguments]
        out = self._kept(function(*values, **options))
        return self._note(out, lambda: np.copyto(out, function(*values, **options)))

    def blank(self, shape: tuple[int, ...], dtype: Any, zeros: bool) -> Recorded:
        """Return an array for a law to write into, with zeros if it may not fill all of it."""
        out = self.empty(shape, dtype)
        return self._note(out, partial(out.fill, 0)) if zeros else Recorded(self, out)

    def _note(self, out: Array, call: Callable[[], Any]) -> Recorded:
        call()
        self.calls.append(call)
        return Recorded(self, out)


class _Memory:
    """The shared state of arrays that are views of each other."""

    def __init__(self) -> None:
        self.version = 0
        self.shared = False


class Recorded(NDArrayOperatorsMixin):
    """A stand-in for an array while a field is recorded; its numbers cannot be read."""

    def __init__(
        self, recording: RecordedCalls, value: Array, memory: _Memory | None = None
    ) -> None:
        self.recording, self.value, self.memory = recording, value, memory or _Memory()
        self.shape, self.ndim = value.shape, value.ndim
        self.size, self.dtype = value.size, value.dtype

    @property
    def T(self) -> Recorded:
        return self._view(self.value.T)

    def _view(self, value: Array) -> Recorded:
        return Recorded(self.recording, value, self.memory)

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> Recorded:
        return self._selected(lambda array: array[_known_index(index)])

    def __setitem__(self, index: Any, values: Any) -> None:
        if self.memory.shared:
            raise NotRecordable
        self.memory.version += 1
        assign = partial(operator.setitem, self.value, _known_index(index), _value(values))
        assign()
        self.recording.calls.append(assign)

    def reshape(self, *shape: Any) -> Recorded:
        return self._selected(lambda array: array.reshape(*shape))

    def _selected(self, select: Callable[[Array], Array]) -> Recorded:
        """Return a view of selected entries, or a recorded copy if NumPy has no view."""
        selected = np.asarray(select(self.value))
        if np.may_share_memory(selected, self.value):
            return self._view(selected)
        return self.recording.copied(select, self)

    def swapaxes(self, one: int, other: int) -> Recorded:
        return self._view(self.value.swapaxes(one, other))

    def transpose(self, axes: tuple[int, ...]) -> Recorded:
        return self._view(self.value.transpose(axes))

    def copy(self) -> Recorded:
        return self.recording.copied(lambda array: array, self)

    def sum(self, axis: Any = None) -> Recorded:
        return self.recording.call(np.add.reduce, self, axis=axis)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            raise NotRecordable
        if ufunc is np.matmul:
            return _product(self.recording, *inputs)
        return self.recording.call(ufunc, *inputs)

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        if function in (np.empty_like, np.zeros_like, np.ones_like):
            made = function(*map(_value, inputs), **options)
            if function is np.ones_like:
                return made
            return self.recording.blank(made.shape, made.dtype, function is np.zeros_like)
        if function is np.broadcast_to:
            return self._selected(lambda array: np.broadcast_to(array, *inputs[1:], **options))
        if function is np.result_type:
            return np.result_type(*(getattr(each, "dtype", each) for each in inputs))
        if function not in COPIED:
            raise NotRecordable
        return self.recording.copied(partial(_of_values, function), *inputs, **options)

    def __array__(self, *_: Any, **__: Any) -> Array:
        raise NotRecordable

    def __bool__(self) -> bool:
        raise NotRecordable


COPIED = {np.where, np.concatenate, np.linalg.inv, np.linalg.solve}
"""Functions whose results depend on values only, and that take no `out`."""


def _of_values(function: Callable[..., Any], *arguments: Any, **options: Any) -> Array:
    return function(*map(_value, arguments), **options)


def _product(recording: RecordedCalls, a: Any, b: Any) -> Any:
    """Return a @ b by the function that is fastest with the runs along the last axis in memory."""
    if a.ndim == b.ndim == 2:
        return recording.call(np.matmul, b.T, a.T).T
    if a.ndim > 2 and b.ndim == 2 and not isinstance(b, Recorded):
        runs_last, runs_first = (*range(1, a.ndim), 0), (a.ndim - 1, *range(a.ndim - 1))
        return recording.call(np.matmul, b.T, a.transpose(runs_last)).transpose(runs_first)
    if a.ndim == 1 or b.ndim == 1:
        return recording.call(np.matmul, a, b)
    return recording.call(_stacked_product, a, b)


_stacked_product = partial(np.einsum, "...ij,...jk->...ik")


def _value(argument: Any) -> Any:
    """Return the array that an argument stands for."""
    if isinstance(argument, Recorded):
        return argument.value
    if isinstance(argument, list | tuple):
        return type(argument)(map(_value, argument))
    return argument


def _known_index(index: Any) -> Any:
    """Return an index that is the same at every repetition."""
    if any(isinstance(part, Recorded) for part in (index if isinstance(index, tuple) else [index])):
        raise NotRecordable
    return index


def _identity(argument: Any) -> Any:
    """Return a key, equal for arguments with equal values at every repetition."""
    version: Any = None
    if isinstance(argument, Recorded):
        version, argument = (id(argument.memory), argument.memory.version), argument.value
    if isinstance(argument, np.ndarray):
        return argument.ctypes.data, argument.shape, argument.strides, argument.dtype.str, version
    return type(argument), repr(argument)  # 0.0 and -0.0 are equal but not identical
