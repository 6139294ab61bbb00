"""The `gains` section: the navigation weight and the Rayleigh tensor, checked for definiteness."""

from __future__ import annotations

from typing import Any

from scipy.linalg import block_diag

from eqt_cli.core.arrays import Array
from eqt_cli.experiment import tensors
from eqt_cli.experiment.problems import Problems
from eqt_cli.experiment.schema import GainsSection
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.mechanics.tracking import Gains


def gains_from(section: GainsSection, G: MatrixLieGroup, problems: Problems) -> Gains | None:
    """The gains that a section describes, or None after noting what is wrong with them."""
    K = _weight(section.kp, G)
    wrong = K if isinstance(K, str) else tensors.asymmetry(K) or tensors.degenerate_minimum(K, G)
    if wrong:
        problems.add(("gains", "kp"), wrong)
    K_d = tensors.square(section.kd, G.dimension, G)
    wrong = K_d if isinstance(K_d, str) else tensors.indefiniteness(K_d)
    if wrong:
        problems.add(("gains", "kd"), wrong)
    return None if isinstance(K, str) or isinstance(K_d, str) else Gains(K, K_d)


def _weight(value: Any, G: MatrixLieGroup) -> Array | str:
    """The d×d weight, from one matrix or from one per factor."""
    if not isinstance(G, ProductGroup) or not isinstance(value, list):
        return tensors.square(value, G.size, G)
    if len(value) == G.size and len(value) != len(G.factors):
        return tensors.square(value, G.size, G)
    if len(value) != len(G.factors):
        return f"expected {len(G.factors)} entries, one per factor of {G.name}, got {len(value)}"
    blocks = []
    for index, (entry, factor) in enumerate(zip(value, G.factors, strict=True)):
        block = tensors.square(entry, factor.size, factor)
        if isinstance(block, str):
            return f"entry {index}: {block}"
        blocks.append(block)
    weight: Array = block_diag(*blocks)
    return weight
