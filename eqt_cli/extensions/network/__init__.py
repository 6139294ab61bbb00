"""Laws that are neural networks, from the files that trainers write."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "network", "network")
    extension.add_function(purposes.checks_of_an_experiment, "missing.check_files")
