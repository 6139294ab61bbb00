"""An experiment as an environment of Gymnasium, to train a policy on the plant that judges it."""

from typing import Any

from eqt_cli.base.extensions import Extension, imported


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function("conclusion of a result", "judging.conclude")
    extension.add_function("remarks on an experiment", "judging.remarks")


def __getattr__(name: str) -> Any:
    """Import what Gymnasium is needed for only where it is used."""
    if name in __all__:
        return imported(f"{__name__}.environment.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["Environment", "make"]
