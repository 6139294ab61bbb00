"""Certificates of all three kinds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.extend import (
    Array,
    Hypothesis,
    Identity,
    Row,
    Runs,
    Sample,
    Setting,
    TrajectoryCheck,
    Verdict,
    dot,
)


class Gyroscopic(Identity):
    """⟨ad*_Ṽ 𝕀V_d, Ṽ⟩ = 0: the weight g is free on every group."""

    name: ClassVar[str] = "the g-term has no power"
    statement: ClassVar[str] = "§7"
    section: ClassVar[float] = 7.35

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The power, and 0."""
        s = sample.s
        power = dot(s.G.ad_star(s.V_tilde, s.Pd), s.V_tilde)
        yield power, 0 * power


class Attracted(TrajectoryCheck):
    """Every run ends closer than a threshold."""

    name: ClassVar[str] = "the error ends small"
    statement: ClassVar[str] = "own"
    section: ClassVar[float] = 9.0

    def check(self, runs: Runs) -> Row:
        """The largest final error."""
        found = float(np.max(runs.final_pose_error))
        verdict = Verdict.HOLDS if found <= 10 * runs.threshold else Verdict.UNDECIDED
        remark = f"{runs.count} runs, rate {runs.decay_rate():.3g}"
        return self.row(verdict, found, 10 * runs.threshold, remark, runs.label)


class Moving(Hypothesis):
    """The reference moves."""

    name: ClassVar[str] = "the reference moves"
    statement: ClassVar[str] = "own"
    section: ClassVar[float] = 9.1

    def check(self, setting: Setting) -> list[Row]:
        """Its largest speed."""
        speed = float(np.linalg.norm(setting.desired_velocity, axis=-1).max())
        verdict = Verdict.HOLDS if speed > 0 else Verdict.VIOLATED
        return [self.row(verdict, speed, remark=f"{setting.loop.group.name}")]
