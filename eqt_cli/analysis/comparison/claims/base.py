"""What a claim is; it knows no single paper and no way to test one."""

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
        Name of a measure; where it has parts with units of their own, each part is a row.
    window
        Over which it is taken.
    rotation_only
        It is about orientation: rows of other parts of the pose do not belong to it.
    """

    lesser: str
    greater: str
    measure: str
    window: Window = WHOLE
    rotation_only: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """The controllers that it is about."""
        return (self.lesser, self.greater)


@dataclass(frozen=True)
class AtMost:
    """In every run, something stays at or below a bound.

    Attributes
    ----------
    kind
        Of the controller.
    measure
        Name of a measure.
    bound
        For the measure, in its unit.
    statement
        The row in words.
    """

    kind: str
    measure: str
    bound: float
    statement: str

    @property
    def kinds(self) -> tuple[str, ...]:
        """The controller that it is about."""
        return (self.kind,)


@dataclass(frozen=True)
class Claim:
    """A sentence, and the rows by which it is measured.

    Attributes
    ----------
    says
        In the words of its source.
    rows
        Each is tested by itself; the claim holds as far as its rows do.
    """

    says: str
    rows: tuple[Less | AtMost, ...]


class ClaimSet(ABC):
    """The claims of one source.

    Attributes
    ----------
    name
        Short, for tables and messages.
    source
        Where they are made.
    claims
        In the order of the source.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    claims: ClassVar[tuple[Claim, ...]]
