"""Remarks on values that nobody can mean: of another unit, behind the end, or without an effect.

A bound here is a hundred times beyond what such a vehicle has, and a slip of the unit a thousand.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import KeyPath
from eqt_cli.base.registry import is_foreign
from eqt_cli.components.laws import RunsCode
from eqt_cli.components.vehicle import ACTUATORS
from eqt_cli.components.vehicle_parts import highest, lowest
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon
from eqt_cli.loop.signals import output_names
from eqt_cli.runs.folder import MOST_OUTPUTS

if TYPE_CHECKING:
    from eqt_cli.extensions.proofs.authority import Members

Placed = Iterator[tuple[KeyPath, str]]

MOST_WEIGHTS, G0 = 50.0, 9.80665
"""Thrust to weight beyond every vehicle's, of which racing quadrotors have 15; m/s²."""

FASTEST = {"torque": 1e6, "force": MOST_WEIGHTS * G0}
"""Accelerations by all thrusters at their limits, rad/s² and m/s². A Crazyflie of 30 g has 1,000
rad/s² and 25 m/s², a rocket 100 m/s²."""

BY_WHEELS = {"momentum": 30.0, "limit": 50.0}
"""Rate of the body with all of one wheel's momentum, rad/s, and acceleration by one, rad/s². A
CubeSat has 1 rad/s and 0.1 rad/s², a cube that balances on its corner 10 and 20."""


MOST_SHARE = 5.0
"""Share of its commanded thrust that no rotor gives."""

UNLIKE_BODIES = 100.0
"""How many times the inertia of the model, or what part of it, is that of another body."""


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Horizon | None) -> Placed:
    """Yield all of them, and those on what limits leave, with their keys."""
    yield from _behind_the_end(experiment)
    yield from _in_per_cent(experiment)
    yield from _without_effect(experiment)
    yield from _unread_momentum(experiment)
    yield from _of_another_inertia(experiment)
    if not experiment.vehicle.actuators:
        return
    from eqt_cli.extensions.proofs.authority import members_of
    from eqt_cli.extensions.proofs.authority import remarks as on_authority

    yield from (slips := [*_of_another_unit(experiment, members_of(experiment))])
    wrong = {key[1] for key, _ in slips}  # with such numbers, what is left means nothing
    yield from (remark for remark in on_authority(experiment, shown) if remark[0][1] not in wrong)


def _in_per_cent(experiment: Experiment) -> Placed:
    """Yield shares of thrust that can only be meant as per cent."""
    for index, part in enumerate(experiment.config.actuators or ()):
        shares = getattr(part, "efficiency", None)
        most = max(map(highest, shares if isinstance(shares, list) else [shares or 0.0]))
        if most > MOST_SHARE:
            meant = f"if per cent were meant, write {most / 100:g}"
            said = f"is {most:g}, a share of the commanded thrust; {meant}"
            yield (ACTUATORS, index, "efficiency"), said


def _behind_the_end(experiment: Experiment) -> Placed:
    """Yield what comes after the end of the runs."""
    config, end = experiment.config, experiment.config.time.duration
    for index, part in enumerate(config.actuators or ()):
        key: KeyPath = (ACTUATORS, index)
        begins: dict[KeyPath, Any] = {("efficiency_from",): getattr(part, "efficiency_from", None)}
        if (fails := getattr(part, "fails", None)) is not None:
            begins = {("fails", "at"): fails.at}
        for name, start in begins.items():
            if start is not None and lowest(start) >= end:
                never = "the thruster never fails" if fails else "no thruster ever loses thrust"
                said = f"is {lowest(start):g} s, and runs end at {end:g} s: {never}"
                yield (*key, *name), said
        lag = getattr(part, "time_constant", None)
        if isinstance(lag, int | float) and lag > end:
            yield (
                (*key, "time_constant"),
                f"is {lag:g} s, longer than the runs, {end:g} s; {_in_ms(lag)}",
            )
    for index, force in enumerate((config.plant and config.plant.forces) or ()):
        if (since := getattr(force, "since", None)) is not None and lowest(since) >= end:
            yield (
                ("plant", "forces", index, "since"),
                f"is {lowest(since):g} s, and runs end at {end:g} s: {force.name} never acts",
            )
    for law in experiment.laws.values():
        ahead: Any = getattr(law.law, "preview", ())
        if len(ahead) and ahead[-1] > end:
            every = ahead[0]
            yield (
                ("controllers", law.index, "preview", "every"),
                f"is {every:g} s, so that the preview reaches {ahead[-1]:g} s ahead, and runs last "
                f"{end:g} s; {_in_ms(every)}",
            )


def _in_ms(value: float) -> str:
    return f"if milliseconds were meant, write '{value:g} ms'"


def _of_another_inertia(experiment: Experiment) -> Placed:
    """Yield a true inertia that is no inertia of the body of the model."""
    model, true = experiment.loop.inertia.at(0.0), experiment.loop.vehicle.inertia
    if true is None:
        return
    ours, plant = (np.diagonal(x.matrix[..., :, :]) for x in (model, true.at(model, 0.0)))
    ratio = np.ravel(plant / ours)
    worst = float(ratio[np.abs(np.log(ratio)).argmax()])
    if not 1 / UNLIKE_BODIES < worst < UNLIKE_BODIES:
        yield (
            ("plant", "inertia"),
            f"has a mean that is {worst:,.4g} times the inertia of the model, so that no gain of "
            "one suits the other; check its unit, or write `relative: {uniform: [-0.2, 0.2]}` for "
            "a factor of 1 ± 0.2",
        )


def _of_another_unit(experiment: Experiment, members: Iterable[Members]) -> Placed:
    """Yield numbers with which thrusters or wheels would do what no vehicle does."""
    inverse, written_parts = experiment.loop.inertia.at(0.0).inverse, experiment.config.actuators
    for index, part in enumerate(experiment.vehicle.actuators):
        if part.name == "wheels":
            yield from _of_wheels((ACTUATORS, index), part, inverse)
    for member in members:
        key: KeyPath = (ACTUATORS, member.index)
        written: Any = (written_parts or ())[member.index]
        yield from (far := [*_of_levers(key, written, experiment)])
        if far or member.part.name == "wheels":  # a place explains what else is too large
            continue
        low, high = member.limits(failed=False)
        pushes = np.asarray(member.part.matrix) * np.maximum(np.abs(low), np.abs(high))
        parts = member.wanted @ inverse @ pushes
        rates = np.maximum(*(np.maximum(sign * parts, 0.0).sum(axis=-1) for sign in (1, -1)))
        moments = [*_of_moments(key, written, member.part, experiment.group)]
        for name, rate in zip(member.names, rates, strict=True):
            if moments and "torque" in name:
                continue  # the moments explain it
            most = FASTEST[name.partition(" ")[0]]
            if rate > most:
                unit = "rad/s²" if "torque" in name else "m/s²"
                option = "thrust_constant" if written.thrust_constant is not None else "high"
                by_weight = "" if "torque" in name else f", {rate / G0:,.0f} times its weight"
                speed = ""
                if getattr(written, "high_speed", None) is not None:
                    most = highest(written.high_speed)
                    speed = f", and the unit of high_speed: if rpm were meant, write '{most:g} rpm'"
                yield (
                    (*key, option),
                    f"lets thrusts of {np.max(high):.3g} N accelerate the body by {rate:.2g} "
                    f"{unit}{by_weight}; check its unit and its exponent{speed}",
                )
                break
        yield from moments
        turned = [one for one in written.thrusters or () if abs(one.turns) == 1.0]
        if turned and written.moment_constant is None:
            yield (
                (*key, "thrusters"),
                "`turns: 1` is a torque of 1 N m for each N of thrust, where propellers have some "
                "0.02 m; write the ratio, `turns: 0.02` or −0.02, or thrust_constant and "
                "moment_constant, of which 1 and −1 are the signs",
            )


def _of_levers(key: KeyPath, written: Any, experiment: Experiment) -> Placed:
    """Yield thrusters that are too far from the origin for a body of this inertia.

    No mass of a body lies within √(J/m) only, and thrusters of vehicles are at 1 to 3 times of it.
    """
    J, G = np.diagonal(experiment.loop.inertia.at(0.0).matrix), experiment.group
    turns = [part.axes for part in G.parts if part.turns]
    moves = [part.axes for part in G.parts if not part.turns]
    if len(turns) != 1 or len(moves) != 1:
        return
    radius = float(np.sqrt(np.max(J[..., turns[0]]) / np.max(J[..., moves[0]])))
    for k, thruster in enumerate(getattr(written, "thrusters", None) or ()):
        place = np.array(list(map(highest, thruster.at or ())), dtype=float)
        if len(place) and norm(place) > UNLIKE_BODIES * radius:
            most = f"{np.abs(place).max():g}"
            yield (
                (*key, "thrusters", k, "at"),
                f"is {norm(place):.4g} m from the origin, where the body has a radius of gyration "
                f"of {radius:.2g} m; if millimetres were meant, write '{most} mm'",
            )
            return  # others are told when this one is mended


def _of_moments(key: KeyPath, written: Any, part: Any, G: Any) -> Placed:
    """Yield a torque about the thrust of a rotor that is larger than by its lever.

    A column (τ, f) of B has the ratio τ·f/|f|² about the thrust, and the lever |τ − (τ·f) f/|f|²|
    over |f|, both in m. Propellers have a ratio of 0.02 m, a tenth of their diameter or less.
    """
    if G.translation is None or written.moment_constant is None or not written.thrusters:
        return
    torques, forces = (np.asarray(part.matrix)[axes].T for axes in (slice(0, 3), slice(3, 6)))
    sizes = norm(forces)
    along = forces / sizes[:, None]
    about = (torques * along).sum(axis=-1)
    ratio = float(np.max(np.abs(about) / sizes))
    lever = float(np.max(norm(torques - about[:, None] * along) / sizes))
    if ratio > lever > 0:
        meant = highest(written.moment_constant)
        hint = f"; if that were metres, write {meant:g} times thrust_constant"
        yield (
            (*key, "moment_constant"),
            f"makes a torque of {ratio:.3g} N m about its axis for each N of thrust, by the "
            f"farthest lever it is {lever:.3g} N m; propellers have some 0.02 m"
            f"{hint if meant < lever else '; check its unit and its exponent'}",
        )


def _of_wheels(key: KeyPath, part: Any, inverse: Array) -> Placed:
    """Yield momenta and torques that are too large for the body."""
    for name, unit in (("momentum", "N m s"), ("limit", "N m")):
        size: Any = getattr(part, name)
        if size is None:
            continue
        rate = float(norm((inverse @ (part.matrix * size)).T).max())
        if rate > BY_WHEELS[name]:
            effect = f"accelerate the body by {rate:,.0f} rad/s²"
            if name == "momentum":
                effect = f"spin the body at {rate:,.0f} rad/s"
            yield (
                (*key, name),
                f"of {np.max(size):g} {unit} would {effect}; if thousandths were meant, write "
                f"'{np.max(size):g} m{unit}'",
            )


def _unread_momentum(experiment: Experiment) -> Placed:
    """Yield the anti-windup of laws beside wheels whose momentum it does not read."""
    wheels = [x for x in experiment.vehicle.actuators if x.name == "wheels" and x.sampled]
    if wheels:
        for law in experiment.laws.values():
            if getattr(law.law, "anti_windup", "none") != "none":
                yield (
                    ("controllers", law.index, "anti_windup"),
                    "reads the torque limit of the wheels only: at their momentum limit, the "
                    "integral grows on; dump the momentum by magnetorquers, or choose larger "
                    "wheels",
                )


def _without_effect(experiment: Experiment) -> Placed:
    """Yield what changes nothing, and numbers of laws that are not stored."""
    config = experiment.config
    model, acting = config.known_forces, experiment.loop.vehicle.forces
    if model == "plant" and not acting:
        yield ("model", "forces"), "names the forces of the plant, which has none"
    if not model or (model == "plant" and not acting):
        for law in experiment.laws.values():
            if not law.known_forces:
                yield (
                    ("controllers", law.index, "known_forces"),
                    "changes nothing, as there are no forces in `model`",
                )
    if config.store.memory == "auto" and config.store.trajectories != "none":
        numbers, is_own = dict[str, str](), False
        for loop in experiment.loops.values():
            one = loop.controller
            numbers |= output_names(one, experiment.group)
            is_own |= is_foreign(type(one).__module__) or isinstance(one, RunsCode)
        if is_own and len(numbers) > MOST_OUTPUTS:
            yield (
                ("store", "memory"),
                f"laws have {len(numbers)} numbers to store, and results hold at most "
                f"{MOST_OUTPUTS} unasked; add `store: {{memory: true}}` to keep them",
            )
