"""Laws as C for firmware, and C of others as laws that are judged."""

from eqt_cli.base.extensions import COMPUTE, READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "code", "controllers")
    extension.add_component("metrics", "law_failures", "controllers")
    example = "configs/paper.yaml --controller eqt --out law"
    extension.add_command("export", "commands.export", COMPUTE, example, after="pack")
    of_times = "results/paper --controller eqt"
    extension.add_command("time", "commands.time", READ, of_times, after="diff")
    extension.add_function("verify --code", "controllers.with_code")
    extension.add_function("answers on code", "code_rows.answers")
    extension.add_function("verify --plant", "plant_verdict.judged")
