"""Sweeps whose keys follow from others, that drop points, or that are computed in parts."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function("rules of a sweep", "rules.Rules")
    extension.add_function("run --grow", "growth.grow")
    extension.add_function("run --rerun-failed", "reruns.rerun")
    extension.add_function("remarks on a result", "solvers_of_runs.remarks")
    extension.add_function("pack --out", "joining.join")
    extension.add_function("compare --pooled", "pooled.answer")
    extension.add_component("figures", "pooled", "figures")
