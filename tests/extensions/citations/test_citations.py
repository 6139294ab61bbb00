"""What to cite: the paper and eqt as in CITATION.cff, and what the laws of a result are after."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

import eqt_cli
from eqt_cli.components.laws import controllers
from eqt_cli.extensions.citations.citations import PAPER, PROGRAM, citations
from eqt_cli.results.result import Result

CITATION = yaml.safe_load((Path(__file__).parents[3] / "CITATION.cff").read_text(encoding="utf-8"))


def plain(entry: str) -> str:
    """An entry in one line, without the braces that keep capital letters."""
    return " ".join(entry.replace("{Lie}", "Lie").split())


def test_the_paper_and_the_program_are_those_of_the_citation_file() -> None:
    paper = CITATION["preferred-citation"]
    authors = " and ".join(
        f"{x.get('name-particle', '')} {x['family-names']}, {x['given-names']}".strip()
        for x in paper["authors"]
    )
    for value in (authors, paper["title"], paper["year"], paper["doi"]):
        assert f"= {{{value}}}" in plain(PAPER)
    assert f"title = {{{CITATION['title']}}}" in plain(PROGRAM)
    assert f"author = {{{{{CITATION['authors'][0]['name']}}}}}" in plain(PROGRAM)
    assert f"version = {{{CITATION['version']}}}" in plain(PROGRAM)


def test_laws_bring_their_own_entries_once() -> None:
    entries, unknown = citations(["eqt", "lee2010", "lee2010", "theirs"])
    assert entries == [PAPER, PROGRAM, controllers.get("lee2010").bibtex]
    assert unknown == ["theirs"]


def test_a_result_is_cited_by_its_kinds(
    monkeypatch: pytest.MonkeyPatch, paper_result: Path, invoke: Any, told: Any
) -> None:
    assert eqt_cli.cite(paper_result).split("\n\n") == [
        PAPER,
        PROGRAM,
        controllers.get("gt").bibtex,
    ]
    assert invoke("cite", paper_result).stdout == eqt_cli.cite(paper_result) + "\n"
    assert json.loads(invoke("cite", "--json").stdout) == {"bibtex": [PAPER, PROGRAM]}
    monkeypatch.setattr(Result, "kinds", {"mine": "theirs"})
    assert eqt_cli.cite(paper_result).split("\n\n") == [PAPER, PROGRAM]
    assert told.remarks == ["theirs: of a plugin, without an entry here; cite the source yourself"]
