"""An experiment as an environment of Gymnasium, to train a policy on the plant that judges it."""

from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension, imported


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.need("network")
    extension.add_function(purposes.conclusion_of_a_result, "judging.conclude")
    extension.add_function(purposes.laws_that_runs_flatter, "judging.flattered_by")
    extension.add_function(purposes.remarks_on_an_experiment, "judging.remarks")


def __getattr__(name: str) -> Any:
    """Import what Gymnasium is needed for only where it is used."""
    if name in __all__:
        return imported(f"{__name__}.environment.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["Environment", "make"]
