"""`eqt report` and `eqt animate`: plugins, points of sweeps, and results that lack something."""

import re
from pathlib import Path

import pytest
from said import says

from eqt_cli.extensions.report.document import report
from eqt_cli.results.result import open_result

pytestmark = pytest.mark.usefixtures("unarranged")

GROUP = """\
from eqt_cli.components.matrix_groups import SO3

class Twin(SO3):
    name = "Twin"
"""


@pytest.fixture
def twin(eqt, config):
    """A result on a group of a plugin, which is then forgotten."""
    Path("twin.py").write_text(GROUP)
    twin = ("--set", "plugins=[twin.py]", "--set", "group=Twin", "--set", "controllers=[eqt]")
    assert eqt("run", config, *twin).code == 0


@pytest.mark.usefixtures("twin")
def test_a_group_of_a_plugin_must_be_trusted(eqt, refused, forget_plugins):
    forget_plugins()
    said = refused("animate", "results/c")
    assert said.startswith("unknown group 'Twin'")
    assert said.endswith(
        "; the result holds plugins, which are executed only on request; read them with "
        "`eqt show --plugins`, then add --trust-plugins\n"
    )
    assert eqt("animate", "results/c", "--seconds", 0.2, "--trust-plugins").code == 0


@pytest.mark.ci("draws a report")
@pytest.mark.usefixtures("twin")
def test_a_report_without_certificates_says_so(eqt, forget_plugins):
    forget_plugins()
    done = eqt("report", "results/c", "--figure", "paper")
    assert done.code == 0
    said = "eqt: warning: the page has no certificates; the result could not be verified: "
    assert done.err.startswith(said)
    assert said not in eqt("report", "results/c", "--figure", "paper", "--trust-plugins").err


@pytest.mark.ci("draws a report")
@pytest.mark.parametrize("key", ["gains.kd=0.5,1", "time.duration=0.1,0.2"])
def test_a_point_of_a_sweep_is_shown_as_an_experiment(eqt, refused, config, key):
    grid = ("--grid", "gains.kp=1,2", "--grid", key, "--set", "controllers=[eqt]")
    eqt("sweep", config, *grid, "--out", "out", "--quiet")
    folder = Path("out/figures/point_3")
    done = eqt("report", "out", "--point", 3, "--figure", "paper")
    assert done.out.startswith(f"report   {folder / 'report.html'}  (")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert re.search(r"c, kp 2, (kd 1|duration 0\.2)", page)
    assert "could not be verified" not in page
    done = eqt("animate", "out", "--point", 3, "--seconds", 0.2)
    assert done.out.startswith(f"animation  {folder / 'run0.gif'}  (")
    assert says(
        refused("animate", "out"),
        f"{Path('out/results.h5')}: figure 'animation' shows single experiments…\n",
    )


def test_animate_writes_a_gif(invoke, paper_result, tmp_path):
    brief = ["--run", 2, "--seconds", 0.2, "--controller", "gt", "--out", tmp_path]
    done, file = invoke("animate", paper_result, *brief), tmp_path / "run2.gif"
    assert done.stdout.split()[1] == str(file)
    assert file.read_bytes().startswith(b"GIF89a")


def test_a_report_takes_one_result(refused):
    assert says(refused("report", "a", "b", "c"), "report takes one result…\n")


@pytest.mark.ci("runs another experiment")
def test_claims_about_the_ideal_loop_are_not_on_the_page_of_another(eqt, config):
    eqt("run", config, "--set", "control.period=0.25", "--quiet")
    with open_result("results/c") as result:
        page = report(result, wanted=())
    assert "claims of Hampsey" not in page and 'id="claims"' not in page


@pytest.mark.ci("another run that fails is fast")
def test_the_page_of_runs_that_all_failed(eqt, config):
    assert eqt("run", config, "--set", "solver.max_steps=20", "--quiet").code == 3
    assert eqt("report", "results/c").code == 0
    page = Path("results/c/report.html").read_text(encoding="utf-8")
    assert "figure &#39;summary&#39; has nothing to show, since every run failed" in page
