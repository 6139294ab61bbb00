"""`--point`: one point of a sweep as if it were the result of a single experiment."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from said import says

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base.store_reader import open_results

pytestmark = pytest.mark.usefixtures("unarranged")


RECTANGULAR = ("--grid", "gains.kp=1,2", "--grid", "gains.kd=0.5,1")
ONE_LAW = ("--set", "controllers=[eqt]")
RAGGED = ("--grid", "gains.kp=1,2", "--grid", "time.duration=0.1,0.2", *ONE_LAW)
POINT_3 = {
    RECTANGULAR: ("--set", "gains.kp=2", "--set", "gains.kd=1"),
    RAGGED: ("--set", "gains.kp=2", "--set", "time.duration=0.2", *ONE_LAW),
}
LAST = r"c, kp 2, (kd 1|duration 0\.2)"
"""Title of the last point."""
HOW = "choose one of 0 to 3 with --point, as `eqt show out --table metrics` lists them"


@pytest.fixture(
    params=[RAGGED, pytest.param(RECTANGULAR, marks=pytest.mark.ci("computes another sweep"))],
    ids=["ragged", "rectangular"],
)
def grid(request, eqt):
    """A sweep of four points in the folder `out`."""
    eqt("sweep", "c.yaml", *request.param, "--out", "out", "--quiet")
    chosen = request.param
    return chosen


@pytest.fixture
def alone(eqt, grid):
    """The last point by itself in the folder `alone`; c.yaml keeps its name."""
    assert eqt("run", "c.yaml", *POINT_3[grid], "--quiet", "--out", "alone").code == 0


@pytest.mark.usefixtures("alone")
def test_show(eqt):
    """A sweep's blocks mix points, so that metrics agree within the tolerance of 1e-6 only."""
    shown = eqt("show", "out", "--point", 3)
    assert re.match(rf"{LAST} on SO3  \({Path('out') / 'results.h5'}\)\n", shown.out)
    config, expected = (
        eqt("show", name, "--config", *point).out
        for name, point in (("out", ("--point", 3)), ("alone", ()))
    )
    assert eqt_cli.load_experiment("alone").resolved == _loaded(config)
    assert _loaded(config) == _loaded(expected)
    header, first, *_ = eqt("show", "out", "--point", 3, "--table", "metrics").out.splitlines()
    assert header.startswith("controller,run,status,mean_torque,effort")
    with open_results("alone") as results:
        assert float(first.split(",")[4]) == pytest.approx(results["effort"][0, 0], rel=1e-5)


def _loaded(text):
    Path("again.yaml").write_text(text, encoding="utf-8")
    return eqt_cli.load_experiment("again.yaml").resolved


@pytest.mark.usefixtures("grid")
def test_plot_draws_points_by_themselves_and_side_by_side(eqt):
    done = eqt("plot", "out", "--point", 3, "--figure", "runs", "--format", "svg")
    path = Path("out/figures/point_3/runs.svg")
    assert (done.code, done.out) == (0, f"figure   {path} (-caption.tex)\n")
    done = eqt("plot", "out", "--point", 0, "--point", 3, "--format", "json")
    path = Path("out/figures/point_0_3/summary.json")
    assert (done.code, done.out) == (0, f"figure   {path}\n")
    assert re.search(f"eqt, {LAST}", path.read_text(encoding="utf-8"))


@pytest.mark.usefixtures("grid")
def test_figures_of_single_experiments_ask_for_a_point(refused):
    assert refused("plot", "out", "--figure", "paper") == (
        f"{Path('out/results.h5')}: figure 'paper' shows single experiments, and this is a "
        f"sweep of 4 points; {HOW}\n"
    )


@pytest.mark.usefixtures("grid")
def test_figures_of_sweeps_take_none(refused):
    assert says(
        refused("plot", "out", "--figure", "sweep", "--point", 1),
        f"{Path('out/results.h5')}: figure 'sweep' shows sweeps, and this is…\n",
    )


@pytest.mark.needs("proofs")
def test_verify_a_point_of_a_sweep_that_keeps_metrics_only(eqt):
    """The reference differs between points, and none is stored."""
    words = ("--grid", "inertia=[2,1,3],[1,1,1]", *ONE_LAW)
    eqt("sweep", "c.yaml", *words, "--set", "store.trajectories=none", "--out", "out", "--quiet")
    done = eqt("verify", "out", "--point", 1, "--json")
    document = json.loads(done.out)
    assert (done.code, document["runs"], document["holds"]) == (0, 3, True)


def test_verify_a_point_of_a_configuration(eqt, refused, folder):
    with (folder / "c.yaml").open("a", encoding="utf-8") as file:
        file.write("sweep: [{grid: {ensemble.seed: [1, 2], group: [SO3]}}]\n")
    done = eqt("verify", "c.yaml", "--point", 1, "--json")
    assert (done.code, done.err) == (0, "")
    assert (
        refused("verify", "c.yaml", "--point", 2)
        == "c.yaml: has no point 2; choose one of 0 to 1\n"
    )


@pytest.mark.needs("proofs")
def test_a_configuration_without_a_sweep_has_no_points(refused):
    assert (
        refused("verify", "c.yaml", "--point", 0)
        == "c.yaml: defines no sweep, so it has no points; leave the point out\n"
    )


@pytest.mark.parametrize(
    "command",
    [
        "show",
        pytest.param("plot", marks=pytest.mark.ci("computes an experiment")),
        pytest.param("verify", marks=pytest.mark.ci("computes an experiment")),
    ],
)
def test_points_that_are_not_there(eqt, refused, command):
    eqt("sweep", "c.yaml", *RAGGED, "--out", "out", "--quiet")
    eqt("run", "c.yaml", "--out", "single", "--quiet")
    file = Path("out/results.h5")
    said = f"{file}: has no point 4; choose one of 0 to 3\n"
    assert refused(command, "out", "--point", 4) == said
    assert refused(command, "single", "--point", 0) == (
        f"{Path('single/results.h5')}: is not a sweep; leave the point out\n"
    )


def test_the_summary_of_a_sweep_over_durations_names_none(eqt):
    eqt("sweep", "c.yaml", *RAGGED, "--out", "out", "--quiet")
    shown = eqt("show", "out").out
    assert re.search(r"^  EqT +best +\d", shown, re.M) and "mean ‖τ‖, N m\n" in shown


@pytest.mark.usefixtures("untimed")
def test_dry_run_tells_the_size_of_all_files(eqt):
    eqt("sweep", "c.yaml", *RAGGED, "--out", "out", "--quiet")
    expected = json.loads(eqt("sweep", "c.yaml", *RAGGED, "--dry-run", "--json").out)
    size = sum(file.stat().st_size for file in Path("out").rglob("*.h5"))
    # The rest of the files is structure, attributes and coordinates.
    assert expected["bytes"] < size < expected["bytes"] + 3 * 60_000


@pytest.mark.usefixtures("grid")
def test_python_opens_one_point():
    pytest.importorskip("xarray")
    with open_at("out", point=3) as arrays:
        efforts, times = arrays["effort"], arrays["time"]
        title = arrays.attributes["title"]
    with eqt_cli.open_result("out", point=3).to_xarray() as dataset:
        assert dataset.pose.dims == ("controller", "run", "time", "row", "col")
        np.testing.assert_array_equal(dataset.effort, efforts)
        np.testing.assert_array_equal(dataset.time, times)
        assert dataset.attrs["title"] == title
        assert re.fullmatch(LAST, title)
    found = eqt_cli.compare("out", ["effort"], point=3, resamples=9)
    assert found.levels[0].mean == pytest.approx(efforts[0].mean(), rel=1e-12)


def test_two_whole_sweeps_are_not_compared(eqt, refused):
    eqt("sweep", "c.yaml", *RAGGED, "--out", "out", "--quiet")
    assert refused("compare", "out", "out") == (
        f"{Path('out/results.h5')}: controllers are compared within one experiment, and this "
        f"is a sweep of 4 points; {HOW}\n"
    )
