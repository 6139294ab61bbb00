"""`eqt docs`, without opening a browser."""

import json
from pathlib import Path

import pytest

from eqt_cli.cli import lookup


@pytest.fixture
def opened(monkeypatch, tmp_path):
    """The addresses that were opened, in a checkout without pages and without an online home."""
    addresses = []
    monkeypatch.setattr(lookup.webbrowser, "open", lambda url: addresses.append(url) or True)
    monkeypatch.setattr(lookup, "CHECKOUT", tmp_path)
    monkeypatch.setattr(lookup, "metadata", lambda name: Described())
    return addresses


class Described:
    """The description of a distribution."""

    urls = ()

    def get_all(self, name):
        return list(self.urls) if name == "Project-URL" else None


@pytest.fixture
def built(tmp_path):
    page = tmp_path / "build" / "docs" / "index.html"
    page.parent.mkdir(parents=True)
    page.touch()
    return page.as_uri()


def test_built_pages_are_opened(invoke, opened, built):
    assert invoke("docs").stdout == f"{built}\n"
    assert opened == [built]


def test_pages_online_are_opened_where_none_are_built(invoke, opened, monkeypatch):
    urls = ("Paper, https://example.org/paper", "Documentation, https://example.org/eqt/")
    monkeypatch.setattr(Described, "urls", urls)
    invoke("docs")
    assert opened == ["https://example.org/eqt/"]


@pytest.mark.parametrize("option", ["--address", "--json"])
def test_the_address_can_be_asked_for(invoke, opened, built, option):
    said = invoke("docs", option).stdout
    assert (json.loads(said)["documentation"] if option == "--json" else said.strip()) == built
    assert opened == []


def test_without_a_browser_the_address_is_said(invoke, opened, built, monkeypatch):
    monkeypatch.setattr(lookup.webbrowser, "open", lambda url: False)
    done = invoke("docs")
    assert done.stderr == "no browser could be opened; the documentation is at:\n"
    assert done.stdout == f"{built}\n"


def test_pages_that_are_not_built_can_be(invoke, opened, tmp_path):
    text = tmp_path / "docs" / "index.md"
    text.parent.mkdir()
    text.touch()
    done = invoke("docs", code=2)
    assert f"the documentation is not built; run make docs, or read {text}" in done.stderr
    assert opened == []


def test_pages_that_are_nowhere(invoke, opened):
    said = invoke("docs", code=2).stderr
    assert "the documentation is not installed; it is in the folder docs of the eqt repo" in said


def test_the_folder_that_is_looked_in_is_the_checkout():
    assert (lookup.CHECKOUT / "eqt_cli").samefile(Path(lookup.__file__).parents[1])
