"""What people look for: `eqt list WORD` for words that are no component, and a table of topics."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.meaning_of_a_word, "topics.meaning")
    extension.add_function(purposes.command_for_a_word, "topics.hint")
