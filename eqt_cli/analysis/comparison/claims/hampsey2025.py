"""The claims of Hampsey et al. (2025), section 7, about their four controllers."""

from typing import ClassVar

from eqt_cli.analysis.comparison.claims.base import AtMost, Claim, ClaimSet, Less
from eqt_cli.results.metrics import EARLY

NEVER_RISES = 1e-6
"""Bound relative to L(0): far above solver errors, and far below any visible rise."""


class Hampsey2025(ClaimSet):
    """Hampsey, van Goor, Banavar, Mahony (2025), section 7."""

    name: ClassVar[str] = "hampsey2025"
    source: ClassVar[str] = "Hampsey et al. (2025), section 7"
    claims: ClassVar[tuple[Claim, ...]] = (
        Claim(
            "All four of these controls are stabilising",
            tuple(
                AtMost(kind, "lyapunov_rise", NEVER_RISES, "L does not rise between samples")
                for kind in ("eqt", "gt", "nog", "asym")
            ),
        ),
        Claim(
            "the EqT control requires less control action for large error (the first 5 seconds of "
            "the response)",
            (Less("eqt", "gt", "mean_torque", EARLY),),
        ),
        Claim(
            "[EqT] leads to slightly slower attitude tracking than the GT control",
            (Less("gt", "eqt", "mean_pose_error", rotation_only=True),),
        ),
        Claim(
            "The EqT and GT controls appear to be superior to the two approximations",
            tuple(
                Less(lesser, greater, measure, rotation_only=measure == "mean_pose_error")
                for measure in ("mean_pose_error", "mean_torque")
                for lesser in ("eqt", "gt")
                for greater in ("nog", "asym")
            ),
        ),
    )
