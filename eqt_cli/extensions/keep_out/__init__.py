"""Keep-out cones: how long, and how far, an axis of the body comes too near to a direction."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("metrics", "keep_out_time", "cones")
    extension.add_component("metrics", "keep_out_margin", "cones")
    extension.add_component("figures", "keep_out", "figures")
    extension.add_function(purposes.judge_constraints, "between.judge_constraints")
    extension.add_function(purposes.boxes_of_a_diagram, "diagram.boxes")
    extension.add_function(purposes.remarks_on_an_experiment, "remarks.remarks", about=["cones"])
