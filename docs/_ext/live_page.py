"""The paper's experiment as a page that computes, beside the built pages: `live/paper.html`.

Its compiler for WebAssembly comes with the packages that build the documentation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from eqt_cli import api


def write(app: Sphinx, error: Exception | None) -> None:
    """Write the page into the finished site."""
    if error is None and app.builder.format == "html":
        folder = Path(app.outdir) / "live"
        folder.mkdir(exist_ok=True)
        api.live("configs/paper.yaml", folder / "paper.html")


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the page behind all others."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
