"""Laws designed for their plant: LQR and the equivariant regulator, INDI and the observer."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    for name in ("lqr", "eqr"):
        extension.add_component("controllers", name, "lqr")
    for name in ("indi", "observer"):
        extension.add_component("controllers", name, "rejection")
