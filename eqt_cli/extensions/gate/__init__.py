"""Gates: whether the laws of a result became worse than those of another one, by a margin."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.compare_fail_on, "worsening.gate")
