"""Results that grow: more runs or points, parts joined, failed runs computed again."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.run_grow, "growth.grow")
    extension.add_function(purposes.run_rerun_failed, "reruns.rerun")
    extension.add_function(purposes.remarks_on_a_result, "solvers_of_runs.remarks")
    extension.add_function(purposes.pack_out, "joining.join")
