"""Navigation without a velocity sensor: a filter that predicts by gyro and accelerometer."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("estimators", "navigation", "navigation")
    of_filter = "remarks.of_navigation"
    extension.add_function(purposes.remarks_on_an_experiment, of_filter, about=["navigation"])
