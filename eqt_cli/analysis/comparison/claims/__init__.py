"""Claims of papers about their controllers, as data: one file per paper, found by scanning."""

from eqt_cli.analysis.comparison.claims.base import AtMost, Claim, ClaimSet, Less
from eqt_cli.core.registry import Registry

claim_sets = Registry("claim set", __name__, ClaimSet)

__all__ = ["AtMost", "Claim", "ClaimSet", "Less", "claim_sets"]
