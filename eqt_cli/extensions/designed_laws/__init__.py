"""Laws for their plant: LQR, the equivariant regulator, and laws that reject disturbances."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    for name in ("l1", "super_twisting", "geometric_adaptive"):
        extension.add_component("controllers", name, name)
    extension.add_function(purposes.remarks_on_an_experiment, "staying.remarks")
    for name in ("lqr", "eqr"):
        extension.add_component("controllers", name, "lqr")
    for name in ("indi", "observer"):
        extension.add_component("controllers", name, "rejection")
    extension.add_component("certificates", "δ̂ tends to δ", "certificates")
