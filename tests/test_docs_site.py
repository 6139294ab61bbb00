"""The mechanics of the documentation's site, without building it."""

import re
import sys
from pathlib import Path

import pytest
import yaml

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def redirects(monkeypatch):
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    import redirects

    yield redirects
    del sys.modules["redirects"]


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        ({"old": "new"}, []),
        ({"old": "new#section"}, []),
        ({"new": "other"}, ["new: the page exists; remove the line or the page"]),
        ({"old": "gone"}, ["old: there is no page gone"]),
        ({"old": "new#gone"}, ["old: new has no section gone"]),
        ({"older": "old", "old": "new"}, ["older: old has moved; name new"]),
    ],
)
def test_redirects_that_lead_nowhere_are_refused(redirects, lines, found):
    pages = {"new", "other"}
    assert list(redirects.mistakes(lines, pages, lambda page: {"section"})) == found


ROOT = DOCS.parent
WORDS = yaml.safe_load((DOCS / "_ext" / "words.yaml").read_text(encoding="utf-8"))
FENCE = re.compile(r"^(`{3,}|:{3,})(?:\{(\w+)\})?[^\n]*\n(.*?)^\1\s*$", re.MULTILINE | re.DOTALL)
UNWRITTEN = re.compile(  # keys in headings, code, formulas, addresses, and titles of publications
    r"^### \w+$|`[^`]*`|\$[^$]*\$|\]\([^)]*\)|^\(.*\)=$|<!--.*?-->|(?<!\*)\*[^*\n]+\*(?!\*)",
    re.MULTILINE | re.DOTALL,
)


def prose(text):
    """A page without its code; figures and remarks have prose."""
    of_words = ("figure", "note", "tip", "warning")
    text = FENCE.sub(lambda fence: fence[3] if fence[2] in of_words else "", text)
    return UNWRITTEN.sub("]", text).replace("groups, controllers", "")


PAGES = {
    path.relative_to(ROOT).as_posix(): prose(path.read_text(encoding="utf-8"))
    for path in [ROOT / "README.md", *DOCS.rglob("*.md")]
}
HELP = {  # without code, options, and what a command may be given
    path.relative_to(ROOT).as_posix(): re.sub(
        r"`[^`]*`|--[\w-]+|groups, controllers|eqt list controllers", "", text
    )
    for path in (ROOT / "tests" / "cli" / "help").glob("*.txt")
    for text in [re.sub(r"\s*[│\n]\s*", " ", path.read_text(encoding="utf-8"))]
}


@pytest.mark.parametrize("word", WORDS, ids=lambda word: word["but"])
def test_pages_and_help_use_our_words(word):
    """What to write instead stands in `docs/_ext/words.yaml`."""
    assert {*word} == {"not", "but", "because"}
    pattern = re.compile(rf"[^\n.]*\b{word['not']}\b[^\n.]*", re.IGNORECASE)
    found = {
        name: [said[0].strip() for said in pattern.finditer(text)]
        for name, text in (PAGES | HELP).items()
    }
    assert {name: said for name, said in found.items() if said} == {}
