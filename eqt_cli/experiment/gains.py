"""The `gains` section: the navigation weight and the Rayleigh tensor, checked for definiteness."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scipy.linalg import block_diag

from eqt_cli.config.problems import Problems
from eqt_cli.core.arrays import Array
from eqt_cli.experiment import tensors
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.mechanics.tracking import Gains


def gains_from(section: dict[str, Any], G: MatrixLieGroup, problems: Problems) -> Gains | None:
    """The gains that a section describes, or None after noting what is wrong with them.

    Parameters
    ----------
    section
        Those of the keys `kp` and `kd` that are there and of the right type.
    """

    def flaw_of_weight(K: Array) -> str | None:
        return tensors.asymmetry(K) or tensors.degenerate_minimum(K, G)

    K = K_d = None
    if "kp" in section:
        K = _checked("kp", _weight(section["kp"], G), flaw_of_weight, problems)
    if "kd" in section:
        tensor = tensors.square(section["kd"], G.dimension, G)
        K_d = _checked("kd", tensor, tensors.indefiniteness, problems)
    return None if K is None or K_d is None else Gains(K, K_d)


def _checked(
    key: str,
    matrix: Array | str,
    flaw_of: Callable[[Array], str | None],
    problems: Problems,
) -> Array | None:
    """The matrix, or None after noting what is wrong with its shape or its entries."""
    wrong = matrix if isinstance(matrix, str) else flaw_of(matrix)
    if wrong:
        problems.add(("gains", key), wrong)
    return None if isinstance(matrix, str) else matrix


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
