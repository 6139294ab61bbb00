"""Old addresses: each line `old/page: new/page#section` of `redirects.yaml` gives a page there.

Paths are below `docs`, without a suffix; the section may be missing.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

Page = tuple[str, dict[str, Any], str]


def mistakes(
    redirects: Mapping[str, str], pages: set[str], anchors: Callable[[str], set[str]]
) -> Iterator[str]:
    """Yield a line for each old page that still exists and each target that does not."""
    for old, target in redirects.items():
        page, _, anchor = target.partition("#")
        if old in pages:
            yield f"{old}: the page exists; remove the line or the page"
        if page in redirects:
            yield f"{old}: {page} has moved; name {redirects[page]}"
        elif page not in pages:
            yield f"{old}: there is no page {page}"
        elif anchor and anchor not in anchors(page):
            yield f"{old}: {page} has no section {anchor}"


def leading_on(app: Sphinx) -> Iterator[Page]:
    """Yield a page for each line, which no search finds, and warn of mistakes."""
    if app.builder.format != "html":
        return
    path = Path(app.srcdir) / "redirects.yaml"
    redirects = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    for mistake in mistakes(redirects, app.env.found_docs, lambda page: _anchors(app, page)):
        logger.warning("redirects.yaml: %s", mistake)
    for old, target in redirects.items():
        page, number, anchor = target.partition("#")
        if old in app.env.found_docs or page not in app.env.found_docs:
            continue
        uri = posixpath.relpath(app.builder.get_target_uri(page), posixpath.dirname(old) or ".")
        yield old, {"title": page, "target": f"{uri}{number}{anchor}"}, "redirect.html"


def _anchors(app: Sphinx, page: str) -> set[str]:
    return {
        name
        for node in app.env.get_doctree(page).findall(nodes.Element)
        for name in node.get("ids", ())
    }


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the pages."""
    app.connect("html-collect-pages", leading_on)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
