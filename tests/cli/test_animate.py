"""`eqt animate`: what it says before it draws."""

from pathlib import Path

import pytest

GROUP = """\
from eqt_cli.groups.so3 import SO3

class Twin(SO3):
    name = "Twin"
"""


@pytest.fixture
def twin(eqt, folder):
    """A result on a group of a plugin, which is then forgotten."""
    Path("twin.py").write_text(GROUP)
    twin = ("--set", "plugins=[twin.py]", "--set", "group=Twin", "--set", "controllers=[eqt]")
    assert eqt("run", "c.yaml", *twin).code == 0


@pytest.mark.usefixtures("twin")
def test_a_group_of_a_plugin_must_be_trusted(eqt, forget_plugins):
    forget_plugins()
    done = eqt("animate", "results/c", "--format", "html")
    assert done.code == 2
    assert done.err.startswith("eqt: unknown group 'Twin'")
    assert done.err.endswith(
        "; the result holds plugins, which are executed only on request; read them with "
        "`eqt show --plugins`, then add --trust-plugins\n"
    )
    assert eqt("animate", "results/c", "--format", "html", "--trust-plugins").code == 0


@pytest.mark.slow("draws a report")
@pytest.mark.usefixtures("twin", "unarranged")
def test_a_report_without_certificates_says_so(eqt, forget_plugins):
    forget_plugins()
    done = eqt("report", "results/c", "--figure", "paper")
    assert done.code == 0
    said = "eqt: the page has no certificates; the result could not be verified: "
    assert done.err.startswith(said)
    assert said not in eqt("report", "results/c", "--figure", "paper", "--trust-plugins").err
