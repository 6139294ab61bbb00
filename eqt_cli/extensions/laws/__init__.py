"""Laws for their plant: LQR, the equivariant regulator, and laws that reject disturbances."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "l1", "l1")
    for name in ("lqr", "eqr"):
        extension.add_component("controllers", name, "lqr")
    for name in ("indi", "observer"):
        extension.add_component("controllers", name, "rejection")
