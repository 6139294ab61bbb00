"""The bound on the time of the processor that a test may take."""

from pathlib import Path

import pytest

TESTS = """
import time, pytest

def burn():
    end = time.process_time() + 0.12
    while time.process_time() < end:
        pass

@pytest.fixture
def shared(): burn()

def test_short(): pass
def test_long(): burn()
def test_asleep(): time.sleep(0.12)
def test_shared(shared): pass
@pytest.mark.ci("for a reason")
def test_marked(): burn()
"""


@pytest.fixture
def conftest(request):
    """The module of tests/conftest.py."""
    plugins = request.config.pluginmanager.get_plugins()
    here = str(Path(__file__).with_name("conftest.py"))
    return next(each for each in plugins if getattr(each, "__file__", "") == here)


def test_a_test_that_takes_long_fails_unless_it_is_marked(pytester, conftest):
    pytester.makepyfile(TESTS)
    pytester.makeini("[pytest]\nmarkers = ci(reason): takes long\n")
    options = "-p", "no:cacheprovider", "-p", "no:xdist"
    ran = pytester.inline_run(*options, plugins=[conftest.ProcessorTime(0.08)])
    _, _, failed = ran.listoutcomes()
    assert [report.location[2] for report in failed] == ["test_long"]
    assert (
        str(failed[0].longrepr)
        .rstrip()
        .endswith(
            " s of the processor; expected at most 0.08 s. Let it do less, or mark it "
            '@pytest.mark.ci("why it must be")'
        )
    )


@pytest.mark.parametrize("reason", ["", '("")', "(reason='long')"])
def test_a_slow_test_says_why(pytester, conftest, reason):
    pytester.makepyfile(f"import pytest\n@pytest.mark.ci{reason}\ndef test_long(): pass\n")
    pytester.makeini("[pytest]\nmarkers = ci(reason): takes long\n")
    items, _ = pytester.inline_genitems()
    with pytest.raises(pytest.UsageError, match="expected a reason"):
        conftest.pytest_collection_modifyitems(items)
