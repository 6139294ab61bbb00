"""The origin of a result: laws, group, configuration, versions, and cross-check.

A result file is validated when it is opened, so that every reader can rely on its content.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from pydantic import (
    BaseModel,
    FiniteFloat,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    ValidationError,
)

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, bare, printable, suggestion
from eqt_cli.base.registry import registry
from eqt_cli.base.store_reader import ResultFile
from eqt_cli.base.stored import POINT, SmallErrors, Words, distinct_titles

CROSS_CHECK = ("method", "runs", "difference", "bound")
"""Fields of a cross-check, each an attribute; a file has all of them or none."""


def check_coordinates(result: KnownResult) -> None:
    """Refuse times that do not increase, runs that are not numbered, and invalid labels.

    The attributes name only controllers that the file has.

    Raises
    ------
    ResultError
        For the first invalid coordinate.
    """
    for name in result.coordinates:
        if name == "time" and not _rises(result.coordinate(name)):
            raise result.refusal("its 'time' does not rise from one finite number to the next")
        if name in ("run", "stored_run", POINT):
            _check_numbers(result, name)
    if "controller" in result.coordinates:
        labels = result.coordinate("controller").tolist()
        if not all(isinstance(label, str) and label for label in labels):
            raise result.refusal("its controllers have no labels")
        if len(set(labels)) < len(labels):
            raise result.refusal("two of its controllers have one label")
        described = result.described
        listed = described.unclaimed + described.not_matched + described.without_forces
        for label in (*described.functions, *listed, *described.small_errors):
            if label not in labels:
                text = f"its attribute 'experiment' names '{label}', which is not a controller"
                raise result.refusal(text)


def _check_numbers(result: ResultFile, name: str) -> None:
    numbers = result.coordinate(name)
    whole = numbers.dtype.kind in "iu"
    if not whole or (numbers.size and not (_rises(numbers) and numbers[0] >= 0)):
        raise result.refusal(f"its '{name}' does not count from 0")
    size = result.dimensions.get("run", 0)
    if name != POINT and numbers.size and numbers[-1] >= size:  # of a shape, a point may be any
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


Arrow = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class StoredPart(BaseModel):
    """A part of the coordinates, as `components.groups.Part`: its dimension and its units."""

    name: Words
    dimension: PositiveInt
    turns: bool
    pose_unit: Words
    velocity_unit: Words
    force_unit: Words
    length_unit: Words


def stored_part(part: object) -> dict[str, Any]:
    """Return what a result holds of a part."""
    return StoredPart.model_validate(part, from_attributes=True).model_dump()


class Experiment(BaseModel):
    """What readers show of an experiment.

    Attributes
    ----------
    titles, kinds, functions
        Display name of each controller, its kind, and the name of its function L, by label.
    unclaimed, not_matched
        Labels of the laws that do not claim that their L decreases, and of those whose stiffness
        and damping are not those of the gains.
    without_forces
        Labels of the laws whose entries leave out the forces of the model.
    setpoints
        What laws know of the reference, by label, where that is not all.
    inner
        The blocks of their own that laws have before the actuators, in words, by label.
    small_errors
        Stiffness, damping and poles at rest of the laws for which they are known, by label.
    rtol
        Relative tolerance of all runs; None if it is swept.
    seed
        Seed of all random numbers.
    signal_path
        Path of the signals through the loop; empty for the paper's loop.
    exact
        What is measured without errors beside what is not; may be empty.
    loop
        Sentence about what the paper's loop does not have; may be empty.
    departures
        Departures of the loop from the one of the theorems, as verify says them.
    thrusters
        Place, m, and direction of each thruster in the body; a planar one has z = 0.
    down
        Whether the last axis of space points down.
    holds
        Signals that are held between ticks, with the time between two changes, s; none where the
        clock or the actuators are swept.
    decimate
        Of so many samples of a run, one is stored.
    remarks
        What was remarked on the configuration before it was run, each behind its key.
    axis
        The body axis that `task: point` turns; none of other tasks.
    parts
        The parts of the coordinates; none where the group is swept.
    window
        Start and end of the window over which metrics are taken, s; None for the end of the runs.
    """

    titles: dict[str, Words] = {}
    kinds: dict[str, Words] = {}
    functions: dict[str, str] = {}
    unclaimed: list[str] = []
    not_matched: list[str] = []
    without_forces: list[str] = []
    setpoints: dict[str, Words] = {}
    inner: dict[str, Words] = {}
    small_errors: dict[str, SmallErrors] = {}
    rtol: FiniteFloat | None = None
    seed: int = 0
    signal_path: Words = ""
    exact: Words = ""
    loop: Words = ""
    departures: Words = ""
    thrusters: list[tuple[Arrow, Arrow]] = []
    down: bool = False
    holds: dict[str, PositiveFloat] = {}
    decimate: PositiveInt = 1
    remarks: list[Words] = []
    axis: Arrow | None = None
    parts: list[StoredPart] = []
    window: tuple[NonNegativeFloat, PositiveFloat | None] = (0.0, None)


_TEXT = "text", TypeAdapter(str).validate_python
_NUMBER = "a number", TypeAdapter(float).validate_python

_EXPECTED: dict[str, tuple[str, Callable[..., Any]]] = {
    **dict.fromkeys(("title", "group", "digest", "config", "plugins"), _TEXT),
    "provenance": ("versions and times in JSON", _Origin.model_validate_json),
    "experiment": ("a description in JSON", Experiment.model_validate_json),
    "cross_check_method": _TEXT,
    "cross_check_runs": (
        "a whole number of at least 0",
        TypeAdapter(NonNegativeInt).validate_python,
    ),
    "cross_check_difference": _NUMBER,
    "cross_check_bound": _NUMBER,
    "cross_check_law": _TEXT,
    "row_error": _NUMBER,
    "row_metric": _TEXT,
    "row_law": _TEXT,
    "row_samples": _NUMBER,
}
"""Expected kind of each attribute that a file may have, in words, and what validates it."""


# The cross-check, and the result -----------------------------------------------------------------


@dataclass(frozen=True)
class CrossCheck:
    """The outcome of a cross-check.

    Attributes
    ----------
    method
        The method that repeated the runs, and how much of the horizon; after a comma, why it did
        not.
    runs
        Number of runs of each controller.
    difference
        Largest max(‖ΔQ‖_F, ‖ΔV‖) over samples and over the runs that did not fail; inf if one of
        these fails in the repetition, NaN if all runs failed.
    bound
        Allowed difference.
    law
        Label of the law whose difference is the largest, where that is more; else "".
    """

    method: str
    runs: int
    difference: float
    bound: float
    law: str = ""

    @property
    def holds(self) -> bool:
        """Whether the difference is within the bound."""
        return not self.difference > self.bound

    @property
    def described(self) -> str:
        """The outcome in a sentence without its full stop."""
        runs = f"{self.runs} run{'' if self.runs == 1 else 's'} per law"
        if np.isnan(self.difference):
            _, _, why = self.method.partition(", ")
            return f"cross-check skipped: {why or 'its runs failed'}"
        beyond = "" if self.holds else ", BEYOND its bound"
        return (
            f"cross-check: {runs} by {self.method}, largest difference {self.difference:.2g} "
            f"(bound {self.bound:.1g}){beyond}"
        )


class KnownResult(ResultFile):
    """An open result that describes its origin.

    Labels, titles and all other texts are safe to display.
    """

    of_all_points = (*ResultFile.of_all_points, "custom_names", "loops_of")

    def _check(self) -> None:
        # Attributes of another kind than eqt writes are refused.
        for name, (expected, validate) in _EXPECTED.items():
            if name in self.attributes:
                try:
                    validate(self.attributes[name], strict=True)
                except ValidationError:
                    raise self.refusal(f"its attribute '{name}' is not {expected}") from None
        there = [name for name in CROSS_CHECK if f"cross_check_{name}" in self.attributes]
        if there and len(there) < len(CROSS_CHECK):
            lacking = next(name for name in CROSS_CHECK if name not in there)
            raise self.refusal(f"it lacks the attribute 'cross_check_{lacking}'")
        check_coordinates(self)

    def error(self, message: str) -> EqtError:
        """Return an error about this result."""
        return EqtError(f"{self.path}: {message}")

    @property
    def title(self) -> str:
        """Name of the experiment; the folder's name if the file has none."""
        return printable(str(self.attributes.get("title", self.path.parent.name)))

    @property
    def group_name(self) -> str:
        """Name of the group, or of the groups of a sweep; empty if the file has none."""
        return printable(str(self.attributes.get("group", "")))

    @cached_property
    def labels(self) -> list[str]:
        """Labels of the controllers."""
        return [printable(str(label)) for label in self.coordinate("controller")]

    custom_names: Mapping[str, str] = MappingProxyType({})
    """User's titles of laws and quantities, by label and name."""

    @property
    def titles(self) -> list[str]:
        """Display names of the controllers: given by the user, titles of their laws, or labels.

        Labels where several laws have one title.
        """
        return list(self.title_of.values())

    @cached_property
    def _stored_titles(self) -> dict[str, str]:
        """Titles of the laws by label, without the names that a user gives."""
        stored = self.described.titles
        titles = {label: stored.get(label) or law_title(label) for label in self.labels}
        return distinct_titles(titles)

    @cached_property
    def title_of(self) -> dict[str, str]:
        """Display names by label."""
        custom = {k: name for k, name in self.custom_names.items() if k in self.labels}
        return distinct_titles(self._stored_titles | custom)

    def label_of(self, name: str) -> str:
        """Return the label of a controller, given its label or its display name: ``EqT``.

        Any other name is returned unchanged.
        """
        label = label_named(name, self.title_of)
        return label if label in self.labels else label_named(name, self._stored_titles)

    def position_of(self, name: str) -> int:
        """Return the index of the controller with this label or display name.

        Raises
        ------
        EqtError
            If there is no such controller.
        """
        label = self.label_of(name)
        if label not in self.labels:
            hint = suggestion(label, self.labels) or f"; there are: {', '.join(self.labels)}"
            raise self.error(f"holds no controller '{label}'{hint}")
        return self.labels.index(label)

    @cached_property
    def lyapunov_functions(self) -> dict[str, str]:
        """Name of each law's function L, by label; empty if it is the same for all."""
        functions = self.described.functions
        return functions if len(set(functions.values())) > 1 else {}

    @cached_property
    def without_function(self) -> list[str]:
        """Labels of laws that claim no decrease, if other laws claim it for their own L."""
        all_are = len(self.described.unclaimed) == len(self.labels)
        return self.described.unclaimed if self.lyapunov_functions and not all_are else []

    @cached_property
    def described(self) -> Experiment:
        """What readers show of the experiment."""
        return Experiment.model_validate_json(str(self.attributes.get("experiment", "{}")))

    @property
    def kinds(self) -> dict[str, str]:
        """Kind of each controller by label; the label where it is unknown."""
        return {label: self.described.kinds.get(label, label) for label in self.labels}

    loops_of: Callable[[KnownResult], Mapping[str, Any]]
    """Builds the loops from the stored configuration; set by who can read one."""

    @cached_property
    def loops(self) -> Mapping[str, Any]:
        """The loops by label, which figures of parts of the torque evaluate again.

        Raises
        ------
        EqtError
            If they cannot be built, for example without their plugins.
        """
        return self.loops_of(self)

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine and times from the file; empty if it has none."""
        return json.loads(str(self.attributes.get("provenance", "{}")))

    @property
    def cross_check(self) -> CrossCheck | None:
        """Outcome of the cross-check; None if there was none."""
        stored: Any = {name: self.attributes.get(f"cross_check_{name}") for name in CROSS_CHECK}
        stored["law"] = printable(str(self.attributes.get("cross_check_law", "")))
        return None if stored["method"] is None else CrossCheck(**stored)


def label_named(name: str, titled: Mapping[str, str]) -> str:
    """Return the label for a label or a unique display name; any other name is returned.

    ``GT`` and ``gt`` are the same name, unless both exist.
    """
    for form in (str, bare):
        labels = [label for label, title in titled.items() if form(title) == form(name)]
        labels = [label for label in titled if form(label) == form(name)] or labels
        if labels:
            return labels[0] if len(labels) == 1 else name
    return name


def law_title(name: str) -> str:
    """Return the display name of a law; its name if it is not registered."""
    laws = registry("controllers")
    return str(getattr(laws.get(name), "title", name)) if name in laws.names() else name
