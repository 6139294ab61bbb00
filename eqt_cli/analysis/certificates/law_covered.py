"""Whether each law is one that the paper shows to stabilise."""

from __future__ import annotations

from typing import ClassVar

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.certificates.setting import Setting


class LawCovered(Hypothesis):
    """The law claims that L falls: c + n = 1 in the family, feedforward when stabilising."""

    name: ClassVar[str] = "the law is covered"
    statement: ClassVar[str] = "Theorems 3.2, 6.2, §7"
    section: ClassVar[float] = 6.44

    def check(self, setting: Setting) -> list[Row]:
        """One row per law."""
        verdicts = {True: Verdict.HOLDS, False: Verdict.VIOLATED, None: Verdict.UNKNOWN}
        return [
            self.row(verdicts[loop.claims_decrease], controller=label)
            for label, loop in setting.loops.items()
        ]
