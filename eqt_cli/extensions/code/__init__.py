"""Code of somebody else as a law, judged by the law that it claims to be; times of calls."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "code", "controllers")
    extension.add_component("metrics", "law_failures", "controllers")
    of_times = "results/paper --controller eqt"
    extension.add_command("time", "commands.time", READ, of_times, after="results")
    extension.add_function(purposes.verify_code, "controllers.with_code")
    extension.add_function(purposes.answers_on_code, "code_rows.answers")
    extension.add_function(purposes.adapter_of_code, "controllers.adapter_of")
    extension.add_function(purposes.signal_of_code, "controllers.signal_of_code")
    extension.add_function(purposes.function_in_python, "user_code.function_in_python")
