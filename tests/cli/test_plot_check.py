"""`eqt plot --check`, within this process: what it prints, and how it ends."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.usefixtures("unarranged")

Eqt = Callable[..., Any]


@pytest.fixture
def kept(prepare: Callable[..., None], folder: Path) -> Path:
    """The numbers of a result, and the result of kd 1 % larger beside it."""
    prepare(
        ("run", "c.yaml", "--out", "one"),
        ("run", "c.yaml", "--set", "gains.kd=0.505", "--out", "two"),
        ("plot", "one", "--format", "json", "--out", "kept"),
    )
    return folder / "kept"


def test_equal_numbers_agree(eqt: Eqt, kept: Path) -> None:
    done = eqt("plot", "one", "--check", kept)
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("figure 'paper': agrees; 8 curves, largest difference ")
    assert not Path("one/figures").exists()


def test_other_numbers_end_with_exit_code_4(eqt: Eqt, kept: Path) -> None:
    done = eqt("plot", "two", "--check", kept)
    assert (done.code, done.err) == (4, "")
    *differences, last = done.out.splitlines()
    assert differences[0].startswith("figure 'paper', panel 'pose_error', curve 'eqt': ")
    assert last.startswith("figure 'paper': differs; 8 curves, ")


def test_the_same_as_json(eqt: Eqt, kept: Path) -> None:
    done = eqt("plot", "two", "--check", kept, "--json")
    assert done.code == 4
    document = json.loads(done.out)
    assert document["tolerance"] == 1e-6
    assert document["figures"]["paper"]["curves"] == 8
    assert document["figures"]["paper"]["differences"]


@pytest.mark.parametrize("more", [["--format", "pdf"], ["--style", "bmh"], ["--tex"]])
def test_check_draws_nothing(eqt: Eqt, kept: Path, more: list[str]) -> None:
    done = eqt("plot", "one", "--check", kept, *more)
    assert (done.code, done.out) == (2, "")
    assert (
        "--check draws nothing; leave --format, --style, --tex, --title, --caption and --out out"
        in done.err
    )
