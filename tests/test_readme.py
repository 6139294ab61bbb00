"""What the README points to exists; `test_docs.py` carries out its commands and snippets."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_files_it_points_to_exist():
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", (ROOT / "README.md").read_text("utf-8"))
    assert links
    for link in links:
        assert (ROOT / link).exists(), link
