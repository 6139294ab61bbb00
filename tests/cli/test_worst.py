"""`eqt worst` as users see it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

WORST = """\
worst:
  over: {plant.inertia.relative: [-0.1, 0.1]}
  objective: mean_pose_error
  budget: 1
  population: 5
  seeds: 1
"""

Eqt = Callable[..., Any]


@pytest.fixture
def config(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("eqt_cli.tuning.worst.MOST_ON_A_LINE", 2)
    path = folder / "t.yaml"
    path.write_text((folder / "c.yaml").read_text() + WORST, encoding="utf-8")
    return path


@pytest.mark.slow("searches, and draws what it finds")
def test_it_prints_what_was_found_and_draws_it(eqt: Eqt, config: Path) -> None:
    done = eqt("worst", config, "--fail-above", "100")
    told = "at most 42 for the picture along all keys (worst.profile)"
    runs = f"runs     30 (3 runs at each point), and {told}\n"
    assert (done.code, done.err) == (0, runs)
    for line in (
        "The worst run that was found: mean ‖I − Q_E‖",
        "Searched: 1 generation of 5 points, each of 3 runs, for every law, with the seed 0. Worse",
        "results  results/t-worst",
        "next     eqt run results/t-worst/worst/eqt.yaml",
    ):
        assert line in done.out
    assert eqt("plot", "results/t-worst", "--format", "json").code == 0
    assert Path("results/t-worst/figures/worst.json").exists()


@pytest.mark.slow("searches again")
def test_a_law_that_is_worse_than_it_may_be_ends_with_4(eqt: Eqt, config: Path) -> None:
    done = eqt("worst", config, "--json", "--fail-above", "0")
    assert done.code == 4
    found = json.loads(done.out)
    assert found["causes"] == [
        f"{law['label']}: mean_pose_error {law['value']:.4g} is above 0" for law in found["laws"]
    ]
    assert [law["label"] for law in found["laws"]] == ["eqt", "gt"]


def test_config_check_looks_at_the_section(eqt: Eqt, config: Path) -> None:
    assert eqt("config", "check", config).code == 0
    config.write_text(config.read_text().replace("mean_pose_error", "mean_pose"), encoding="utf-8")
    done = eqt("config", "check", config)
    assert done.code == 2
    assert "worst.objective: no metric 'mean_pose' is stored of every run; did you mean" in done.err
