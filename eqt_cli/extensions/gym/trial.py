"""A function of the user, tried in two states, before any environment takes its numbers."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from inspect import getclosurevars, isfunction, ismodule, isroutine
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.gym.stepping import Plant
from eqt_cli.numbers.program import ArrayProgram, Program

Terms = dict[str, Array]
"""Numbers of each run by name; of a function that names none, a single one named ""."""

ALIKE = 1e-9
"""Relative difference of numbers that differ by the order of their operations alone."""

DEPTH = 3
"""How deep what a function reads is looked into."""


class Trial:
    """Two states at different times, with other commands, and what a function gives there.

    Parameters
    ----------
    terms_of
        Returns the numbers that the function gives, from a function that gives signals by name,
        times, commands and the commands before.
    program_of
        Returns the program of a signal by name, and its held numbers.
    what
        What the function is, for messages.
    """

    def __init__(
        self,
        plant: Plant,
        function: Any,
        what: str,
        terms_of: Callable[..., Terms],
        program_of: Callable[[str], tuple[Program, Array]],
    ) -> None:
        self.plant, self.what = plant.of_two(), what
        self._terms_of, self._program_of = terms_of, program_of
        numbers = np.random.default_rng(0).uniform(-0.9, 0.9, (2, 2, plant.actions))
        self.action, self.last = numbers
        self._signals = dict[str, Array]()
        before = _state(function)
        self.values = self._of([0, 1])
        if not (_are_equal(self.values, self._of([0, 1])) and _state(function) == before):
            raise EqtError(
                f"{what}: gives other numbers for the same step, since it draws random numbers, "
                "counts, or keeps something; it may depend on its step alone, as -x.pose_error"
            )
        for k in (0, 1):
            alone = self._of([k])
            both = {name: value[[k]] for name, value in self.values.items()}
            if not _are_equal(alone, both, ALIKE):
                raise EqtError(
                    f"{what}: the number of an environment depends on the other environments; the "
                    "first axis of each signal counts the environments, so sum, index and "
                    "compare along the last axis, as (x.action**2).sum(axis=-1), x.velocity[..., 0]"
                )

    def _of(self, which: list[int]) -> Terms:
        def signal(name: str) -> Array:
            if name not in self._signals:
                program, held = self._program_of(name)
                self._signals[name] = by_numpy(program, self.plant.inputs(held))[name]
            return self._signals[name][which]

        t = self.plant.time[which]
        with np.errstate(all="ignore"):
            return self._terms_of(signal, t, self.action[which], self.last[which])

    def agrees(self, program: Program, held: Array) -> bool:
        """Whether a program of the function gives the same numbers."""
        rows = self.action, self.last
        computed = by_numpy(program, self.plant.inputs(held, rows))
        values = {name: x[:, 0] for name, x in zip(self.values, computed.values(), strict=True)}
        return _are_equal(values, self.values, 1e3 * ALIKE)

    def repeat(self) -> None:
        """Refuse a function that gives other numbers than when it was set."""
        now = self._of([0, 1])
        if not _are_equal(now, self.values):
            name = next(
                name
                for name, x in now.items()
                if name not in self.values or (x != self.values[name]).any()
            )
            raise EqtError(
                f"{self.what}: gives {now[name][0]:.6g} where it gave "
                f"{self.values.get(name, [np.nan])[0]:.6g} when it was set, so what it reads has "
                "changed; set it again by env.set_reward, or make another environment"
            )


def _are_equal(one: Terms, other: Terms, within: float = 0.0) -> bool:
    if one.keys() != other.keys():
        return False
    pairs = [(x, other[name]) for name, x in one.items()]
    return all(np.allclose(a, b, rtol=within, atol=within, equal_nan=True) for a, b in pairs)


def _state(function: Any) -> list[str]:
    """Return all that a function may change by a call, as texts."""
    of_numpy = np.random.get_state()  # noqa: NPY002 (which a function may draw from)
    parts: list[Any] = [of_numpy, random.getstate(), getattr(function, "__self__", 0)]
    function = getattr(function, "__func__", function)
    if isfunction(function):
        read = getclosurevars(function)
        parts += [read.nonlocals, read.globals, function.__defaults__]
    else:
        parts.append(function)
    return [_text(part, DEPTH) for part in parts]


def _text(value: Any, depth: int) -> str:
    if ismodule(value) or isroutine(value) or isinstance(value, type) or depth < 0:
        return ""
    if isinstance(value, np.random.Generator):
        return repr(value.bit_generator.state)
    if isinstance(value, np.ndarray):
        return repr(value.tobytes()) if value.dtype != object else ""
    if isinstance(value, Mapping):
        return repr([(key, _text(entry, depth - 1)) for key, entry in value.items()])
    if isinstance(value, list | tuple | set):
        return repr([_text(entry, depth - 1) for entry in value])
    if fields := getattr(value, "__dict__", None):
        return _text(fields, depth - 1)
    return repr(value)


def by_numpy(program: Program, inputs: list[Any]) -> Arrays:
    """Return the arrays of a program for some runs, ``(runs, …)`` each, without a compiler."""
    rows = np.concatenate([part.values for part in inputs], axis=1).T
    called = ArrayProgram(program, rows.shape[1])
    ends = np.cumsum([len(part) for part in called.inputs.values()])
    for part, values in zip(called.inputs.values(), np.split(rows, ends[:-1]), strict=True):
        part[:] = values
    with np.errstate(all="ignore"):
        return {name: np.moveaxis(x, -1, 0) for name, x in called().items()}
