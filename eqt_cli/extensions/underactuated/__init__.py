"""Bodies pushed along one axis only: the motion that a position asks for, and a law that tilts."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "cascade", "cascade")
    extension.add_component("controllers", "velocity_cascade", "velocity_cascade")
    extension.add_component("references", "flat", "flat")
    on_rates = "remarks.remarks"
    extension.add_function(purposes.remarks_on_an_experiment, on_rates, about=["cascade"])
    for name in ("rates of the commanded attitude", "F is not 0"):
        extension.add_component("certificates", name, "certificates")
