"""Where bodies went: figures of paths and poses, and what stands for a body in a picture."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    for name in ("path", "pose"):
        extension.add_component("figures", name, "figures")
