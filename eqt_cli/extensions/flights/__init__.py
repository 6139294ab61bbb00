"""What flights say: of a model that replays or fits them, of runs, and of each other."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import COMPUTE, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.need("logs")
    extension.add_keys("keys.Keys")
    extension.add_component("controllers", "replay", "prediction")
    extension.add_component("figures", "measured", "figures")
    of_replay = "model.yaml --measured flown.csv"
    extension.add_command("replay", "commands.replay", COMPUTE, of_replay, after="compare")
    of_fit = f"{of_replay} --over plant.inertia"
    extension.add_command("fit", "commands.fit", COMPUTE, of_fit, after="replay")
    extension.add_command(
        "validate", "commands.validate", COMPUTE, "flights.csv --model model.yaml", after="fit"
    )
    extension.add_function(purposes.checks_of_an_experiment, "statement.check")
    extension.add_function(purposes.errors_of_a_result, "statement.stored")
    extension.add_function(purposes.remarks_on_a_result, "statement.remarks")
    extension.add_function(purposes.answers_of_a_result, "statement.answers")
    extension.add_function(purposes.commands_of_log, "commands.add_to")
    extension.add_function(purposes.plot_measured, "api.read_measured")
    extension.add_function(purposes.compare_measured, "api.compare_measured")
    extension.add_function(purposes.findings_on_a_recording, "measured.findings")
