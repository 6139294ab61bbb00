"""What is proved and tested of laws: `eqt verify`, `eqt margins`, and certified rates."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_kind("certificates", "certificates")
    extension.add_component("figures", "rates", "figures")
    extension.add_command("verify", "commands.verify", READ, "configs/paper.yaml", after="diff")
    of_margins = "paper --set 'reference={kind: constant}'"
    extension.add_command("margins", "commands.margins", READ, of_margins, after="verify")
    extension.add_function(purposes.remarks_on_a_result, "step_limits.remarks")
    extension.add_function(purposes.meaning_of_an_experiment, "meaning.meaning")
    extension.add_function(purposes.remarks_on_an_experiment, "slips.remarks")
    extension.add_function(purposes.worst_certified, "margins.proved_from")
    extension.add_function(purposes.figure_certified, "figures.proved")
    extension.add_function(purposes.certificates_of_a_report, "verification.certificates_of")
    extension.add_function(purposes.identities_of_laws, "verification.tallies")
    for name in ("certified_rate", "push_bound"):
        extension.add_function(purposes.proved_objective, f"gains.{name}", key=name)
