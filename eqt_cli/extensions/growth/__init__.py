"""Results that grow: more runs or points, parts joined, failed runs computed again."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function("run --grow", "growth.grow")
    extension.add_function("run --rerun-failed", "reruns.rerun")
    extension.add_function("remarks on a result", "solvers_of_runs.remarks")
    extension.add_function("pack --out", "joining.join")
