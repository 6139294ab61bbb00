"""Claims of a paper."""

from __future__ import annotations

from typing import ClassVar

from eqt_cli.extend import AtMost, Claim, ClaimSet, Less, Window

EARLY, WHOLE = Window(0, 5), Window()


class Nobody1999(ClaimSet):
    """What nobody said of two laws."""

    name: ClassVar[str] = "nobody1999"
    source: ClassVar[str] = "Nobody (1999)"
    claims: ClassVar[tuple[Claim, ...]] = (
        Claim("[NoG] needs less torque early", (Less("nog", "eqt", "mean_torque", EARLY),)),
        Claim("[EqT] errs less", (Less("eqt", "nog", "mean_pose_error", WHOLE, True),)),
        Claim("[EqT] errs less at first", (Less("eqt", "nog", "mean_pose_error", Window(0, 1)),)),
        Claim("[EqT] is calm", (AtMost("eqt", "peak_torque", 1e3, "‖τ‖ stays low"),)),
    )
