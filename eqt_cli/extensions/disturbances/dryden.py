"""Drag in a turbulent wind with the spectra of Dryden."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, cos, sin, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Unit
from eqt_cli.components.forces import Drag, column
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.vehicle_parts import check_numbers
from eqt_cli.numbers.leaves import with_fields

SINES = 48
"""Number of sines per axis of the wind; each carries the same part of the variance."""


def share_below(x: Array, across: bool) -> Array:
    """Return the part of the variance at frequencies below x = ω L/V, of MIL-F-8785C's spectra.

    They are Φ_u = (2σ²L/πV)/(1 + x²) along the wind, and Φ_v = (σ²L/πV)(1 + 3x²)/(1 + x²)² across.
    """
    if across:
        return (2 * np.arctan(x) - x / (1 + x * x)) / np.pi
    return 2 / np.pi * np.arctan(x)


def frequencies(across: bool) -> Array:
    """Return ω L/V in the middle of each of `SINES` parts of equal variance."""
    shares = (np.arange(SINES) + 0.5) / SINES
    low, high = np.zeros(SINES), np.full(SINES, 1e3)
    for _ in range(100):  # halves the interval
        middle = (low + high) / 2
        is_below = share_below(middle, across) < shares
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    return (low + high) / 2


@dataclass(frozen=True)
class Dryden(Drag):
    """The drag of `drag` in a wind c + (u, v, w), turbulent as MIL-F-8785C's form of Dryden.

    The turbulence is frozen: it passes the vehicle at the speed V of the mean wind c. u is along c,
    and w across it, as near to the last axis of space as may be. Their spectra, for ω ≥ 0, are

        Φ_u = (2σ_u²L_u/πV)/(1 + x²),  Φ_v = (σ_v²L_v/πV)(1 + 3x²)/(1 + x²)²,  x = ω L/V,

    Φ_w like Φ_v. Each is a sum of 48 sines that divide its variance into equal parts, so that its
    correlation misses that of the spectrum by up to 8 % of σ² within 3 L/V s, with phases
    that each run draws. In `model`, laws know the mean wind alone.

    Attributes
    ----------
    std
        σ_u, σ_v and σ_w, m/s; in the plane the first two.
    length
        L_u, L_v and L_w, m. In MIL-F-8785C at low altitudes h, in feet: L_w = h and
        L_u = L_v = h/(0.177 + 0.000823 h)^1.2.
    speed
        V, m/s. Default: that of the mean wind.
    """

    name: ClassVar[str] = "dryden"
    departs: ClassVar[str] = "turbulent wind"
    by_processor: ClassVar[bool] = True  # its sines are drawn by NumPy

    std: Annotated[list[float], Unit("m/s")] = field(kw_only=True)
    length: Annotated[list[float], Unit("m")] = field(kw_only=True)
    speed: Annotated[Positive | None, Unit("m/s")] = field(default=None, kw_only=True)
    omega: Any = field(default=None, init=False, repr=False)
    sine: Any = field(default=None, init=False, repr=False)
    cosine: Any = field(default=None, init=False, repr=False)
    along: Any = field(default=None, init=False, repr=False)

    @property
    def varies(self) -> bool:
        """Whether numbers differ from run to run: the phases always do."""
        return True

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the drag with the frequencies ω, a cos φ and a sin φ, ``(axes, sines)`` each."""
        part, std = super().of_run(G, random), np.array(self.std)[:, None]
        n, mean = len(std), np.asarray(part.current, dtype=float)
        speed = np.linalg.norm(mean) if self.speed is None else self.speed
        x = np.stack([frequencies(across=k > 0) for k in range(n)])
        a = (0.0 if random is None else np.sqrt(2 / SINES)) * std
        phase = np.zeros(x.shape) if random is None else random.uniform(0, 2 * np.pi, x.shape)
        numbers = {"sine": a * np.cos(phase), "cosine": a * np.sin(phase)}
        lengths = np.array(self.length)[:, None]
        numbers |= {"omega": x * speed / lengths, "along": _axes(mean)}
        return with_fields(part, std=None, length=None, speed=None, **numbers)

    def turbulence(self, t: Any) -> Array:
        """Return (u, v, w), ``(..., n)``."""
        angle = self.omega * column(column(t))
        wind: Array = (self.sine * sin(angle) + self.cosine * cos(angle)).sum(axis=-1)
        return wind

    def _flow(self, G: MatrixLieGroup, t: Any, rate: bool = False) -> Array:
        mean = super()._flow(G, t, rate)
        gust = (self.along @ self.turbulence(t)[..., None])[..., 0]
        assert G.translation is not None
        start = G.translation.axes.start
        return stack(
            [
                mean[..., k] + (gust[..., k - start] if k >= start else 0.0)
                for k in range(G.dimension)
            ]
        )

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a mean wind that is missing or moves, and numbers that are not for each axis."""
        super().check(G, problems)
        if problems:
            return
        n, here = len(self.current or ()), problems.at("current")
        if not n or any(isinstance(x, str) for x in self.current or ()):
            got = "missing" if self.current is None else f"got {self.current}"
            here.add(f"expected the mean wind as numbers, m/s, {got}; for example [4, 0, 0]")
            return
        for name, least in (("std", 0.0), ("length", 1e-3)):
            values, at = getattr(self, name), problems.at(name)
            check_numbers(values, at)
            if len(values) != n:
                at.add(f"expected {n} numbers, as for the wind, got {len(values)}")
            elif min(values) < least:
                at.add(f"expected numbers of at least {least:g}, got {min(values):g}")
        if self.speed is None and not any(np.any(x) for x in self.current or ()):
            problems.at("speed").add("missing; without a mean wind, the turbulence stands still")


def _axes(mean: Array) -> Array:
    """Return the axes of u, v and w in space as columns: u along the mean wind."""
    n, size = len(mean), np.linalg.norm(mean)
    first = mean / size if size else np.eye(n)[0]
    if n == 2:
        return np.array([[first[0], -first[1]], [first[1], first[0]]])
    up = np.eye(3)[2 if abs(first[2]) < 0.9 else 0]
    second = np.cross(up, first)
    second = second / np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=-1)
