"""The notebooks work as they stand, and their stored output is what they show."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from notebooks import NOTEBOOKS, executed, text_of

ROOT = Path(__file__).parents[1]
NUMBER = r"\d+(?:\.\d+)?(?:e[-+]\d+)?"


def cells(path):
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_with_its_output(path):
    assert path.stat().st_size <= 300_000
    outputs = [output for cell in cells(path) for output in cell.get("outputs", [])]
    assert [output["output_type"] for output in outputs if output["output_type"] == "error"] == []
    assert any("image/png" in output.get("data", {}) for output in outputs)


def test_the_paper_has_ten_cells():
    (path,) = [path for path in NOTEBOOKS if path.stem == "paper"]
    assert sum(cell["cell_type"] == "code" for cell in cells(path)) == 10


def test_binder_installs_the_checkout():
    wanted = (ROOT / ".binder" / "requirements.txt").read_text(encoding="utf-8").splitlines()
    assert [line for line in wanted if not line.startswith("#")] == [".[xarray]"]


@pytest.mark.ci("executes a notebook in a kernel")
@pytest.mark.filterwarnings("default")  # of the kernel's libraries
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_is_stored(path, tmp_path, monkeypatch):
    pytest.importorskip("nbclient", reason="needs nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="needs nbclient and ipykernel")
    pytest.importorskip("xarray", reason="needs the extra xarray")
    monkeypatch.setitem(os.environ, "EQT_ENGINE", "solve_ivp")
    shown, stored = text_of(executed(path, tmp_path)[0]), text_of(cells(path))
    assert len(shown) == len(stored)
    for new, old in zip(shown, stored, strict=True):
        new, old = (re.sub(r"native|solve_ivp", "ENGINE", text) for text in (new, old))
        assert re.sub(NUMBER, "#", new).split() == re.sub(NUMBER, "#", old).split()
        # Two engines at rtol 1e-9, and the last digit of what is printed.
        numbers = [np.array(re.findall(NUMBER, text), dtype=float) for text in (new, old)]
        np.testing.assert_allclose(*numbers, rtol=0.02, atol=0.02)
