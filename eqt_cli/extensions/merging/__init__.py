"""Configurations that extend others: `extends: vehicle.yaml`, and `eqt config show`."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_keys("keys.Keys")
    extension.add_function(purposes.extends, "merging.extended")
    extension.add_function(purposes.commands_of_config, "commands.add_to")
