"""Laws that are neural networks, from the files that trainers write."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "network", "network")
