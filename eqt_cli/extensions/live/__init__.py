"""Experiments that run in a page: `eqt live`."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.need("report")
    extension.add_keys("keys.Keys")
    example = "configs/paper.yaml --key gains.kp=0.1:10 --out paper.html"
    extension.add_command("live", "commands.live", READ, example, after="report")
    extension.add_function(purposes.check_of_a_configuration, "section.check")
    extension.add_function(purposes.report_live, "api.report_part")
