"""A page must be complete by itself: whatever it would load from a network is a warning."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

LOADED = re.compile(
    r"""<(?:script|img|iframe|source)\b[^>]*\bsrc=["'](?:https?:)?//[^"']*"""
    r"""|<link\b(?=[^>]*\brel=["'](?:stylesheet|preload|preconnect))[^>]*\bhref=["'](?:https?:)?//"""
)
IMPORTED = re.compile(r"""(?:@import|url\()\s*["']?(?:https?:)?//[^"')]*""")

logger = logging.getLogger(__name__)


def check(app: Sphinx, exception: Exception | None) -> None:
    """Warn of every file of the site that would be loaded from elsewhere."""
    if exception or app.builder.format != "html":
        return
    for pattern, suffix in ((LOADED, "*.html"), (IMPORTED, "*.css")):
        for path in sorted(Path(app.outdir).rglob(suffix)):
            for found in pattern.findall(path.read_text(encoding="utf-8")):
                logger.warning("%s loads from a network: %s", path.name, found)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the check."""
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
