"""Plants of somebody else, judged by a configuration: `eqt verify --plant`."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.verify_plant, "plant_verdict.judged")
