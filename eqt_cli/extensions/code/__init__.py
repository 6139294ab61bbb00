"""Code of somebody else as a law, judged by the law that it claims to be; times of calls."""

from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "code", "controllers")
    extension.add_component("metrics", "law_failures", "controllers")
    of_times = "results/paper --controller eqt"
    extension.add_command("time", "commands.time", READ, of_times, after="diff")
    extension.add_function("verify --code", "controllers.with_code")
    extension.add_function("answers on code", "code_rows.answers")
