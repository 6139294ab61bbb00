"""The bound on the time of the processor that a test may take."""

import sys

import pytest

BURN = """
import time, pytest

def burn(seconds=0.2):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
"""


@pytest.fixture
def outcomes(pytester):
    """Runs tests with a bound of 0.1 s, and says what becomes of each, and why."""

    def run(text, slowness=1.0):
        pytester.makepyfile(BURN + text)
        pytester.makeini("[pytest]\nmarkers = slow(reason): takes long\n")
        judge = sys.modules["processor_time"].ProcessorTime(0.1, lambda: slowness)
        ran = pytester.inline_run("-p", "no:cacheprovider", "-p", "no:xdist", plugins=[judge])
        reports = [r for r in ran.getreports("pytest_runtest_logreport") if r.when == "call"]
        return {r.location[2]: (r.outcome, str(r.longrepr or "")) for r in reports}

    return run


def test_a_test_that_takes_long_fails_unless_it_is_marked(outcomes):
    found = outcomes("""
def test_short(): pass
def test_long(): burn()
def test_asleep(): time.sleep(0.2)
@pytest.mark.slow("for a reason")
def test_marked(): burn()
""")
    assert [found[f"test_{name}"][0] for name in ("short", "long", "asleep", "marked")] == [
        *("passed", "failed", "passed", "passed")
    ]
    text = found["test_long"][1]
    assert text.endswith(
        " s on a fast machine; expected at most 0.1 s. Let it do less, or mark it "
        '@pytest.mark.slow("why it must be")'
    )
    assert "::test_long takes 0.2 s of the processor here, 0.2" in text


def test_children_count(outcomes):
    found = outcomes("""
import subprocess, sys
def test_child(): subprocess.run([sys.executable, "-c", "for k in range(10**7): pass"])
""")
    assert found["test_child"][0] == "failed"


def test_what_several_tests_need_is_not_the_first_ones(outcomes):
    found = outcomes("""
@pytest.fixture(scope="module")
def shared(): burn()
@pytest.fixture
def own(): burn()
def test_shared(shared): pass
def test_shared_when_it_is_needed(request): request.getfixturevalue("shared")
def test_own(own): pass
""")
    assert {name: outcome for name, (outcome, _) in found.items()} == {
        "test_shared": "passed",
        "test_shared_when_it_is_needed": "passed",
        "test_own": "failed",
    }


def test_a_slow_core_is_allowed_for(outcomes):
    assert outcomes("def test_long(): burn()", slowness=9.0)["test_long"][0] == "passed"


@pytest.mark.parametrize("reason", ["", '("")', "(reason='long')", "(3)"])
def test_a_slow_test_says_why(pytester, reason):
    pytester.makepyfile(f"import pytest\n@pytest.mark.slow{reason}\ndef test_long(): pass\n")
    pytester.makeini("[pytest]\nmarkers = slow(reason): takes long\n")
    items, _ = pytester.inline_genitems()
    found = sys.modules["processor_time"].unexplained(items)
    assert [name.partition("::")[2] for name in found] == ["test_long"]
