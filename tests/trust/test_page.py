"""Every row of the tables on trust has tests that exist."""

import ast
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/explanation/trust.md"
PROMISES = yaml.safe_load(Path(__file__).with_name("promises.yaml").read_text(encoding="utf-8"))
TEST = re.compile(r"(tests/[\w/]+\.py)::(test_\w+)")


def rows():
    """The first cells of all tables, without their headings."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    inside = [line for line in lines if line.startswith("|")]
    after = [*inside[1:], ""]
    return [
        line.strip("|").split("|")[0].strip()
        for line, following in zip(inside, after, strict=True)
        if not line.startswith("|---") and not following.startswith("|---")
    ]


def test_every_row_has_tests():
    assert rows() == [*PROMISES]
    assert len(PROMISES) > 20


@pytest.mark.parametrize("row", PROMISES)
def test_every_promise_names_tests(row):
    assert PROMISES[row]
    for name in PROMISES[row]:
        found = TEST.fullmatch(name)
        assert found, name
        tree = ast.parse((ROOT / found[1]).read_text(encoding="utf-8"))
        tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert found[2] in tests, name


def test_the_pages_that_speak_of_files_from_others_link_to_it():
    for page in ("howto/results.md", "howto/plugins.md"):
        assert "explanation/trust.md" in (ROOT / "docs" / page).read_text(encoding="utf-8")


@pytest.mark.needs("logs")
def test_the_page_states_the_bounds():
    from eqt_cli.base.files import RECORD_BYTES, TEXT_BYTES
    from eqt_cli.base.yaml_source import MAX_BYTES
    from eqt_cli.config.document import DATA_BYTES
    from eqt_cli.engines.compiler import PREPROCESSOR, SECONDS, Limits
    from eqt_cli.extensions.logs import logs

    text = PAGE.read_text(encoding="utf-8")
    assert TEXT_BYTES == MAX_BYTES
    assert f"more than {TEXT_BYTES / 1e6:.0f} MB" in text
    assert f"at most {DATA_BYTES / 1e6:.0f} MB" in text
    assert f"at most {logs.MAX_BYTES / 1e6:.0f} MB" in text
    assert f"more than {RECORD_BYTES / 2**20:.0f} MiB" in text
    gib, mib = 2**30, 2**20
    by, own = PREPROCESSOR, Limits(SECONDS)
    told = f"more than {by.seconds:.0f} s, {by.memory // gib} GiB of memory or {by.file // mib} MiB"
    assert told in text
    told = (
        f"{own.seconds:.0f} s, {own.memory // gib} GiB of memory and files of {own.file // mib} MiB"
    )
    assert told in text
