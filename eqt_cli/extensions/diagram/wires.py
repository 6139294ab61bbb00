"""Which block of a loop reads which port: the walk of blocks that engines evaluate, observed once.

The blocks are those of `ClosedLoop.blocks`, and a wire is a port that a block asked for while the
loop was evaluated at its start, so that no second list of either exists.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.components.blocks import COMMAND, Block, Blocks, Now
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.sensors import Errors
from eqt_cli.components.vehicle import command_length
from eqt_cli.loop.closed_loop import ClosedLoop

LAW, PLANT = "law", "plant"
"""What reads ports beside the blocks: the law, and the motion."""


class Wire(NamedTuple):
    """A port that something reads.

    Attributes
    ----------
    port
        ``commands.arrived``.
    reader
        The name of a block, or `LAW` or `PLANT`.
    """

    port: str
    reader: str

    @property
    def block(self) -> str:
        """The name of the block whose port it is."""
        return self.port.partition(".")[0]


class _Observed(Now):
    """The values of all ports, which remembers who asked for them."""

    def __init__(self, wires: dict[Wire, None], reader: str, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._wires, self._readers = wires, [reader]

    @contextmanager
    def _reading(self, name: str) -> Iterator[None]:
        self._readers.append(name)
        yield
        self._readers.pop()

    def __getitem__(self, port: str) -> Any:
        wire = Wire(port, self._readers[-1])
        if wire.block != wire.reader:
            self._wires[wire] = None
        with self._reading(wire.block):
            value = super().__getitem__(port)
        if value is None:  # nothing is on the wire
            self._wires.pop(wire, None)
        return value

    def after(self, name: str) -> Arrays:
        """Return the states of a block after a tick, for which it may read ports."""
        with self._reading(name):
            return super().after(name)

    def rates(self) -> dict[str, Array]:
        """Return the rates of the states of all blocks."""
        rates: dict[str, Array] = {}
        for block in self.blocks.moving:
            with self._reading(block.name):
                rates |= block.rates(self, self.after(block.name))
        return rates


class _Watched(ClosedLoop):
    """A closed loop whose ports are observed; its law commands 0."""

    def watch(self) -> tuple[Blocks, list[Wire]]:
        """Return the blocks, and the wires of one evaluation at the start and at a tick."""
        self.__dict__ |= {"wires": {}, "reader": PLANT}
        G, still = self.group, np.zeros((1, self.group.dimension))
        one = np.broadcast_to(G.identity, (1, *G.identity.shape))
        state = self.initial_state(one, still, one, still)
        errors = None
        if self.vehicle.control is not None and self.vehicle.measures:
            lengths = self.vehicle.error_lengths(G)
            errors = Errors(*(np.zeros((1, n)) for n in lengths)).measured(G, ...)
        with np.errstate(all="ignore"):
            self.acting_and_rates(self.tracking(0.0, state))
            self.__dict__["reader"] = LAW
            if self.vehicle.control is not None:
                measured = self.measured(0.0, state, errors)
                self._observed(LAW, self.tracking(0.0, measured), errors, True).stepped()
                self.law_input(0.0, measured, errors)
        return self.blocks, list(self.__dict__["wires"])

    def now(self, s: Tracking, errors: Errors | None = None, acts: bool = False) -> Now:
        """Return the ports; between ticks the motion asks, and at one the law."""
        return self._observed(self.__dict__["reader"], s, errors, acts)

    def _observed(self, reader: str, s: Tracking, errors: Errors | None, acts: bool) -> Now:
        ports = {COMMAND: np.zeros((1, command_length(self.vehicle, self.group)))}
        wires = self.__dict__["wires"]
        return _Observed(wires, reader, self.blocks, s, ports, acts, errors)


def observed(loop: ClosedLoop) -> tuple[dict[str, Block], list[Wire]]:
    """Return the blocks of a loop by name, in the order of the walk, and its wires."""
    blocks, wires = _Watched.of(replace(loop, vehicle=loop.vehicle.of_run(loop.group))).watch()
    return blocks.named, wires
