"""Find words that `words.yaml` rules out, in the pages, the help of the commands and messages."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


def of_module(text: str) -> str:
    """Return the texts of a module that a user may read, a line each: no docstrings, no names."""
    texts, unread = [], set()
    for node in ast.walk(ast.parse(text)):  # which comes to a whole before its parts
        if isinstance(node, ast.Expr):
            unread.add(node.value)
        elif isinstance(node, ast.JoinedStr):
            unread.update(node.values)
            parts = (x.value if isinstance(x, ast.Constant) else "…" for x in node.values)
            texts.append("".join(parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in unread:
            texts.append(node.value)
    return "\n".join(re.sub(r"`[^`]*`|\s+", " ", each) for each in texts if " " in each)


def hits(word: dict[str, Any], text: str) -> Iterator[re.Match[str]]:
    """Yield where a word stands, but for the phrases in which it is right."""
    right = [x.span() for each in word.get("unless", ()) for x in re.finditer(each, text)]
    for hit in re.finditer(rf"\b{word['not']}\b", text, re.IGNORECASE):
        if not any(begin <= hit.start() < end for begin, end in right):
            yield hit


def sentence(text: str, hit: re.Match[str]) -> str:
    """Return the line around a word, up to full stops."""
    before = re.split(r"[\n.]", text[: hit.start()][-1000:])[-1]
    return (before + hit[0] + re.split(r"[\n.]", text[hit.end() :][:1000])[0]).strip()


if __name__ == "__main__":
    written = sorted((ROOT / "docs").rglob("*.md"))
    pages = [ROOT / "README.md", *(page for page in written if page.parent.name != "paper")]
    texts = {path: of_page(path.read_text(encoding="utf-8")) for path in pages}
    for path in sorted((ROOT / "tests" / "cli" / "help").glob("*.txt")):
        texts[path] = of_help(path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / "eqt_cli").rglob("*.py")):
        texts[path] = of_module(path.read_text(encoding="utf-8"))
    words = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    found = [
        f"{path.relative_to(ROOT)}: {sentence(text, hit)}: write {word['but']} ({word['because']})"
        for word in words
        for path, text in texts.items()
        if path.suffix != ".py" or word.get("messages", True)
        for hit in hits(word, text)
    ]
    print(*found, sep="\n", end="\n" * bool(found), file=sys.stderr)
    sys.exit(bool(found))
