"""Thousands of configurations, results, plugins and commands: each ends as one message, soon.

`make fuzz` tries all of them; `make test-all` a fortieth, `make test` none. A case is made anew by
`python tests/fuzz/session.py configurations SEED SEED+1 FOLDER`, which leaves it in the folder.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mutated_configurations import BASES
from session import MOST_BYTES

from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.runs.run_study import execute

FULL = os.environ.get("EQT_FUZZ") == "full"
CASES = {"configurations": 10_000, "results": 5_000, "plugins": 600, "options": 5_000}
SHARES = 40
"""Of the cases of a kind; each is a process, and without `FULL` the first is all."""

SESSION = Path(__file__).with_name("session.py")


@pytest.fixture(scope="session")
def bases(tmp_path_factory):
    """Results that are as they should be, of every kind of configuration."""
    folder = tmp_path_factory.mktemp("bases")
    found = []
    for index, text in enumerate(BASES):
        config = folder / f"base{index}.yaml"
        config.write_text(text, encoding="utf-8")
        execute(study(read_config(config, ["solver.cross_check=1"])), folder / str(index))
        found.append(folder / str(index) / "results.h5")
    return found


@pytest.mark.ci("tries hundreds of commands")
@pytest.mark.parametrize("share", range(SHARES if FULL else 1))
@pytest.mark.parametrize("kind", CASES)
def test_each_ends_as_one_message(bases, tmp_path, kind, share):
    count = CASES[kind] // SHARES
    words = [kind, str(share * count), str((share + 1) * count), str(tmp_path), *map(str, bases)]
    done = subprocess.run(
        [sys.executable, str(SESSION), *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    *wrong, summary = map(json.loads, done.stdout.splitlines())
    assert not wrong, "\n".join(f"seed {one['seed']}: {one['wrong']}" for one in wrong)
    assert summary["done"] == count
    assert summary["bytes"] < MOST_BYTES
