"""Help pages: options in groups, and a word for each value instead of its Python type."""

from __future__ import annotations

from inspect import cleandoc
from typing import Any

from typer.core import TyperArgument, TyperCommand, TyperGroup

EXPERIMENT = "Experiment"
COMPUTING = "Computing"
RESULT = "Result"
SELECTION = "What to show"
STATISTICS = "Statistics"
LOOKS = "Looks"
OUTPUT = "Output"
"""Groups of options."""

COMPUTE = "Compute"
READ = "Look at results"
LOOK_UP = "Configurations, recordings and components"
"""Groups of commands."""


def example(command: str, arguments: str) -> str:
    """Return the last line of a help page: a command that can be typed."""
    return f"Example: {command} {arguments}"


def _without_types(parameters: list[Any]) -> None:
    """Omit the types that typer prints for arguments and for options without a value.

    The option ``--help`` joins the last group.
    """
    for parameter in parameters:
        if isinstance(parameter, TyperArgument):
            # Set on the argument, not on typer's class; older versions ignore it.
            parameter.display_type_rich = lambda ctx: None  # type: ignore[method-assign]  # hides it
        elif parameter.metavar is None and parameter.is_flag:
            parameter.metavar = ""
        if parameter.name == "help" and len(parameters) > 1:
            parameter.rich_help_panel = parameters[-2].rich_help_panel


class Command(TyperCommand):
    """A command whose help page shows options in groups and no Python types."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help page, with paragraphs that fill the width."""
        _without_types(self.get_params(ctx))
        paragraphs = cleandoc(self.help or "").split("\n\n")
        self.help = "\n\n".join(" ".join(words.split()) for words in paragraphs)
        super().format_help(ctx, formatter)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the ``Usage`` line, without arguments accepted only to be refused in words."""
        shown = [one for one in self.get_params(ctx) if not getattr(one, "hidden", False)]
        return ["[OPTIONS]", *(piece for one in shown for piece in one.get_usage_pieces(ctx))]


class Group(TyperGroup):
    """A group of commands whose help page shows no Python types."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help page."""
        _without_types(self.get_params(ctx))
        super().format_help(ctx, formatter)
