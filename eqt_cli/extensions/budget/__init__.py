"""From a data sheet to an error budget: drift as sheets state it, and `eqt budget`."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("sensors", "drift", "drift")
