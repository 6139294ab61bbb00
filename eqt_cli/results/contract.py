"""Validates a result file when it is opened, so that every reader can rely on its content.

A file may come from anyone, or from a failing disk: it can be a valid HDF5 file with content that
eqt never writes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import BaseModel, Json, NonNegativeInt, TypeAdapter, ValidationError

from eqt_cli.core.arrays import Array
from eqt_cli.store.reader import ResultFile

CROSS_CHECK = ("method", "runs", "difference", "bound")
"""Fields of a cross-check, each an attribute; a file has all of them or none."""


def check_attributes(result: ResultFile) -> None:
    """Refuse attributes of another kind than eqt writes.

    Raises
    ------
    ResultError
        For the first such attribute.
    """
    for name, expected in _EXPECTED.items():
        if name in result.attributes:
            try:
                value = _KINDS[expected].validate_python(result.attributes[name], strict=True)
            except ValidationError:
                raise result.refusal(f"its attribute '{name}' is not {expected}") from None
            if isinstance(value, _AboutLaws):
                _check_labels(result, name, value)
    there = [name for name in CROSS_CHECK if f"cross_check_{name}" in result.attributes]
    if there and len(there) < len(CROSS_CHECK):
        lacking = next(name for name in CROSS_CHECK if name not in there)
        raise result.refusal(f"it lacks the attribute 'cross_check_{lacking}'")


def _check_labels(result: ResultFile, name: str, value: _AboutLaws) -> None:
    """Refuse an attribute about controllers that the file does not have."""
    if "controller" not in result.coordinates:
        return
    for label in value.labels():
        if label not in result.coordinate("controller").tolist():
            raise result.refusal(f"its attribute '{name}' names '{label}', which is no controller")


def check_coordinates(result: ResultFile) -> None:
    """Refuse times that do not increase, runs that are not numbered, and invalid labels.

    Raises
    ------
    ResultError
        For the first invalid coordinate.
    """
    for name in result.coordinates:
        if name == "time" and not _rises(result.coordinate(name)):
            raise result.refusal("its 'time' does not rise from one finite number to the next")
        if name in ("run", "stored_run", "point"):
            _check_numbers(result, name)
    if "controller" in result.coordinates:
        labels = result.coordinate("controller").tolist()
        if not all(isinstance(label, str) and label for label in labels):
            raise result.refusal("its controllers have no labels")
        if len(set(labels)) < len(labels):
            raise result.refusal("two of its controllers have one label")


def check_status(result: ResultFile, status: Array) -> None:
    """Refuse a status that is not a whole number of at least 0.

    Raises
    ------
    ResultError
        If a status is invalid.
    """
    if status.dtype.kind not in "iu" and not (status == np.round(status)).all():  # NaN is not
        raise result.refusal("its 'status' is not whole numbers")
    if status.size and status.min() < 0:
        raise result.refusal(f"its 'status' is {status.min():g} for a run")


def _check_numbers(result: ResultFile, name: str) -> None:
    numbers = result.coordinate(name)
    size = result.dimensions.get("run" if name == "stored_run" else name, 0)
    whole = numbers.dtype.kind in "iu"
    if not whole or (numbers.size and not (_rises(numbers) and numbers[0] >= 0)):
        raise result.refusal(f"its '{name}' does not count from 0")
    if numbers.size and numbers[-1] >= size:
        raise result.refusal(f"its '{name}' counts to {numbers[-1]}, and there are {size}")


def _rises(values: Array) -> bool:
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        return False
    return bool((values[1:] > values[:-1]).all())


# Attributes ---------------------------------------------------------------------------------------


class _Origin(BaseModel):
    """Versions and times of a session, and those of other sessions."""

    eqt: str = ""
    python: str = ""
    started: str = ""
    other_sessions: list[dict[str, Any]] = []


class _AboutLaws(BaseModel):
    """An attribute about some laws, by their labels."""

    def labels(self) -> list[str]:
        """Return the labels of these laws."""
        return []


class _Functions(_AboutLaws):
    """Name of each law's function L by label, and labels of laws that claim no decrease of it."""

    functions: dict[str, str] = {}
    unclaimed: list[str] = []

    def labels(self) -> list[str]:
        """Return the labels of both."""
        return [*self.functions, *self.unclaimed]


class _Matching(_AboutLaws):
    """Labels of laws whose stiffness and damping are not those of the gains."""

    not_matched: list[str] = []

    def labels(self) -> list[str]:
        """Return the labels of these laws."""
        return self.not_matched


_KINDS: dict[str, TypeAdapter[Any]] = {
    "text": TypeAdapter(str),
    "a number": TypeAdapter(float),
    "a whole number of at least 0": TypeAdapter(NonNegativeInt),
    "a mapping in JSON from names to texts": TypeAdapter(Json[dict[str, str]]),
    "versions and times in JSON": TypeAdapter(Json[_Origin]),
    "names of functions in JSON": TypeAdapter(Json[_Functions]),
    "labels of laws in JSON": TypeAdapter(Json[_Matching]),
}

_EXPECTED = {
    **dict.fromkeys(("title", "group", "digest", "config", "plugins"), "text"),
    "titles": "a mapping in JSON from names to texts",
    "provenance": "versions and times in JSON",
    "lyapunov_functions": "names of functions in JSON",
    "matching": "labels of laws in JSON",
    "cross_check_method": "text",
    "cross_check_runs": "a whole number of at least 0",
    "cross_check_difference": "a number",
    "cross_check_bound": "a number",
}
"""Expected kind of each attribute that a file may have."""
