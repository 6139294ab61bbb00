"""Base classes of claims. Does not know how claims are tested."""

from abc import ABC
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.results.time_windows import WHOLE, Window


@dataclass(frozen=True)
class Less:
    """One controller has less of something than another, on average over initial states.

    Attributes
    ----------
    lesser, greater
        Kinds of controllers, as in a configuration: ``eqt``.
    measure
        Name of a measure. If its parts have different units, each part is tested.
    window
        Window over which it is taken.
    rotation_only
        Whether the claim concerns only the orientation; then other parts of the pose are not
        tested.
    """

    lesser: str
    greater: str
    measure: str
    window: Window = WHOLE
    rotation_only: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the controllers of the claim."""
        return (self.lesser, self.greater)


@dataclass(frozen=True)
class AtMost:
    """In every run, a measure stays at or below a bound.

    Attributes
    ----------
    kind
        Kind of the controller.
    measure
        Name of a measure.
    bound
        Bound in the unit of the measure.
    statement
        The claim in words.
    """

    kind: str
    measure: str
    bound: float
    statement: str

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of the controller of the claim."""
        return (self.kind,)


@dataclass(frozen=True)
class Claim:
    """A sentence, and the rows by which it is measured.

    Attributes
    ----------
    says
        The claim in the words of its source.
    rows
        Statements that are tested separately; the claim is supported as far as they are.
    """

    says: str
    rows: tuple[Less | AtMost, ...]


class ClaimSet(ABC):
    """The claims of one source.

    Attributes
    ----------
    name
        Short name for tables and messages.
    source
        Reference of the source.
    claims
        Claims in the order of the source.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    claims: ClassVar[tuple[Claim, ...]]
