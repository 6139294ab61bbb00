"""The short paper and the errata say what the documentation says."""

import re
import runpy
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "paper"
PAPER = (FOLDER / "paper.md").read_text(encoding="utf-8")
BODY = PAPER.partition("# Summary")[2].partition("# References")[0]


def test_the_errata_are_those_of_the_documentation():
    errata = runpy.run_path(str(FOLDER / "errata.py"))["errata"]()
    stored = (FOLDER / "errata.md").read_text(encoding="utf-8")
    assert stored == errata, "run python docs/paper/errata.py --pdf"
    assert "](" not in errata and errata.count("\n- ") == 13


def test_the_errata_are_one_page_of_us_letter():
    text = (FOLDER / "errata.pdf").read_bytes()
    assert re.findall(rb"/MediaBox ?\[0 0 612 792\]", text) and re.findall(rb"/Count 1\b", text)


def test_the_paper_has_the_form_of_its_journal():
    header = yaml.safe_load(PAPER.split("---\n")[1])
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= header.keys()
    assert 900 <= len(BODY.split()) <= 1100
    keys = set(re.findall(r"@(\w+\d{4}|drake)", BODY))
    entries = (FOLDER / header["bibliography"]).read_text(encoding="utf-8")
    assert keys == set(re.findall(r"^@\w+\{(\w+),", entries, re.MULTILINE))
    figures = re.findall(r"\]\((\S+\.png)\)", BODY)
    assert len(figures) == 2 == BODY.count("\\autoref{fig:")
    assert all((FOLDER / figure).exists() for figure in figures)


@pytest.mark.parametrize(
    ("number", "page"),
    [
        ("more than 70 % of the error of every law", "experiments/tuned"),
        ("8.5 % less", "experiments/tuned"),
        ("5.5", "explanation/paper"),
        ("13.1 %", "explanation/paper"),
        ("with 24 other", "explanation/paper"),
        ("eight", "explanation/public_laws"),
        ("ten cases", "explanation/public_laws"),
        ("1,400", "../README"),
        ("6e-9", "../README"),
        ("three of", "explanation/paper"),
    ],
)
def test_a_number_stands_in_the_documentation(number, page):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert number in " ".join(BODY.split())
    assert number.removeprefix("with ").removesuffix(" other") in " ".join(text.split())
