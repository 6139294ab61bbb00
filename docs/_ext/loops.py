"""Sphinx extension: `{loop} NAME` draws a shipped configuration, `{loops}` all of them.

On a code host, the name stands in a box; `eqt show NAME --diagram` draws the same.
"""

from __future__ import annotations

from html import escape
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from eqt_cli import api
from eqt_cli.config import shipped


class Loop(Directive):
    """The loop of one configuration."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the picture."""
        html = api.diagram(str(shipped.folder() / f"{self.arguments[0]}.yaml")).html()
        return [nodes.raw("", html, format="html")]


class Loops(Directive):
    """The loops of all shipped configurations, each behind its name."""

    def run(self) -> list[nodes.Node]:
        """Return the pictures."""
        return [
            nodes.raw("", _folded(name, api.diagram(name).html()), format="html")
            for name in shipped.names()
        ]


def _folded(name: str, html: str) -> str:
    head = f"<summary><code>{escape(name)}</code></summary>"
    return f'<details id="loop-{escape(name)}">{head}{html}</details>'


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_directive("loop", Loop)
    app.add_directive("loops", Loops)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
