"""The signals of a result: everything that follows from states at sample times, with its meaning.

Each signal is computed from the same laws that were integrated; none has a formula of its own
beyond a norm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Signal:
    """A quantity over time of one run.

    Attributes
    ----------
    name
        Its name in a result file.
    dims
        Dimensions beyond run and time: ``("row", "col")``, ``("axis",)`` or none.
    units, long_name
        For figures and result files.
    """

    name: str
    dims: tuple[str, ...]
    units: str
    long_name: str


@dataclass(frozen=True)
class _Norm:
    """One of the three error norms, for the whole and for each part of the coordinates."""

    name: str
    long_name: str
    unit: Callable[[Part], str]
    of: Callable[[Tracking, Array], Array]
    of_part: Callable[[Tracking, Array, Part], Array]


_NORMS = (
    _Norm(
        "pose_error",
        "pose error ||I - Q Qd^-1||_F",
        lambda part: part.pose_unit,
        lambda s, tau: frobenius(s.G.identity - s.Q_E),
        lambda s, tau, part: frobenius((s.G.identity - s.Q_E)[(..., *part.entries)]),
    ),
    _Norm(
        "velocity_error",
        "velocity error ||V - Vd||",
        lambda part: part.velocity_unit,
        lambda s, tau: norm(s.V_tilde),
        lambda s, tau, part: norm(s.V_tilde[..., part.axes]),
    ),
    _Norm(
        "torque_norm",
        "torque norm ||tau||",
        lambda part: part.force_unit,
        lambda s, tau: norm(tau),
        lambda s, tau, part: norm(tau[..., part.axes]),
    ),
)


def signals(group: MatrixLieGroup) -> list[Signal]:
    """Every signal of a closed loop on this group, in the order of `compute`."""
    velocity = _common([part.velocity_unit for part in group.parts])
    force = _common([part.force_unit for part in group.parts])
    found = [
        Signal("pose", ("row", "col"), _common([part.pose_unit for part in group.parts]), "pose Q"),
        Signal("velocity", ("axis",), velocity, "body velocity V"),
        Signal("torque", ("axis",), force, "control torque tau, body frame"),
    ]
    for entry in _NORMS:
        units = [entry.unit(part) for part in group.parts]
        found.append(Signal(entry.name, (), _common(units), entry.long_name))
        for part in _split(group):
            long_name = f"{entry.long_name}, {part.name} part"
            found.append(Signal(f"{entry.name}_{part.name}", (), entry.unit(part), long_name))
    found.append(Signal("lyapunov", (), "J", "Lyapunov function L"))
    return found


def compute(loop: ClosedLoop, times: Array, states: Array) -> dict[str, Array]:
    """All signals at the sample times, and the energy balance L + W.

    Parameters
    ----------
    loop
        With parameters that broadcast over ``(runs, samples)``.
    times : (samples,)
    states : (runs, samples, n)

    Returns
    -------
    dict
        One array ``(runs, samples, …)`` per signal, and ``energy_balance``, L(t) + W(t), which is
        NaN where the dissipation is not known.
    """
    found = dict(_compute(loop, loop.tracking(times, states), loop.work(states)))
    if loop.dissipation(loop.tracking(times[:1], states[:, :1])) is None:
        found["energy_balance"] = np.full_like(found["energy_balance"], np.nan)
    return found


def _compute(loop: ClosedLoop, s: Tracking, work: Array) -> Iterator[tuple[str, Array]]:
    tau = loop.torque(s)
    yield "pose", s.Q
    yield "velocity", s.V
    yield "torque", tau
    for entry in _NORMS:
        yield entry.name, entry.of(s, tau)
        for part in _split(loop.group):
            yield f"{entry.name}_{part.name}", entry.of_part(s, tau, part)
    L = loop.lyapunov(s)
    yield "lyapunov", L
    yield "energy_balance", L + work


def _split(group: MatrixLieGroup) -> tuple[Part, ...]:
    """The parts worth a norm of their own: none where there is only one."""
    return group.parts if len(group.parts) > 1 else ()


def _common(units: list[str]) -> str:
    return units[0] if len(set(units)) == 1 else "mixed"
