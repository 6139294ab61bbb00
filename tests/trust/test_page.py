"""Every line of the tables on trust names a test that exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/explanation/trust.md"
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def rows():
    """The rows of all tables, without their headings."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    inside = [line for line in lines if line.startswith("|")]
    return [
        line
        for before, line in zip(["", *inside], inside, strict=False)
        if not line.startswith("|---") and not line.endswith("| shown by |") and before
    ]


def test_the_page_has_rows():
    assert len(rows()) > 25


@pytest.mark.parametrize("row", rows(), ids=range(len(rows())))
def test_every_row_names_a_test(row):
    *_, last = row.strip("|").split("|")
    found = TEST.fullmatch(last.strip())
    assert found, row
    tree = ast.parse((ROOT / found[1]).read_text(encoding="utf-8"))
    tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert found[2] in tests, row


def test_the_pages_that_speak_of_files_from_others_link_to_it():
    for page in ("howto/results.md", "howto/plugins.md"):
        assert "explanation/trust.md" in (ROOT / "docs" / page).read_text(encoding="utf-8")


def test_the_page_states_the_bounds():
    from eqt_cli.base.files import RECORD_BYTES, TEXT_BYTES
    from eqt_cli.base.yaml_source import MAX_BYTES
    from eqt_cli.config.source import DATA_BYTES
    from eqt_cli.engines.compiler import PREPROCESSOR, SECONDS, Limits
    from eqt_cli.extensions.recordings.api import LOG_BYTES

    text = PAGE.read_text(encoding="utf-8")
    assert TEXT_BYTES == MAX_BYTES
    assert f"more than {TEXT_BYTES / 1e6:.0f} MB" in text
    assert f"at most {DATA_BYTES / 1e6:.0f} MB" in text
    assert f"at most {LOG_BYTES / 1e6:.0f} MB" in text
    assert f"more than {RECORD_BYTES / 2**20:.0f} MiB" in text
    gib, mib = 2**30, 2**20
    by, own = PREPROCESSOR, Limits(SECONDS)
    told = f"more than {by.seconds:.0f} s, {by.memory // gib} GiB of memory or {by.file // mib} MiB"
    assert told in text
    told = (
        f"{own.seconds:.0f} s, {own.memory // gib} GiB of memory and files of {own.file // mib} MiB"
    )
    assert told in text
