"""A law to export, with its program, numbers, states and error bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from eqt_cli.analysis.certificates.base import Row
from eqt_cli.analysis.evidence.program_error import FLOAT, Arithmetic, Bounded, bounded
from eqt_cli.analysis.verification import identities_of
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.law_program import CONTROLLER, MEMORY, NUMBER, TORQUE, LawProgram
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, Remedy, suggestion
from eqt_cli.core.leaves import leaves
from eqt_cli.engines.traced_loop import law_of
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.exporting.filters import ExportedFilter, exported_filter
from eqt_cli.exporting.reference import ReferenceProgram, reference_program
from eqt_cli.exporting.states import States, states_of
from eqt_cli.program.c_names import distinct


@dataclass(frozen=True)
class ExportedLaw:
    """A law of an experiment, to be written as C.

    Attributes
    ----------
    label, name
        Name of the law in the experiment, and in C.
    by
        Arithmetic in which the law is computed.
    reference
        Program of the reference; None where it is not exported.
    filter
        Filter whose estimate the law reads; None where it reads measurements.
    """

    experiment: Experiment
    label: str
    name: str
    by: Arithmetic
    program: LawProgram
    states: States
    reference: ReferenceProgram | None
    filter: ExportedFilter | None

    @property
    def loop(self) -> ClosedLoop:
        """Closed loop of the law."""
        return self.experiment.loops[self.label]

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Numbers of the experiment, by name."""
        return self.program.values(self.loop)

    @cached_property
    def fixed(self) -> frozenset[str]:
        """Names of the numbers that are no options: the law fixes them."""
        law = self.loop.controller
        options = {field.name for field in fields(law) if field.init}
        own = {CONTROLLER + path for path in leaves(law) if path not in options}
        return frozenset(each.name for each in self.program.numbers if each.source in own)

    def bounds(self, states: Mapping[str, Array]) -> dict[str, Bounded]:
        """Return the output of the law at some states, with bounds of its rounding errors.

        In float, the inputs and the numbers of the law are rounded too.
        """
        given = {NUMBER + name: values.reshape(-1) for name, values in self.numbers.items()}
        inputs = {**states, **given}
        errors = None
        if self.by is FLOAT:
            errors = {name: np.abs(self.by.rounded(x) - x) for name, x in inputs.items()}
        return bounded(self.program.step, inputs, self.by, errors)

    @cached_property
    def judged(self) -> dict[str, Bounded]:
        """Output of the law and bounds of its errors at all its states."""
        return self.bounds(self.states.inputs)

    @property
    def singular(self) -> Array:
        """Mask of the states near a singularity, ``(states,)``."""
        found = np.zeros(self.states.count, dtype=bool)
        for each in self.judged.values():
            found |= each.singular
        return found

    @cached_property
    def torque_bound(self) -> Array:
        """Largest bound of each torque away from singularities, ``(m,)``."""
        return self._largest(~self.singular)

    @cached_property
    def singular_bound(self) -> Array:
        """Largest bound of each torque near singularities, ``(m,)``; empty without such states."""
        return self._largest(self.singular)

    def _largest(self, states: Array) -> Array:
        errors = self.judged[TORQUE].errors[states]
        return errors.max(axis=0) if len(errors) else np.empty(0)


@dataclass(frozen=True)
class Exported:
    """The exported laws of an experiment.

    Attributes
    ----------
    laws
        Laws in the order of the experiment.
    """

    experiment: Experiment
    laws: Sequence[ExportedLaw]

    @cached_property
    def rows(self) -> Sequence[Row]:
        """Results of `eqt verify` for the identities of all laws."""
        return identities_of(self.experiment)


def exported(
    experiment: Experiment,
    labels: Sequence[str],
    by: Arithmetic,
    *,
    reference: bool = False,
    workers: int = 1,
) -> Exported:
    """Return laws of an experiment, to be written as C.

    Parameters
    ----------
    labels
        Labels of the laws; all if empty.
    reference
        Whether to export the reference too.

    Raises
    ------
    EqtError
        If there is no such law, one cannot be traced or has memory without a period, the reference
        is integrated, or measurements for an estimator arrive late.
    """
    for label in labels:
        if label not in experiment.loops:
            raise EqtError(
                f"controller {label!r} is not in this experiment; expected "
                f"{', '.join(experiment.loops)}{suggestion(label, experiment.loops)}"
            )
    names = dict(zip(experiment.loops, distinct(experiment.loops), strict=True))
    wanted = [label for label in experiment.loops if not labels or label in labels]
    programs = {label: _program(experiment, label) for label in wanted}
    of_reference = reference_program(experiment) if reference else None
    laws = [
        ExportedLaw(
            experiment,
            label,
            names[label],
            by,
            program,
            states_of(experiment, label, program, workers),
            of_reference,
            exported_filter(experiment.loops[label], label, experiment.config.ensemble.seed),
        )
        for label, program in programs.items()
    ]
    return Exported(experiment, laws)


def _program(experiment: Experiment, label: str) -> LawProgram:
    loop = experiment.loops[label]
    if code := loop.controller.code:
        raise EqtError(
            f"{label}: the law is in C already, in {code.file}",
            Remedy("leave it out, or export the law that it claims to be"),
        )
    program = law_of(loop)
    if program.memory and loop.vehicle.control is None:
        states = ", ".join(entry.source for entry in program.memory)
        raise EqtError(
            f"{label}: the law has memory ({states}), which goes on by one period; the "
            "configuration has no period",
            Remedy("set control.period to the period of your vehicle in s"),
        )
    return program


def memory_of(bounds: Mapping[str, Bounded], law: LawProgram) -> Bounded:
    """Return the memory after a period, all states concatenated."""
    parts = [bounds[MEMORY + entry.name] for entry in law.memory]
    if not parts:
        count = len(next(iter(bounds.values())).values)
        return Bounded(np.zeros((count, 0)), np.zeros((count, 0)), np.zeros(count, dtype=bool))
    values, errors = (np.concatenate([each[k] for each in parts], axis=1) for k in range(2))
    return Bounded(values, errors, np.logical_or.reduce([each.singular for each in parts]))
