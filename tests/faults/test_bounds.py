"""Time and memory of `config check` have a bound, whatever is in the file; the docs state it."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not find_spec("resource"), reason="cannot measure a process")

MOST_SECONDS, MOST_BYTES, MOST_LINES = 20.0, 500e6, 102
DOCS = Path(__file__).parents[2] / "docs/reference/configuration.md"
# By a small process: Linux counts the memory of the process that forks one with it.
MEASURED = """
import json, resource, subprocess, sys
done = subprocess.run([sys.executable, *sys.argv[1:]], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([done.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024]))
"""
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


@pytest.mark.ci("as large as files may be, each in a process that is measured")
@pytest.mark.parametrize("case", FILES)
def test_a_check_is_bounded(tmp_path, case):
    config = tmp_path / "c.yaml"
    config.write_text(FILES[case], encoding="utf-8")
    words = [sys.executable, "-c", MEASURED, "-m", "eqt_cli", "config", "check", str(config)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    (code, seconds, size), told = json.loads(done.stdout), done.stderr
    assert code in (0, 2), told
    assert "Traceback" not in told
    assert seconds < MOST_SECONDS
    assert size < MOST_BYTES
    assert told.count("\n") <= MOST_LINES


def test_the_docs_state_the_bound():
    text = DOCS.read_text(encoding="utf-8")
    assert f"{MOST_SECONDS:.0f} s of one core and {MOST_BYTES / 1e6:.0f} MB" in text
