"""Searches: for the best gains of each law, and for its worst run."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import COMPUTE, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_keys("keys.Keys")
    extension.add_component("figures", "fronts", "figures")
    extension.add_component("figures", "worst", "figures")
    extension.add_command("tune", "commands.tune", COMPUTE, "configs/tune_paper.yaml", "compare")
    extension.add_command("worst", "commands.worst", COMPUTE, "late.yaml --fail-above 0.2", "tune")
    for record in ("tuning.json", "worst.json"):
        conclude = "conclusion.conclusion"
        extension.add_function(purposes.conclusion_of_a_result, conclude, beside=record)
    answer = "comparison.answer"
    extension.add_function(purposes.answer_of_compare, answer, beside="tuning.json")
    extension.add_function(purposes.seeds_of_judges, "sections.seeds_of_judges")
    extension.add_function(purposes.check_of_a_configuration, "sections.check")
