"""Sweeps whose keys follow from others or that drop points, and comparisons over all points."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.rules_of_a_sweep, "rules.Rules")
    extension.add_function(purposes.compare_pooled, "pooled.answer")
    for name in ("pooled", "winners"):
        extension.add_component("figures", name, "figures")
