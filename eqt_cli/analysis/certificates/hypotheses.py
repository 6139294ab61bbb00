"""Assumptions of the theorems about group, gains, inertia, reference and laws."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.evidence.runs import Setting
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.mechanics.critical_points import CriticalSet, critical_sets
from eqt_cli.mechanics.inertia import Inertia, not_rigid
from eqt_cli.mechanics.navigation import hessian_at_identity

INSTANTS = 1001
"""Number of instants of the horizon at which a varying inertia is evaluated."""

GROWTH = 1e-3
"""Least relative growth that counts; samples can miss maxima by less than this."""


class NavigationFunction(Hypothesis):
    """Υ is proper and Morse with a unique minimum. Measured: least |Hessian eigenvalue| ≠ 0.

    Morse-Bott if critical points form manifolds and the Hessian is 0 only along them.
    """

    name: ClassVar[str] = "Υ is a navigation function"
    statement: ClassVar[str] = "Definition 2.1"
    section: ClassVar[float] = 2.9

    def check(self, setting: Setting) -> list[Row]:
        """The critical sets with their indices."""
        G, K = setting.inside.group, setting.inside.gains.K
        sets = critical_sets(G, K)
        if sets is None:
            return [self.row(Verdict.UNKNOWN, remark=f"critical points on {G.name} not known")]
        remark = "; ".join(_described(each) for each in sets)
        sizes = [np.sort(np.abs(each.hessian))[each.nullity :].min() for each in sets]
        return [self.row(_verdict(sets), float(min(sizes)), remark=remark)]


def _verdict(sets: list[CriticalSet]) -> Verdict:
    minima = [each for each in sets if each.index == 0]
    clean = all(each.nullity == each.dimension for each in sets)
    if minima != sets[:1] or not clean:  # the identity comes first, and is a single point
        return Verdict.VIOLATED
    return Verdict.MORSE_BOTT if any(each.dimension for each in sets) else Verdict.HOLDS


def _described(each: CriticalSet) -> str:
    whole = f", a manifold of dimension {each.dimension}" if each.dimension else ""
    return f"{each.name}: index {each.index}{whole}"


class WeightCondition(Hypothesis):
    """The Hessian of Υ at I is positive definite; on SO(3), λ_i + λ_j > 0."""

    name: ClassVar[str] = "Hessian of Υ at I is positive"
    statement: ClassVar[str] = "Example 3.4"
    section: ClassVar[float] = 3.4

    def check(self, setting: Setting) -> list[Row]:
        """Its smallest eigenvalue."""
        hessian = hessian_at_identity(setting.inside.group, setting.inside.gains.K)
        return [self.row(*_definite(hessian), 0.0, "smallest eigenvalue")]


class RayleighTensor(Hypothesis):
    """⟨K_d V, V⟩ > 0."""

    name: ClassVar[str] = "K_d is positive definite"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.4

    def check(self, setting: Setting) -> list[Row]:
        """The smallest eigenvalue of its symmetric part."""
        K_d = setting.inside.gains.K_d
        return [self.row(*_definite((K_d + K_d.T) / 2), 0.0, "smallest eigenvalue")]


def _definite(matrix: Array) -> tuple[Verdict, float]:
    smallest = float(np.linalg.eigvalsh(matrix).min())
    return Verdict.HOLDS if smallest > 0 else Verdict.VIOLATED, smallest


class InertiaBounds(Hypothesis):
    """𝕀_t is bounded above and below, and 𝕀̇_t above. Measured: the largest ‖𝕀̇_t‖₂."""

    name: ClassVar[str] = "𝕀_t and its rate are bounded"
    statement: ClassVar[str] = "Theorem 3.2"
    section: ClassVar[float] = 3.2

    def check(self, setting: Setting) -> list[Row]:
        """Extreme eigenvalues and the largest rate; proven where the inertia is constant."""
        law = setting.loop.inertia
        if isinstance(law, Inertia):
            low, high = np.linalg.eigvalsh(law.matrix)[[0, -1]]
            return [self.row(Verdict.HOLDS, 0.0, remark=f"constant, {low:.3g} ≤ 𝕀 ≤ {high:.3g}")]
        now = law.at(np.linspace(setting.times[0], setting.times[-1], INSTANTS))
        change = np.zeros_like(now.matrix) if now.change is None else now.change
        # Expressions without t give one matrix for all times.
        shape = (INSTANTS, *now.matrix.shape[-2:])
        matrix, change = np.broadcast_to(now.matrix, shape), np.broadcast_to(change, shape)
        rates = np.linalg.norm(change + change.swapaxes(-1, -2), 2, axis=(-2, -1))
        eigenvalues = np.linalg.eigvalsh(matrix)
        _, verdict = _over_horizon(np.maximum(rates, eigenvalues.max(axis=-1)))
        remark = f"{eigenvalues.min():.3g} ≤ 𝕀 ≤ {eigenvalues.max():.3g} on the horizon"
        return [self.row(verdict, float(rates.max()), remark=remark)]


class RigidBody(Hypothesis):
    """The inertia can be that of a rigid body, which no theorem needs. A row appears if not."""

    name: ClassVar[str] = "𝕀 is a rigid body's"
    statement: ClassVar[str] = "triangle inequality"
    section: ClassVar[float] = 3.21

    def check(self, setting: Setting) -> list[Row]:
        """The principal moments that break the inequality."""
        loop = setting.loop
        broken = not_rigid(loop.group, loop.inertia, float(setting.times[-1]))
        return [self.row(Verdict.VIOLATED, remark=broken)] if broken and setting.rigid else []


class PoseBounded(Hypothesis):
    """sup ‖Q_d(t)‖_F; proven on a compact group and for a reference at rest."""

    name: ClassVar[str] = "Q_d is bounded"
    statement: ClassVar[str] = "Theorem 6.2"
    section: ClassVar[float] = 6.41

    def check(self, setting: Setting) -> list[Row]:
        """The supremum, and what is known of it."""
        measured, verdict = _over_horizon(frobenius(setting.desired_pose))
        if setting.loop.group.compact:
            return [self.row(Verdict.HOLDS, measured, remark="the group is compact")]
        if setting.loop.reference.keeps_velocity and not setting.desired_velocity[0].any():
            return [self.row(Verdict.HOLDS, measured, remark="the reference is at rest")]
        return [self.row(verdict, measured, remark="supremum over the horizon")]


class VelocityBounded(Hypothesis):
    """sup ‖V_d(t)‖, which the proof of Theorem 6.2 needs but its statement does not assume."""

    name: ClassVar[str] = "V_d is bounded"
    statement: ClassVar[str] = "Theorem 6.2, its proof"
    section: ClassVar[float] = 6.42

    def check(self, setting: Setting) -> list[Row]:
        """The supremum, and what is known of it."""
        measured, verdict = _over_horizon(norm(setting.desired_velocity))
        if setting.loop.reference.keeps_velocity:
            return [self.row(Verdict.HOLDS, measured, remark="the reference keeps its velocity")]
        return [self.row(verdict, measured, remark="supremum over the horizon")]


class AdjointBounded(Hypothesis):
    """Ad_{Q_d} and its inverse are bounded with Q_d on a compact group times a vector space."""

    name: ClassVar[str] = "Ad_{Q_d} is bounded with Q_d"
    statement: ClassVar[str] = "Remark 6.3"
    section: ClassVar[float] = 6.43

    def check(self, setting: Setting) -> list[Row]:
        """The class of the group, and the largest condition number on the horizon."""
        G = setting.loop.group
        measured = float(np.linalg.cond(G.Ad_matrix(setting.desired_pose)).max())
        if G.compact_times_vector is None:
            return [self.row(Verdict.UNKNOWN, measured, remark=f"class of {G.name} not known")]
        verdict = Verdict.HOLDS if G.compact_times_vector else Verdict.UNKNOWN
        kind = "compact" if G.compact else "compact ⋉ vector space"
        remark = f"{kind}; largest condition number of Ad_{{Q_d}}"
        return [self.row(verdict, measured, remark=remark)]


class LawCovered(Hypothesis):
    """The law claims that L falls: c + n = 1 in the family, feedforward when stabilising."""

    name: ClassVar[str] = "the law is covered"
    statement: ClassVar[str] = "Theorems 3.2, 6.2, §7"
    section: ClassVar[float] = 6.44

    def check(self, setting: Setting) -> list[Row]:
        """One row per law, with its source where it is published, else the paper's statement."""
        verdicts = {True: Verdict.HOLDS, False: Verdict.VIOLATED, None: Verdict.UNKNOWN}
        rows = []
        for label, loop in setting.loops.items():
            verdict = Verdict.NOT_COVERED if loop.departures else verdicts[loop.claims_decrease]
            row = self.row(verdict, remark=loop.departures, controller=label)
            theorem = loop.controller.theorem
            published = theorem not in ("", Controller.theorem)
            rows.append(replace(row, statement=theorem) if published else row)
        return rows


def _over_horizon(values: Array) -> tuple[float, Verdict]:
    """Return the supremum over samples, and `growing` if the second half exceeds the first."""
    middle = (len(values) + 1) // 2
    first, second = float(values[:middle].max()), float(values[middle:].max(initial=0.0))
    verdict = Verdict.GROWING if second > first * (1 + GROWTH) else Verdict.UNKNOWN
    return max(first, second), verdict
