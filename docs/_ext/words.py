"""Find words that `words.yaml` rules out, in the pages and in the help of the commands."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^(`{3,}|:{3,})(?:\{(\w+)\})?[^\n]*\n(.*?)^\1\s*$", re.MULTILINE | re.DOTALL)
UNWRITTEN = re.compile(  # keys in headings, code, formulas, addresses, and titles of publications
    r"^### \w+$|`[^`]*`|\$[^$]*\$|\]\([^)]*\)|^\(.*\)=$|<!--.*?-->|(?<!\*)\*[^*\n]+\*(?!\*)",
    re.MULTILINE | re.DOTALL,
)


def of_page(text: str) -> str:
    """Return a page without its code; figures and remarks have prose."""
    of_words = ("figure", "note", "tip", "warning")
    text = FENCE.sub(lambda fence: fence[3] if fence[2] in of_words else "", text)
    return UNWRITTEN.sub("]", text).replace("groups, controllers", "")


def of_help(text: str) -> str:
    """Return a help text without code, options, and what a command may be given."""
    unwritten = r"`[^`]*`|--[\w-]+|groups, controllers|eqt list controllers"
    return re.sub(unwritten, "", re.sub(r"\s*[│\n]\s*", " ", text))


def sentence(text: str, hit: re.Match[str]) -> str:
    """Return the line around a word, up to full stops."""
    before = re.split(r"[\n.]", text[: hit.start()][-1000:])[-1]
    return (before + hit[0] + re.split(r"[\n.]", text[hit.end() :][:1000])[0]).strip()


if __name__ == "__main__":
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    texts = {path: of_page(path.read_text(encoding="utf-8")) for path in pages}
    for path in sorted((ROOT / "tests" / "cli" / "help").glob("*.txt")):
        texts[path] = of_help(path.read_text(encoding="utf-8"))
    words = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    found = [
        f"{path.relative_to(ROOT)}: {sentence(text, hit)}: write {word['but']} ({word['because']})"
        for word in words
        for path, text in texts.items()
        for hit in re.finditer(rf"\b{word['not']}\b", text, re.IGNORECASE)
    ]
    print(*found, sep="\n", end="\n" * bool(found), file=sys.stderr)
    sys.exit(bool(found))
