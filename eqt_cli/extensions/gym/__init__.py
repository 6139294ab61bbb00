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


_MODULES = {
    "Bounded": "price",
    "Environment": "environment",
    "SingleEnvironment": "one",
    "bounded": "price",
    "make": "environment",
    "sb3": "stable_baselines",
    "single": "one",
}


def __getattr__(name: str) -> Any:
    """Import what Gymnasium is needed for only where it is used."""
    if name in _MODULES:
        return imported(f"{__name__}.{_MODULES[name]}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [*_MODULES]
