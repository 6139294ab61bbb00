"""What results hold, for those who write them and those who read them, in names and units."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import AfterValidator, BaseModel, FiniteFloat

from eqt_cli.base.errors import printable
from eqt_cli.base.files import SHAPES

# Names in result files ----------------------------------------------------------------------------

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.@+-]*")
"""Valid names of variables, dimensions and attributes, which all HDF5 tools accept."""

Attribute = str | int | float

FORMAT = 5
"""Number of the file layout; a reader refuses every other number.

In 3, strings have a fixed length, and variables number the texts of a table; in 4, results hold the
parts of the coordinates with their units, so that readers need no group; in 5, points of one shape
are a result of their own."""

FORMAT_ATTRIBUTE = "eqt_format"
"""The root attribute that marks a file as eqt's and holds its `FORMAT`."""

VERSION_ATTRIBUTE = "eqt_version"
"""The root attribute with the version of eqt that wrote the file, a string of fixed length."""

PLACEHOLDER = "This is a netCDF dimension but not a netCDF variable."
"""Label of netCDF-4 for the scale of a dimension with a size but without coordinate values."""

POINT = "point"
"""The dimension of a sweep's points."""

CASE = "case"
"""The coordinate of a sweep with the names of cases, which is no key of the configuration."""

FORMULA = "formula"
"""The attribute of the coordinate of a key that follows from swept ones: how."""

LAW = "law"
"""The variable with the registered law that a controller equals at a point."""

SHAPE = "shape"
"""The variable with the number of each point's shape."""

TEXTS = "_text"
"""End of the name of a table in the root with the texts that a variable numbers."""

COORDINATES = "coordinates"
"""The CF attribute that names further coordinates of a variable, separated by blanks."""

_OF_HDF5 = "CLASS NAME DIMENSION_LABELS DIMENSION_LIST REFERENCE_LIST".split()
_OF_NETCDF = "_Netcdf4Dimid _Netcdf4Coordinates _NCProperties _nc3_strict _Encoding".split()
RESERVED = {FORMAT_ATTRIBUTE, VERSION_ATTRIBUTE, COORDINATES, SHAPES, *_OF_HDF5, *_OF_NETCDF}
"""Attributes that hold the structure of the file, and are never a user's."""


# Signals over time; formulas are in `loop.signals`, signals of actuators stand with these ---------


MIXED = "mixed"
"""The unit of a signal whose units differ between parts of the coordinates."""

MATRIX, VECTOR = ("row", "col"), ("axis",)
THRUSTER, WHEEL = "thruster", "wheel"
"""Names of the dimensions of thrusters and wheels."""

LAW_OUTPUT, OUTPUT = "law_output", "output"
"""Name of the signal with the stored numbers of a law, and of their dimension."""

Norm: TypeAlias = Literal["", "entries", "axes", "each"]

Better = Literal["lower", "higher", "neither"]
"""Which values of a quantity are better."""


class Symbol(NamedTuple):
    """A symbol, or a formula with ``{}`` for one, in LaTeX and in plain characters."""

    latex: str
    plain: str


@dataclass(frozen=True)
class Signal:
    """A quantity over time of one run.

    Attributes
    ----------
    name
        Its name in a result file.
    symbol
        Symbol of the paper.
    unit
        Its unit, or the attribute of a part of the coordinates that has it: ``pose_unit``.
    dims
        Dimensions beyond run and time: ``("row", "col")``, ``("axis",)`` or none.
    norm
        Whether it is the norm of the ``entries`` of a matrix, or along the ``axes`` of the
        coordinates; a norm also exists for each part of them. With ``each``, it is 1 where any of
        the coordinates is, and exists for each of them.
    rank
        Its place among the signals that a page draws; 0 if it does not.
    words
        Its name in words, of a signal that stands with an actuator; "" for others.
    """

    name: str
    symbol: Symbol
    unit: str
    dims: tuple[str, ...] = ()
    norm: Norm = ""
    rank: int = 0
    words: str = ""

    def unit_in(self, part: object) -> str:
        """Return its unit in a part of the coordinates."""
        return str(getattr(part, self.unit, self.unit))


def signal(name: str, unit: str, latex: str, plain: str = "", **more: Any) -> Signal:
    """Return a signal, whose symbol in plain characters is that in LaTeX if no other is given."""
    return Signal(name, Symbol(latex, plain or latex), unit, **more)


_F = r"\|_{\mathrm{F}}"
_ESTIMATE = r"\|I - \hat{Q}^{-1} Q" + _F

_ROWS = (
    signal("pose", "pose_unit", "Q", dims=MATRIX),
    signal("velocity", "velocity_unit", "V", dims=VECTOR),
    signal("torque", "force_unit", r"\tau", "τ", dims=VECTOR),
    signal("pose_error", "pose_unit", r"\|I - Q_E" + _F, "‖I − Q_E‖", norm="entries", rank=1),
    signal("velocity_error", "velocity_unit", r"\|V - V_d\|", "‖V − V_d‖", norm="axes", rank=3),
    signal("torque_norm", "force_unit", r"\|\tau\|", "‖τ‖", norm="axes", rank=4),
    signal("lyapunov", "J", r"\mathcal{L}", "L", rank=5),
    signal("position_error", "m", r"\|p - p_d\|", "‖p − p_d‖", rank=2),
    signal("pointing_error", "deg", r"\theta_a", "θ_a"),
    signal("attitude_angle", "deg", r"\theta_E", "θ_E"),
    signal("heading_error", "deg", r"\psi_E", "ψ_E"),
    signal("attitude_command_error", "1", r"\|R - R_c" + _F, "‖R − R_c‖"),
    signal("command", "force_unit", "u", dims=VECTOR),
    signal("at_limit", "1", "s"),
    signal("cut", "1", "c", norm="each"),
    signal("burnt", "kg", "m"),
    signal("stored_momentum", "N m s", r"\|A h\|", "‖A h‖"),
    signal("law_output", MIXED, "z", dims=(OUTPUT,)),
    signal("estimated_pose", "pose_unit", r"\hat{Q}", "Q̂", dims=MATRIX),
    signal("estimated_velocity", "velocity_unit", r"\hat{V}", "V̂", dims=VECTOR),
    signal("estimated_bias", "velocity_unit", r"\hat{b}", "b̂", dims=VECTOR),
    signal("estimate_error", "pose_unit", _ESTIMATE, "‖I − Q̂⁻¹ Q‖", norm="entries"),
    signal("bias_error", "velocity_unit", r"\|b - \hat{b}\|", "‖b − b̂‖", norm="axes"),
    signal("pose_estimate_error", "length_unit", r"\varepsilon", "ε", dims=VECTOR),
    signal("bias_estimate_error", "velocity_unit", r"\tilde{b}", "b̃", dims=VECTOR),
    signal("pose_estimate_std", "length_unit", r"\sigma_\varepsilon", "σ_ε", dims=VECTOR),
    signal("bias_estimate_std", "velocity_unit", r"\sigma_b", "σ_b", dims=VECTOR),
    signal("nees", "1", r"\mathrm{NEES}", "NEES"),
    signal("nees_dof", "1", "n"),
    signal("innovations", "1", "N"),
    signal("innovation_square", "1", r"\nu^2", "ν²"),
    signal("innovation_correlation", "1", r"\rho_1", "ρ₁"),
)

SIGNALS = {row.name: row for row in _ROWS}
"""All signals by name, in the order of result files; those of actuators stand with these."""


@cache
def signal_of(name: str) -> Signal | None:
    """Return the signal of a name, which may end with a part: ``torque_norm_rotation``."""
    # The last one first: ``pose_error`` is no part of ``pose``.
    names = (signal for signal in reversed(SIGNALS) if f"{name}_".startswith(f"{signal}_"))
    return SIGNALS.get(next(names, ""))


# Runs and laws ------------------------------------------------------------------------------------


class Status(IntEnum):
    """Outcome of a run; only 0 is success. No result holds one that was stopped."""

    STOPPED = -1
    OK = 0
    SOLVER_FAILED = 1
    NON_FINITE = 2
    STEP_LIMIT = 3
    ACCURACY = 4
    WORKER_LOST = 5
    ESTIMATE_LOST = 6
    DIVERGED = 7
    BY_ROUNDING = 8
    NO_ANSWER = 9
    BOUND_CROSSED = 10


def distinct_titles(titles: Mapping[str, str]) -> dict[str, str]:
    """Titles by label; the labels in place of titles that several have."""
    shared = [title for title, count in Counter(titles.values()).items() if count > 1]
    return {label: label if title in shared else title for label, title in titles.items()}


DIFFERENT = 0.05
"""Relative: poles of a law, and gains of two laws, that differ by more are named."""


def _square(matrices: list[list[list[float]]]) -> list[list[list[float]]]:
    """Refuse what is no stack of square matrices: it may come from a file."""
    m = len(matrices[0]) if matrices else 0
    if not m or any(len(rows) != m or any(len(row) != m for row in rows) for rows in matrices):
        raise ValueError("expected square matrices")
    return matrices


Words = Annotated[str, AfterValidator(printable)]
Matrices = Annotated[list[list[list[FiniteFloat]]], AfterValidator(_square)]


class SmallErrors(BaseModel):
    """How a law meets small errors at rest along its reference.

    Attributes
    ----------
    poles
        The slowest pole at the start, at the end and at its worst, in words.
    departs
        How the poles differ from those at Q_d = I, and why; "" where they hardly do.
    in_space
        Which gains the reference turns: `K`, `K_d`, or both.
    stiffness, damping
        At the start and the end, divided by the inertia, 1/s² and 1/s.
    """

    poles: Words
    departs: Words
    in_space: list[Words]
    stiffness: Matrices
    damping: Matrices

    def differs_from(self, other: SmallErrors) -> str:
        """Return how stiffness and damping differ from another law's, in words; or ""."""
        words = []
        for name in ("stiffness", "damping"):
            one, two = np.array(getattr(self, name)), np.array(getattr(other, name))
            if one.shape != two.shape:
                return ""  # an attitude law in a cascade, and a law of the whole pose
            if np.linalg.norm(one - two) > DIFFERENT * np.linalg.norm(two):
                factor = (one * two).sum() / max((two * two).sum(), np.finfo(float).tiny)
                is_multiple = np.allclose(one, factor * two, atol=DIFFERENT * np.abs(one).max())
                words.append(f"{factor:.3g} times the {name}" if is_multiple else f"not the {name}")
        if not words and self.in_space != other.in_space and (self.departs or other.departs):
            words = ["not, on the way, the stiffness and damping"]
        return " and ".join(words)
