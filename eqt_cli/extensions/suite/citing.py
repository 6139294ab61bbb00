"""What to cite of laws that the suite judged."""

from __future__ import annotations

from pathlib import Path

from eqt_cli.base import purposes
from eqt_cli.base.version import __version__
from eqt_cli.extensions.suite.actions import FILE
from eqt_cli.extensions.suite.archive import read
from eqt_cli.extensions.suite.tasks import all_tasks, digest_of


@purposes.citations
def citations(folder: Path) -> tuple[list[str], list[str]]:
    """Return the kinds of the laws in a folder of the suite, and the entry of the suite."""
    archive = read(folder / FILE)
    kinds = [law.label for law in archive.laws.values() if law.kind == "shipped"]
    entry = (
        f"@misc{{{archive.suite},\n"
        f"  title        = {{{archive.suite}: standard tasks for tracking laws}},\n"
        f"  howpublished = {{eqt {__version__}}},\n"
        f"  note         = {{tasks {', '.join(archive.tasks)};"
        f" digest of the suite {digest_of(all_tasks())[:12]}}}\n}}"
    )
    return ["gt", *kinds], [entry.replace("_", r"\_")]
