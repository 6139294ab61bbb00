"""Tables on terminals that are narrower than they are."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from eqt_cli.cli.shared.output import columns, room, table

HEADER = ["controller", "mean ‖τ‖ 0-5 s", "remark"]
ROWS = [["eqt", "1.830", "holds"], ["stabilising", "-", "a sentence that is rather long"]]


def laid_out(width: int | None) -> list[str]:
    head, body = columns(HEADER, ROWS, width)
    return "\n".join([*head, *body]).splitlines()


def test_a_table_that_fits_is_left_alone() -> None:
    assert laid_out(None) == laid_out(59)
    assert laid_out(None) == [
        "controller   mean ‖τ‖ 0-5 s  remark",
        "───────────  ──────────────  ──────────────────────────────",
        "eqt                   1.830  holds",
        "stabilising               -  a sentence that is rather long",
    ]


def test_headings_are_folded_first() -> None:
    assert laid_out(58) == [
        "              mean",
        "               ‖τ‖",
        "controller   0-5 s  remark",
        "───────────  ─────  ──────────────────────────────",
        "eqt          1.830  holds",
        "stabilising      -  a sentence that is rather long",
    ]


def test_then_the_last_column_is_wrapped() -> None:
    assert laid_out(46) == [
        "              mean",
        "               ‖τ‖",
        "controller   0-5 s  remark",
        "───────────  ─────  ──────────────────────────",
        "eqt          1.830  holds",
        "stabilising      -  a sentence that is rather",
        "                    long",
    ]


def test_numbers_are_never_cut() -> None:
    assert any("1.830" in line for line in laid_out(10))
    assert columns(["a"], [["1.234567"]], 4) == (["       a", "────────"], ["1.234567"])


@pytest.mark.parametrize(("terminal", "expected"), [(True, 40), (False, None)])
def test_only_terminals_have_a_width(
    monkeypatch: pytest.MonkeyPatch, terminal: bool, expected: int | None
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(isatty=lambda: terminal))
    assert room() == expected
    assert (max(map(len, table(HEADER, ROWS).splitlines())) > 50) is (not terminal)
