"""Faults of public copies of published laws, each planted in a copy of that law's class.

Exactly the rows of that law must turn red which say what the fault has broken.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from small_loops import closed_loop

from eqt_cli.components.laws import Lee2010, Lee2012, controllers
from eqt_cli.extend import Goodarzi2013, Logarithmic, apply_matrix, group_named
from eqt_cli.extensions.proofs.certificates import Verdict, identity_rows
from eqt_cli.extensions.proofs.sample import sampled

SO3 = group_named("SO3")
SMALL = "stiffness and damping of small errors"
RATE = "rate of L"


@dataclass(frozen=True)
class WithoutTransport(Lee2010):
    """The term JΩ̂RᵀR_dΩ_d is dropped."""

    name: ClassVar[str] = "lee2010"
    dissipation = Lee2010.dissipation

    def torque(self, s):
        r = s.relative
        return super().torque(s) + r.inertia.momentum(r.G.ad(r.V, r.Vd))


@dataclass(frozen=True)
class TransposedJacobian(Logarithmic):
    """J_rᵀ in the place of J_r⁻ᵀ."""

    name: ClassVar[str] = "logarithmic"

    def force(self, r):
        x = r.G.log(r.Q)
        term = total = apply_matrix(r.stiffness, x)
        for n in range(1, 25):
            term = -r.G.ad_star(x, term)
            total = total + term / math.factorial(n + 1)
        return total


@dataclass(frozen=True)
class TwiceTheStiffness(Lee2012):
    """k_R enters as it is, and again in e_R."""

    name: ClassVar[str] = "lee2012"
    matched: ClassVar[bool | None] = True
    dissipation = Lee2012.dissipation

    def torque(self, s):
        return super().torque(s) - s.relative.gradient


@dataclass(frozen=True)
class FeedforwardAtZero(Goodarzi2013):
    """The desired acceleration is taken to be 0."""

    name: ClassVar[str] = "goodarzi2013"
    lyapunov = Goodarzi2013.lyapunov

    def torque(self, s):
        r = s.relative
        carried = r.G.Ad(r.G.inverse(r.Q), s.Vd_dot)
        return super().torque(s) - r.inertia.momentum(carried)

    def dissipation(self, s):
        return Goodarzi2013(self.ki, self.c2, self.bound).dissipation(s)


FAULTS = {
    "transport term dropped": (WithoutTransport(), {RATE}),
    "J transposed, not inverted": (TransposedJacobian(), {RATE}),
    "k_R twice": (TwiceTheStiffness(), {RATE, SMALL}),
    "feedforward at 0": (FeedforwardAtZero(), {RATE}),
}


def test_faults_turn_the_rows_of_their_laws_red():
    """All at once: the row of a law does not depend on the others."""
    planted = {law.name: law for law, _ in FAULTS.values()}
    kinds = [kind for kind in controllers.all() if "track" in kind.tasks]
    laws, random = [planted.get(kind.name) or kind() for kind in kinds], np.random.default_rng(0)
    common = sampled("", closed_loop(SO3), 5.0, random)
    rows = identity_rows(
        common, [sampled(law.name, closed_loop(SO3, law), 5.0, random) for law in laws]
    )
    red = {(row.name, row.controller) for row in rows if row.verdict is Verdict.FAILS}
    assert red == {(row, law.name) for law, rows in FAULTS.values() for row in rows}
