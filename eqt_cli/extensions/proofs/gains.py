"""Gains whose proof is best: the fastest certified rate, or the least proved effect of a push.

With kp·T² and kd·T, a loop at V_d is T times as fast as before at V_d/T. So the proved rate grows
at least like T along such a ray, and the angle to which a push turns the loop falls at least like
1/T². The best gains of a ray are where it meets a bound; only the direction is left to search.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import product
from typing import Any, NamedTuple, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

import eqt_cli.extensions.proofs.certified as proofs
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.extensions.proofs.margins import CutLoop, delay_margin, known_reference
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.linearised import off_limits
from eqt_cli.results.origin import law_title

ROOM = 1e-3  # Share of each bound that the search leaves free, so that rounded gains keep it.
TRIED = 20  # Directions that DIRECT tries per dimension, and then at most Nelder and Mead's method.

REACHES = 0.25 * 0.5 ** np.arange(8)
"""How far the turns of a step are tried about the largest one, as shares of its angle."""

# What `subject_to` can bound, from which side, and its unit.
AT_MOST = {"step_torque": " N m", "bandwidth": " rad/s"}
BOUNDS = AT_MOST | {"delay_margin": " s", "damping": ""}


def step_torque(loop: ClosedLoop, box: proofs.Box, angle: float) -> float:
    """Return the largest ‖τ‖ of a law at rest when its reference steps, N m.

    The reference turns by up to an angle, rad, and moves with V_d at a corner of a box, V̇_d = 0.
    The turns are first about the axes and the diagonals between them, by quarters of the angle, and
    by 90°, where a navigation function is steepest. From the largest of each corner, a pattern
    search goes on: the torque of a moving reference is largest about other axes.
    """
    G, m = loop.group, loop.group.dimension
    axes = np.array([axis for axis in product((-1.0, 0.0, 1.0), repeat=m) if any(axis)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turns = np.unique(np.minimum([*angle * np.linspace(0.25, 1, 4), np.pi / 2], angle))
    corners = np.array([*product(*map(set, box))], dtype=float)

    def sizes(steps: Array) -> Array:
        Q, Vd = G.exp(steps), corners + 0 * steps
        lengths = loop.controller.memory(G).items()
        memory = {name: np.zeros((*Q.shape[:-2], n)) for name, n in lengths}
        s = proofs.tracking(loop, Q, 0 * Vd, G.identity + 0 * Q, Vd, 0 * Vd, memory)
        return np.asarray(np.linalg.norm(loop.command(s), axis=-1))

    steps = (turns[:, None, None] * axes).reshape(-1, 1, m) + 0 * corners
    for reach in angle * REACHES:
        at = steps[sizes(steps).argmax(axis=0), np.arange(len(corners))]
        steps = at + reach * np.vstack([0 * axes[:1], axes])[:, None]
        steps *= np.minimum(1.0, angle / np.maximum(np.linalg.norm(steps, axis=-1), 1e-9))[
            ..., None
        ]
    return float(sizes(steps).max())


def at_rest(loop: ClosedLoop) -> dict[str, float]:
    """Return bandwidth, delay margin and damping of a loop at V_d = 0.

    They are the size of the fastest pole; 0 for an unstable loop; and the least −cos of the angle
    of a pole.
    """
    A, m = proofs.affine(loop)[0].astype(float), loop.group.dimension
    inertia = loop.inertia.at(0.0).matrix
    poles, cut, B = np.linalg.eigvals(A), A.copy(), np.zeros((len(A), m))
    cut[m : 2 * m], B[m : 2 * m] = 0.0, np.linalg.inv(inertia)  # the torque is 𝕀V̇
    cut_loop = CutLoop(cut, B, inertia @ A[m : 2 * m], None)
    delay = delay_margin(cut_loop) if poles.real.max() < 0 else 0.0
    damping = float((-poles.real / np.abs(poles)).min())
    return {"bandwidth": float(np.abs(poles).max()), "delay_margin": delay, "damping": damping}


class TuneKeys(Protocol):
    """What proofs read of a section `tune`: the bounds, and `velocity`, `push` and `step`."""

    subject_to: Mapping[str, Any]
    proof: Any


@dataclass(frozen=True)
class _Search:
    """The search for the best gains of a law, which has a label, axes, and documents `at` values.

    Attributes
    ----------
    push
        Size of a push whose effect is to be least, N m; 0 if the rate is to be largest.
    """

    law: Any
    section: TuneKeys
    box: proofs.Box
    push: float

    def loop(self, values: dict[str, float]) -> ClosedLoop:
        """Return the loop with some values."""
        [loop] = build(self.law.at(values)).loops.values()
        return loop

    def bounded(self, values: dict[str, float]) -> dict[str, float]:
        """Return what `subject_to` bounds, by name."""
        loop, names = self.loop(values), self.section.subject_to
        numbers = at_rest(loop) if {*names} - {"step_torque"} else {}
        if "step_torque" in names:
            numbers["step_torque"] = step_torque(loop, self.box, self.section.proof.step)
        return {name: numbers[name] for name in names}

    def room(self, values: dict[str, float]) -> float:
        """Return the least room below or above the bounds, as a share of one."""
        bounds: Mapping[str, Any] = self.section.subject_to
        over = {name: x / bounds[name] - 1 for name, x in self.bounded(values).items()}
        return min((-x if name in AT_MOST else x for name, x in over.items()), default=np.inf)

    def proved(self, values: dict[str, float]) -> tuple[proofs.Certified, float | None]:
        """Return a proof and its number, rounded so that it stays true; None without a proof.

        It is a rate, 1/s, or the angle to which a push turns the loop, deg.

        Raises
        ------
        InputError
            If no proof can be tried; the message goes on from the name of the law.
        """
        _, rates, why = proofs.rates_of(self.law.label, self.loop(values), [self.box], self.push)
        if why := why or (rates[0].gain.refused if rates[0].gain else ""):
            raise InputError(why)
        [one] = rates
        number = None if one.rate is None else float(one.rate)
        if self.push:
            number = one.gain.peak if one.gain else None
        return one, float(proofs.rounded(number, 4, up=self.push > 0)) if number else None

    def powers(self) -> dict[str, int]:
        """Return the powers of T of the varied keys, 0 for one that is no gain."""
        return {key: 2 * (".kp" in key) + (".kd" in key) for key in self.law.axes}

    def scales(self) -> bool:
        """Whether A of kp·4, kd·2 and 2 V_d is 2 S⁻¹AS, S = diag(2, 1), in exact numbers."""
        powers, m = self.powers(), len(self.box)
        others = {key: axis.at(0.5) for key, axis in self.law.axes.items() if not powers[key]}
        gains = [{key: T**p for key, p in powers.items() if p} | others for T in (1.0, 2.0)]
        A, faster = (proofs.affine(self.loop(values)) for values in gains)
        S = np.array([Fraction(2)] * m + [Fraction(1)] * (len(A[0]) - m))
        moved = A * S / S[:, None] * np.array([2] + m * [1])[:, None, None]
        return len(S) == 2 * m and bool((moved == faster).all())

    def on_ray(self, shares: Array) -> tuple[dict[str, float], float]:
        """Return gains that keep the bounds with room, and 0; or others, and their violation.

        The share of the first gain is how far they are along their ray, up to the first bound;
        those of the other gains decide the ray, by their ratios to the first.
        """
        from scipy.optimize import brentq  # slow to import

        axes, share_of = self.law.axes, dict(zip(self.law.axes, shares.tolist(), strict=True))
        powers = {key: p for key, p in self.powers().items() if p}
        ends = [(max(axes[key].low, 1e-4 * axes[key].high), axes[key].high) for key in powers]
        p, share = np.array([*powers.values()]), np.array([share_of[key] for key in powers])
        low, high = np.log(np.reshape(ends, (-1, 2))).T / p
        ratio = low - high[:1] + share * (high - low + high[:1] - low[:1])
        ratio[:1] = 0.0

        def at(s: float) -> dict[str, float]:
            gains = zip(powers, np.exp(p * np.clip(s + ratio, low, high)).tolist(), strict=True)
            return {key: axis.at(share_of[key]) for key, axis in axes.items()} | dict(gains)

        def room(s: float) -> float:
            return self.room(at(s)) - ROOM

        start, end = max(low - ratio, default=0.0), min(high - ratio, default=0.0)
        if room(start) < 0:
            return at(start), -room(start)
        if room(end) < 0:
            end = brentq(room, start, end, xtol=ROOM / 10)
        return at(start + (end - start) * sum(share[:1])), 0.0

    def best(self) -> tuple[dict[str, float], float]:
        """Return the best gains, and their violation of the bounds or less than 0 with a proof."""
        from scipy.optimize import direct, minimize  # slow to import

        axes, powers = self.law.axes, [*self.powers().values()]
        fixed = [powers.index(max(powers))] if len(axes) > 1 and self.scales() else []
        free = len(axes) - len(fixed)

        def cost(shares: Array) -> float:
            values, violation = self.on_ray(np.insert(shares, fixed, 1.0))
            number = None if violation else self.proved(values)[1]
            return violation if number is None else -1 / number if self.push else -number

        cube, options = [(0.0, 1.0)] * free, {"maxfev": TRIED * free, "xatol": 1e-3, "fatol": 9e9}
        near = direct(cost, cube, maxfun=TRIED * free).x
        last = minimize(cost, near, method="Nelder-Mead", bounds=cube, options=options)
        values = self.on_ray(np.insert(last.x, fixed, 1.0))[0]
        few = {key: float(f"{x:.4g}") for key, x in values.items()}
        return {key: min(max(x, axes[key].low), axes[key].high) for key, x in few.items()}, last.fun


class ProvedObjective(NamedTuple):
    """What `eqt tune` makes best by proofs, without runs.

    Attributes
    ----------
    name
        The objective in a configuration.
    column
        What is proved, with its unit.
    """

    name: str
    column: str

    def check(self, section: TuneKeys, base: Experiment, problems: Problems) -> None:
        """Note what in a section `tune` does not go with a proof."""
        for name, bound in section.subject_to.items():
            at = problems.at("subject_to", name)
            if name not in BOUNDS or not isinstance(bound, int | float) or bound <= 0:
                at.add(f"{self.name} has no runs; expected a number above 0 of {', '.join(BOUNDS)}")
            elif name == "step_torque" and not _turns(base):
                at.add(f"needs a group of rotations alone, got {base.group.name}; leave it out")
        if self.name == "push_bound" and not section.proof.push:
            problems.at("proof", "push").add("push_bound needs the size of a push, such as 0.1 N m")
        with problems.catching("proof", "velocity"):
            _box(section, base)
        proofs.check_push_and_start(section.proof.push, 0.0)
        whys = {label: proofs.departures(off_limits(x)) for label, x in base.loops.items()}
        if all(whys.values()):
            first, why = next(iter(whys.items()))
            problems.at("objective").add(
                f"no law has a proof: '{first}' {why}; take a copy without control, sensors, "
                "estimator, actuators and plant"
            )

    def gains(self, law: Any, section: TuneKeys, base: Experiment) -> dict[str, Any]:
        """Return the record of the best gains of a law within the ranges and bounds.

        Its `values` are empty where nothing is proved; then it has `why`.
        """
        push = section.proof.push * (self.name == "push_bound")
        search = _Search(law, section, _box(section, base), push)
        try:
            _, at_start = search.proved({})
            with threadpool_limits(1):  # threads slow down small matrices
                values, cost = search.best()
            if cost > 0:
                raise InputError(f"no gains keep the bounds; the least miss is {100 * cost:.2g} %")
            one, number = search.proved(values)
            if number is None or search.room(values) < 0:
                raise InputError("no proof was found with any gains of these ranges and bounds")
        except InputError as error:
            return {"values": {}, "why": str(error)}
        pairs = ", ".join(f"{key.rpartition('.')[2]} = {x:g}" for key, x in values.items())
        who = f"{law_title(law.label)} with {pairs}"
        over = float(proofs.rounded(one.overshoot, 3, up=True))
        said = f"small errors of {who} decay at least like {over:g} e^(−{number:g} t)"
        if push:
            said = f"a push of at most {push:g} N m turns {who} by at most {number:g}°"
        said += "".join(f"; {k} {x:.4g}{BOUNDS[k]}" for k, x in search.bounded(values).items())
        proof, proved = asdict(one) | {"rate": str(one.rate)}, f"{at_start or 'none'} → {number}"
        best = {"values": values, "objectives": [number], "proof": proof, "proved": proved}
        return best | {"sentence": f"For every reference with {_named(one, base)}, {said}."}

    def record(self, laws: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
        """Return the objective, and sentences: the order of the laws, what is proved, what not."""
        numbers = {label: law["objectives"][0] for label, law in laws.items() if law["values"]}
        order = sorted(numbers, key=numbers.__getitem__, reverse=self.name == "certified_rate")
        first = f"Best {self.column}: {', '.join(f'{law_title(k)} {numbers[k]:g}' for k in order)}."
        without = [f"{law_title(k)}: {x['why']}." for k, x in laws.items() if not x["values"]]
        said = [first, *(laws[label]["sentence"] for label in order), *without, NOT_SAID]
        return {"objective": self.name, "column": self.column, "answer": said if order else without}


NOT_SAID = "To first order; no limits, delays or noise. For large errors: eqt margins --from."


def _box(section: TuneKeys, base: Experiment) -> proofs.Box:
    """Return the box of velocities for which the section wants a proof."""
    v, m = section.proof.velocity, base.group.dimension
    if v is None:
        return proofs.box_of(known_reference(base).velocity)
    if np.size(v) not in (1, m):
        raise InputError(f"expected a number or {m} of them, got {np.size(v)}")
    if (least := float(np.min(v))) < 0:
        raise InputError(f"expected 0 or more, as it is the size of V_d, got {least:g}")
    return [(-Fraction(str(x)), Fraction(str(x))) for x in np.broadcast_to(v, m)]


def _turns(base: Experiment) -> bool:
    """Return whether the group has one rotation and nothing else, so that torques have one unit."""
    return [part.turns for part in base.group.parts] == [True]


def _named(one: proofs.Certified, base: Experiment) -> str:
    """Name the references of a proof."""
    V, unit = ("ω_d", " rad/s") if _turns(base) else ("V_d", "")
    if all(low == -high for low, high in one.velocity):
        sizes = [_inside(high) for _, high in one.velocity]
        return f"|{V},i| ≤ {', '.join(sizes[:1] if len({*sizes}) == 1 else sizes)}{unit}"
    sides = ", ".join(f"{_inside(low)} to {_inside(high)}" for low, high in one.velocity)
    return f"{V} within {sides}{unit}".replace("-", "−")


def _inside(x: float) -> str:
    """Return a side of a box in six digits, rounded so that nothing outside is claimed."""
    near = f"{x:.6g}"
    outside = abs(float(near)) > abs(x)
    return f"{np.copysign(float(proofs.rounded(abs(x), 6)), x):g}" if outside else near


@purposes.proved_objective
def certified_rate() -> ProvedObjective:
    """Return the search for the fastest proved decay of errors."""
    return ProvedObjective("certified_rate", "proved rate, 1/s")


@purposes.proved_objective
def push_bound() -> ProvedObjective:
    """Return the search for the smallest proved angle under a push."""
    return ProvedObjective("push_bound", "proved angle, deg")
