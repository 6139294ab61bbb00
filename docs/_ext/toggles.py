"""What opens and closes a part of the navigation says which part it is.

The theme writes a `summary` that holds only an icon, which a screen reader cannot say.
"""

from __future__ import annotations

from typing import Any

from bs4 import BeautifulSoup
from sphinx.application import Sphinx


def _name_toggles(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any
) -> None:
    navigation = context.get("generate_toctree_html")
    if navigation is None:
        return

    def with_names(*args: Any, **options: Any) -> str:
        soup = BeautifulSoup(str(navigation(*args, **options)), "html.parser")
        for entry in soup.select("li.has-children"):
            link, toggle = entry.find("a"), entry.find("summary")
            if link and toggle:
                toggle["aria-label"] = f"Pages below {link.get_text()}"
        return str(soup)

    context["generate_toctree_html"] = with_names


def setup(app: Sphinx) -> dict[str, Any]:
    """Act after the theme, whose priority is 500."""
    app.connect("html-page-context", _name_toggles, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
