"""What the README points to exists; `test_docs.py` carries out its commands and snippets."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_files_it_points_to_exist():
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", (ROOT / "README.md").read_text("utf-8"))
    assert links
    for link in links:
        path, _, heading = link.partition("#")
        page = ROOT / (path or "README.md")
        assert page.exists(), link
        if heading:
            titles = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.M)
            assert heading in [
                re.sub(r"[^\w -]", "", one).lower().replace(" ", "-") for one in titles
            ]
