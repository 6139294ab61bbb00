"""The mechanics of the documentation's site, without building it."""

import sys
from pathlib import Path

import pytest

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
