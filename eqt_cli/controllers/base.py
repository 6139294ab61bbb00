"""What a control law is; it knows no engine and no particular group."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Controller(ABC):
    """A control law: a frozen dataclass whose fields are its options in a configuration.

    Every attribute that is a float is a runtime parameter: an engine may replace it by an array
    ``(runs, 1)`` or by a symbol, so a law uses it with operators only.

    Attributes
    ----------
    name
        As written in a configuration: ``eqt``.
    title
        As written in figures: ``EqT``.
    tasks
        The tasks of a configuration that it is for.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    tasks: ClassVar[tuple[str, ...]] = ("track",)
    # Read by pydantic when a configuration gives options: no other keys, no silent conversions.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    @abstractmethod
    def torque(self, s: Tracking) -> Array:
        """τ, body frame, ``(..., m)``."""

    def dissipation(self, s: Tracking) -> Array | None:
        """The power −dL/dt that the law takes out of L, ``(...)``; None where it is not known.

        It is integrated along with every run, so that L(t) + ∫dissipation = L(0) can be checked.
        """
        return None
