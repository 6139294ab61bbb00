"""Sweeps whose keys follow from others or that drop points, and comparisons over all points."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function("rules of a sweep", "rules.Rules")
    extension.add_function("compare --pooled", "pooled.answer")
    extension.add_component("figures", "pooled", "figures")
