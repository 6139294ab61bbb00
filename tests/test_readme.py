"""Every command and snippet of the README works as it stands."""

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"```(sh|python)\n(.*?)```", re.DOTALL)
SMALL = ["--set", "ensemble.runs=2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A checkout as a new user has it, without results."""
    copy = tmp_path_factory.mktemp("checkout")
    for name in ("configs", "examples"):
        shutil.copytree(ROOT / name, copy / name)
    return copy


def command(line):
    words = line.split()
    if "taylor" in words and find_spec("heyoka") is None:
        return None
    if words[1] in ("run", "sweep") and not words[2].endswith(".h5"):
        words += SMALL  # what is tested is that the command works, not how long it takes
    return [sys.executable, "-m", "eqt_cli", *words[1:]]


def test_commands_and_snippets(folder):
    blocks = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(blocks) > 5
    for language, text in blocks:
        if language == "python":
            steps = [[sys.executable, "-c", text]] if find_spec("xarray") else []
        else:
            steps = [command(line) for line in text.splitlines() if line.strip()]
        for step in filter(None, steps):
            done = subprocess.run(step, cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{step}\n{done.stdout}\n{done.stderr}"


def test_files_it_points_to_exist():
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", (ROOT / "README.md").read_text("utf-8"))
    assert links
    for link in links:
        assert (ROOT / link).exists(), link
