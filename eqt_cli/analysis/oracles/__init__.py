"""Foreign plants: rigid bodies of other programs, with which those of eqt are compared."""

from eqt_cli.analysis.oracles.base import Oracle
from eqt_cli.analysis.oracles.mujoco import MuJoCo
from eqt_cli.analysis.oracles.pinocchio import Pinocchio
from eqt_cli.core.errors import EqtError, suggestion

ORACLES: dict[str, type[Oracle]] = {oracle.name: oracle for oracle in (MuJoCo, Pinocchio)}


def oracle_named(name: str) -> type[Oracle]:
    """Return an oracle after checking that its package can be loaded.

    Raises
    ------
    EqtError
        If there is no such oracle, or its package cannot be loaded.
    """
    if name not in ORACLES:
        hint = suggestion(name, ORACLES) or f"; there are: {', '.join(ORACLES)}"
        raise EqtError(f"--oracle: no oracle '{name}'{hint}")
    found = ORACLES[name]
    if not found.is_installed():
        raise EqtError(f"--oracle {name}: {found.title} is not installed; {found.remedy}")
    try:
        found.version()
    except ImportError as error:
        message = f"--oracle {name}: {found.title} cannot be loaded ({error}); {found.remedy}"
        raise EqtError(message) from error
    return found


__all__ = ["ORACLES", "MuJoCo", "Oracle", "Pinocchio", "oracle_named"]
