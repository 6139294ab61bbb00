"""The reference stays bounded, in pose, in velocity, and in what they do to tensors."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.certificates.halves import over_horizon
from eqt_cli.analysis.certificates.setting import Setting
from eqt_cli.core.arrays import frobenius, norm


def _at_rest(setting: Setting) -> bool:
    return setting.loop.reference.keeps_velocity and not setting.desired_velocity[0].any()


class PoseBounded(Hypothesis):
    """sup ‖Q_d(t)‖_F; proven on a compact group and for a reference at rest."""

    name: ClassVar[str] = "Q_d is bounded"
    statement: ClassVar[str] = "Theorem 6.2"
    section: ClassVar[float] = 6.41

    def check(self, setting: Setting) -> list[Row]:
        """The supremum, and what is known of it."""
        measured, verdict = over_horizon(frobenius(setting.desired_pose))
        if setting.loop.group.compact:
            return [self.row(Verdict.HOLDS, measured, remark="the group is compact")]
        if _at_rest(setting):
            return [self.row(Verdict.HOLDS, measured, remark="the reference is at rest")]
        return [self.row(verdict, measured, remark="supremum over the horizon")]


class VelocityBounded(Hypothesis):
    """sup ‖V_d(t)‖, which the proof of Theorem 6.2 needs and its statement does not ask for."""

    name: ClassVar[str] = "V_d is bounded"
    statement: ClassVar[str] = "Theorem 6.2, its proof"
    section: ClassVar[float] = 6.42

    def check(self, setting: Setting) -> list[Row]:
        """The supremum, and what is known of it."""
        measured, verdict = over_horizon(norm(setting.desired_velocity))
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
        return [
            self.row(verdict, measured, remark=f"{kind}; largest condition number of Ad_{{Q_d}}")
        ]
