"""The `gains` section: the navigation weight and the Rayleigh tensor, checked for definiteness."""

from typing import Any

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.core.problems import Problems
from eqt_cli.experiment.matrices import require_definite, require_minimum, require_symmetric
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.notation.poses import square


def gains_from(section: dict[str, Any], G: MatrixLieGroup, problems: Problems) -> Gains | None:
    """Return the gains of a section, or None after noting its problems.

    Parameters
    ----------
    section
        The keys `kp` and `kd` that are present and have the right type.
    """
    K = K_d = None
    if "kp" in section:
        with problems.catching("kp"):
            K = _weight(section["kp"], G)
            require_symmetric(K)
            require_minimum(K, G)
    if "kd" in section:
        with problems.catching("kd"):
            K_d = square(section["kd"], G.dimension, G)
            require_definite(K_d)
    return None if K is None or K_d is None else Gains(K, K_d)


def _weight(value: Any, G: MatrixLieGroup) -> Array:
    """Return the d×d weight, from one matrix or from one for each factor."""
    if not isinstance(G, ProductGroup) or not isinstance(value, list):
        return square(value, G.size, G)
    if len(value) == G.size and len(value) != len(G.factors):
        return square(value, G.size, G)
    if len(value) != len(G.factors):
        expected = f"expected {len(G.factors)} entries, one per factor of {G.name}"
        raise InputError(f"{expected}, got {len(value)}")
    blocks = []
    for index, (entry, factor) in enumerate(zip(value, G.factors, strict=True)):
        try:
            blocks.append(square(entry, factor.size, factor))
        except InputError as error:
            raise InputError(f"entry {index}: {error}") from error
    from scipy.linalg import block_diag  # slow to import, and readers of results do not need it

    return block_diag(*blocks)
