"""Time and memory of `config check` have a bound, whatever is in the file; the docs state it."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "wait4"), reason="cannot measure a process")

MOST_SECONDS, MOST_BYTES, MOST_LINES = 10.0, 500e6, 102
DOCS = Path(__file__).parents[2] / "docs/reference/configuration.md"
CONFIG = """\
group: SO3
inertia: 1
gains: {kp: 1, kd: 1}
reference: {torque: [TORQUE, 0, 0]}
controllers: [eqt]
time: {duration: 1, samples: 3}
"""
PLAIN = CONFIG.replace("TORQUE", "0")
FILES = {
    "unknown sections": PLAIN + "".join(f"k{i}: 1\n" for i in range(49_000)),
    "unknown keys": PLAIN + f"ensemble: {{{', '.join(f'k{i}: 1' for i in range(49_000))}}}\n",
    "duplicate keys": PLAIN + "x: 1\n" * 49_000,
    "anchors": PLAIN
    + "x0: &x0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    + "".join(f"x{i + 1}: &x{i + 1} [*x{i}, *x{i}, *x{i}]\n" for i in range(60)),
    "a million entries": PLAIN + f"plugins: [{','.join(['a'] * 1_000_000)}]\n",
    "many entries": PLAIN + f"plugins: [{','.join(['a'] * 90_000)}]\n",
    "a long sum": CONFIG.replace("TORQUE", f'"{"+".join(["sin(t)"] * 1400)}"'),
    "a long product": CONFIG.replace("TORQUE", f'"{"*".join(["t"] * 5000)}"'),
}


@pytest.mark.parametrize("case", FILES)
def test_a_check_is_bounded(tmp_path, case):
    config = tmp_path / "c.yaml"
    config.write_text(FILES[case], encoding="utf-8")
    words = [sys.executable, "-m", "eqt_cli", "config", "check", str(config)]
    with tempfile.TemporaryFile("w+", encoding="utf-8") as said:
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        told = said.read()
    assert process.returncode in (0, 2), told
    assert "Traceback" not in told
    assert used.ru_utime + used.ru_stime < MOST_SECONDS
    assert used.ru_maxrss * 1024 < MOST_BYTES
    assert told.count("\n") <= MOST_LINES


def test_the_docs_state_the_bound():
    text = DOCS.read_text(encoding="utf-8")
    assert f"{MOST_SECONDS:.0f} s of one core and {MOST_BYTES / 1e6:.0f} MB" in text
