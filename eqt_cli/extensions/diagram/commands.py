"""`eqt show --diagram`: the loop of a configuration or a result as text, or as a picture."""

from pathlib import Path

from eqt_cli.base import purposes
from eqt_cli.cli import output
from eqt_cli.extensions.diagram.api import diagram


@purposes.show_diagram
def show(config: Path, out: Path | None, point: int | None, trust_plugins: bool) -> None:
    """Print the diagram, or write it to a file."""
    drawn = diagram(config, point=point, trust_plugins=trust_plugins)
    if out is None:
        output.print_text(drawn.text().rstrip("\n"))
    else:
        output.print_text(f"diagram  {drawn.save(out)}")
