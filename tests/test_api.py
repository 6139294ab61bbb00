"""The Python interface: what notebooks and scripts call."""

import doctest
import inspect
import re
import shutil
import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest
from matplotlib.figure import Figure
from said import error_of

import eqt_cli
from eqt_cli.api import loading
from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import ConfigError, EqtError, ResultError
from eqt_cli.config.remarks import remarks
from eqt_cli.extensions.proofs import verification

pytestmark = pytest.mark.usefixtures("unarranged")

ROOT = Path(__file__).parents[1]
PAPER = ROOT / "configs" / "paper.yaml"
FEW = {"ensemble.runs": 3, "time.duration": 1.0, "time.samples": 5, "solver.cross_check": 0}
needs_xarray = pytest.mark.skipif(
    find_spec("xarray") is None or find_spec("h5netcdf") is None, reason="needs the extra xarray"
)


@pytest.fixture(scope="session")
def computed(made_once):
    """The folder of a small result, to be read only."""
    experiment = eqt_cli.load_experiment(PAPER, FEW)
    return made_once("api", lambda folder: eqt_cli.run(experiment, folder / "result")) / "result"


@pytest.fixture
def result(computed, tmp_path):
    """The same result in a folder of the test's own."""
    shutil.copytree(computed, tmp_path / "result")
    return eqt_cli.run(eqt_cli.load_experiment(PAPER, FEW), tmp_path / "result")


def test_importing_eqt_loads_nothing_and_functions_no_scipy_until_they_compute():
    code = """import sys, eqt_cli; print(*(name for name in sys.modules if 'eqt_cli' in name))
from eqt_cli import api; api.open_result; print('eqt_cli.extensions.search.search' in sys.modules)
from eqt_cli.api import *; print('scipy' in sys.modules)"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "eqt_cli\nFalse\nFalse\n"


def test_a_stranger_sees_the_names_that_stay():
    functions = "load_experiment run sweep tune worst open_result compare plot report verify"
    names = [*functions.split(), "margins", "export", "__version__"]
    assert dir(eqt_cli) == sorted(names)
    assert eqt_cli.__all__ == names


def test_the_stub_has_the_modules_of_the_table():
    stub = Path(eqt_cli.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    stable = re.findall(r"^from (\S+) import (\w+) as \2$", stub, re.MULTILINE)
    assert dict(eqt_cli.STABLE) == {name: module for module, name in stable}


def test_everything_promised_is_there():
    assert all(hasattr(eqt_cli, name) for name in {*eqt_cli.__all__, *eqt_cli.api.__all__})
    assert {*eqt_cli.__all__} - {"__version__"} <= {*eqt_cli.api.__all__}


def test_no_package_takes_the_name_of_a_function():
    """Importing one would put it in the place of the function; `eqt_cli.gym` is one itself."""
    names = {*eqt_cli.api.__all__, *eqt_cli.STABLE} - {"gym"}
    for package in (eqt_cli, eqt_cli.api):
        assert not {module.name for module in iter_modules(package.__path__)} & names


def test_unknown_attribute():
    with pytest.raises(AttributeError, match=r"^module 'eqt_cli' has no attribute 'nothing'$"):
        eqt_cli.nothing  # noqa: B018


def test_overrides_may_be_arrays():
    inertia = np.diag([1.0, 2.0, 2.5])
    loaded = eqt_cli.load_experiment(PAPER, {"inertia": inertia, "gains.kd": np.float64(2)})
    assert loaded.resolved["inertia"] == inertia.tolist()
    assert loaded.resolved["gains"]["kd"] == 2.0


def test_a_sweep_from_python_is_that_of_the_configuration(tmp_path):
    grid = {"gains.kp": np.array([1.0, 2.0]), "gains.kd": {"low": 0.5, "high": 1, "points": 2}}
    result = eqt_cli.sweep(eqt_cli.load_experiment(PAPER, FEW), grid, tmp_path / "result")
    section = [{"grid": {"gains.kp": [1.0, 2.0]}}, {"grid": {"gains.kd": [0.5, 1.0]}}]
    same = eqt_cli.load_experiment(PAPER, {**FEW, "sweep": section})
    again = eqt_cli.sweep(same, out=tmp_path / "again")
    assert result.metric("effort").shape == (4, 4, 3)
    np.testing.assert_array_equal(result.metric("effort"), again.metric("effort"))
    assert error_of(eqt_cli.sweep, same, grid) == (
        "grid: the configuration has a section sweep; add these keys there"
    )


@pytest.mark.parametrize(
    ("grid", "said"),
    [
        (None, "grid: missing; give values by key, as {'gains.kp': [1, 2]}, or use run"),
        ([1], "grid: expected values by key, as {'gains.kp': [1, 2]}, got [1]"),
        (
            {"gains.kq": [1]},
            "grid['gains.kq']: gains.kq: unknown key; expected one of kp, kd, k_R, k_Omega",
        ),
    ],
)
def test_a_sweep_needs_a_grid(grid, said):
    assert error_of(eqt_cli.sweep, PAPER, grid) == said


def test_a_mapping_is_the_same_experiment_as_its_file():
    from_file = eqt_cli.load_experiment(PAPER, FEW)
    again = eqt_cli.load_experiment(from_file.resolved)
    assert again.digest == from_file.digest


def test_problems_of_overrides_are_named_as_python_has_them():
    assert error_of(
        eqt_cli.load_experiment, PAPER, {"gains.kd": 1, "ensemble.runs": "many"}, kind=ConfigError
    ) == ("overrides['ensemble.runs']: ensemble.runs: expected a whole number, got 'many'")
    said = error_of(eqt_cli.load_experiment, PAPER, {"gains.kp": float("nan")}, kind=ConfigError)
    assert said == "overrides['gains.kp']: gains.kp: expected a finite number, got .nan"
    said = error_of(eqt_cli.load_experiment, {"group": "SO3", "gains": {"kp": float("inf")}})
    assert "gains.kp: expected a finite number, got .inf" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inertia": [1, 2]}, "inertia: expected 3 diagonal entries for SO3, got 2"),
        ({"time": {}}, "time.duration: missing; this key is required: "),
        ({"controllers": ["eqt", {"kind": "gt", "gain": 1}]}, "controllers[1].gain: unknown key"),
        (
            {"sweep": [{"grid": {"gains.kp": [1, -1]}}]},
            "sweep[0].grid.gains.kp[1]: gains.kp: must be positive",
        ),
        ({"sweep": 2}, "sweep: expected a list"),
    ],
)
def test_problems_of_a_mapping_are_at_their_keys(change, said):
    """No line: the user never sees the text that eqt makes of the mapping."""
    config = eqt_cli.load_experiment(PAPER).resolved | change
    assert error_of(eqt_cli.load_experiment, config, kind=ConfigError).startswith(said)


def test_a_remark_on_a_mapping_is_at_its_key():
    config = eqt_cli.load_experiment(PAPER, FEW).resolved | {"inertia": [1, 1, 3]}
    said = [str(remark) for remark in remarks(eqt_cli.load_experiment(config).base)]
    assert any(text.startswith("inertia: not the inertia of a rigid body") for text in said)


@pytest.mark.parametrize(
    ("value", "shown"), [(1j, "1j"), ([1.0, {2.0}], "{2.0}"), ({(1, 2): 3}, "keys must be str")]
)
def test_configurations_hold_plain_data(value, shown):
    """The message names the part that is none, not the whole configuration."""
    said = error_of(eqt_cli.load_experiment, {"group": "SO3", "inertia": value})
    assert said.startswith(shown)
    assert said.endswith(": a configuration holds numbers, text, lists and mappings")


def test_a_gate_takes_lists_of_rules_and_two_results(computed):
    rule = "effort worse by 5 %"
    assert error_of(eqt_cli.compare, computed, other=computed, fail_on=rule).startswith("fail_on: ")
    assert error_of(eqt_cli.compare, computed, fail_on=[rule]) == (
        "fail_on, law and same compare two results; give other, too"
    )


def test_run_keeps_a_finished_result(result):
    assert (result.outcome.was_complete, result.runs, result.failed) == (True, 12, 0)
    assert repr(result) == f"<result {result.path}: 12 runs>"


@pytest.mark.parametrize(
    ("call", "steps"),
    [
        (partial(eqt_cli.plot, formats=["svg"]), {"figures drawn": 1}),
        pytest.param(
            partial(eqt_cli.report, figures=["paper"]),
            {"runs integrated again": 12, "certificates checked": 31, "figures drawn": 1},
            marks=pytest.mark.ci("writes a whole report"),
        ),
    ],
    ids=["plot", "report"],
)
def test_long_steps_are_counted_under_their_own_names(result, told, call, steps):
    assert_counted(told, partial(call, result), steps)


def test_resampling_is_counted_where_there_are_runs_enough(tmp_path, told):
    five = FEW | {"ensemble.runs": 5, "controllers": ["eqt", "gt"]}
    result = eqt_cli.run(eqt_cli.load_experiment(PAPER, five), tmp_path / "o")
    told.steps.clear()
    told.done.clear()
    told.ended = 0
    assert_counted(told, partial(eqt_cli.compare, result, resamples=1500), {"resamples": 1500})


def assert_counted(told, call, steps):
    """That a call begins these steps, and goes through all that they count."""
    call()
    assert dict(told.steps) == steps
    assert [told.total(name) for name in steps] == pytest.approx(list(steps.values()))
    assert told.ended == len(steps)


@pytest.mark.parametrize(
    "estimates", [pytest.param(False, marks=pytest.mark.ci("counts fewer solves")), True]
)
def test_run_reports_progress(tmp_path, told, estimates):
    """A run whose error is estimated is done after its second solve, and counts once."""
    settings = FEW | {"solver.error_estimate": estimates, "controllers": ["eqt", "gt"]}
    result = eqt_cli.run(eqt_cli.load_experiment(PAPER, settings), tmp_path / "result")
    assert not result.outcome.was_complete
    assert told.steps[0] == ("runs", 6)
    assert told.total("runs") == pytest.approx(6)


def test_without_xarray_a_result_is_read_as_arrays(result, monkeypatch):
    monkeypatch.setattr(loading, "find_spec", lambda name: None)
    assert eqt_cli.open_result(result).read("effort", controller="gt").shape == (3,)
    assert error_of(result.to_xarray) == (
        "xarray is not installed (extra xarray): pip install xarray h5netcdf"
    )


def test_findings_are_short_on_a_screen_and_tables_in_a_notebook(result):
    shown = [result, eqt_cli.compare(result, ["effort"]), eqt_cli.margins(result)]
    for finding, first, rows in zip(
        [*shown, eqt_cli.verify(result)],
        [repr(result), "paper on SO3: 3 runs of each law", "eqt: indicative", "✓ "],
        [4, 6, 4, None],
        strict=True,
    ):
        lines = repr(finding).splitlines()
        assert lines[0].lower().startswith(first.lower())
        assert len(lines) <= 20
        page = finding._repr_html_()
        assert page.count("<tr>") == 1 + min(len(finding.records()), 20)
        assert rows in (None, len(finding.records()))
        assert "None" not in page
    few, many = result._repr_html_(), eqt_cli.verify(result)._repr_html_()
    assert "<details open>" in few and "<details><summary>" in many


@needs_xarray
def test_findings_are_data_frames(result):
    table = eqt_cli.compare(result, ["effort"]).to_dataframe()
    assert len(table) == 6  # pairs of four laws
    assert {"metric", "difference", "low", "high", "word", "adjusted_p"} <= {*table.columns}
    assert list(eqt_cli.margins(result).to_dataframe().label) == ["eqt", "gt", "nog", "asym"]


def test_a_result_that_was_opened_is_as_the_one_that_was_run(result):
    with eqt_cli.open_result(result.path) as opened:
        assert (opened.runs, opened.failed, opened.labels) == (12, 0, ["eqt", "gt", "nog", "asym"])
        assert repr(opened) == repr(result) == f"<result {result.path}: 12 runs>"
        assert opened.file == result.file
        assert opened.times.tolist() == result.times.tolist()
        assert "effort" in opened.names
        assert opened.units("effort") == "(N m)^2 s"
    assert result.outcome.was_complete
    assert error_of(lambda: opened.outcome) == (
        f"{result.path}: was opened from a file; only a result that `run` returns has an outcome"
    )


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda result: eqt_cli.load_experiment(result, "gains.kp=2"),
            "overrides: expected values by key, as {'gains.kp': 2}, got 'gains.kp=2'",
        ),
        (lambda _: eqt_cli.load_experiment(5), "config: expected a path or a mapping, got 5"),
        (lambda _: eqt_cli.compare(5), "result: expected a path, got 5"),
        (
            lambda result: eqt_cli.compare(result, windows=[(0, 5)]),
            "windows: expected text such as '0:5', or a Window, got (0, 5)",
        ),
        (
            lambda result: eqt_cli.compare(result, windows="0:5"),
            "windows: expected a list of windows, as ['0:5'], got '0:5'",
        ),
        (
            lambda result: eqt_cli.compare(result, metrics="effort"),
            "metrics: expected a list of names, as ['effort'], got 'effort'",
        ),
    ],
)
def test_arguments_of_another_kind(result, call, said):
    assert error_of(call, result) == said


def test_what_to_do_is_said_in_python(result):
    assert error_of(eqt_cli.run, eqt_cli.load_experiment(result, {"gains.kp": 7}), result).endswith(
        "\nchoose another folder with out=…, or replace it with force=True"
    )


def test_a_figure_is_drawn_into_axes_of_ones_own(paper_result):
    own = Figure(figsize=(7, 4), layout="constrained")
    grid = own.subplots(2, 2)
    assert eqt_cli.figure(paper_result, "summary", axes=grid) is own
    stored = eqt_cli.open_result(paper_result)
    for axes, signal in ((grid[1, 0], "torque_norm"), (grid[1, 1], "lyapunov")):
        curves = {line.get_label(): line.get_ydata() for line in axes.lines}
        assert [*curves] == ["eqt", "gt", "nog", "asym"]
        for label, curve in curves.items():
            middle = np.median(stored.read(signal, controller=label), axis=0)
            np.testing.assert_allclose(curve, middle, rtol=1e-14)
    assert [axes.get_xlabel()[:3] for axes in own.axes] == ["$t$"] * 4
    legends = [axes.get_legend() for axes in own.axes]
    assert [text.get_text() for text in legends[0].get_texts()] == ["EqT", "GT", "nog", "asym"]
    assert legends[1:] == [None] * 3 and own.legends == []
    assert [axes.get_title(loc="left") for axes in own.axes] == [""] * 4  # letters are the user's
    own.draw_without_rendering()
    (remark,) = grid[1, 1].texts
    said = " ".join(remark.get_text().split())
    assert said.endswith("Curves: median, quartiles of EqT and GT, 60 runs.")
    assert remark.get_window_extent().y1 < grid[1, 1].xaxis.label.get_window_extent().y0
    assert remark.get_window_extent().y0 > 0


def test_panels_go_to_axes_by_their_names(paper_result):
    panels = Figure().subplot_mosaic([["torque_norm", "lyapunov"]])
    options = {"panels": ["lyapunov", "torque_norm"]}
    eqt_cli.figure(paper_result, "summary", options=options, axes=panels)
    assert panels["torque_norm"].get_ylabel().endswith("m})$")
    assert panels["lyapunov"].get_yscale() == "log"


def test_scales_that_own_axes_share_stay_shared(paper_result):
    grid = Figure().subplots(2, 4, sharey=True)
    eqt_cli.figure(paper_result, "runs", axes=grid[0])
    assert len({axes.get_ylim() for axes in grid[0]}) == 1
    assert [len(axes.lines) for axes in grid[0]] == [61] * 4


def test_a_map_is_drawn_into_axes_of_ones_own(swept_result):
    own = Figure()
    left, right = own.subplots(1, 2)
    eqt_cli.figure(swept_result, "sweep", options={"controllers": ["gt"]}, axes=right)
    stored = eqt_cli.open_result(swept_result)
    means = stored.metric("mean_attitude_error")[:, stored.labels.index("gt")].mean(axis=-1)
    np.testing.assert_allclose(np.sort(right.collections[0].get_array().ravel()), np.sort(means))
    assert not left.collections and len(own.axes) == 3  # with the scale of colours
    eqt_cli.figure(swept_result, "pareto", axes=left)
    assert len(left.lines) == 4
    four = Figure().subplots(2, 2)
    eqt_cli.figure(swept_result, "sweep", axes=four)
    for panel in four.ravel():  # each by itself, wherever it stands
        assert [text.get_text() for text in panel.get_xticklabels()] == ["0.5", "1", "2.5"]
        assert [text.get_text() for text in panel.get_yticklabels()] == ["0.5", "1"]
        assert panel.xaxis.label.get_visible() and panel.get_ylabel()


def test_axes_that_do_not_fit_are_refused(paper_result, swept_result):
    def refused(axes, result=paper_result, name="paper", **options):
        return error_of(partial(eqt_cli.figure, axes=axes, options=options), result, name)

    panels = "pose_error, velocity_error, torque_norm, lyapunov"
    advice = "; choose panels by options of the figure, or give as many"
    for axes in (Figure().subplots(1, 3), Figure().subplots(1, 6)):
        assert refused(axes).startswith(f"axes: expected 4 Axes, for {panels}; got {axes.size}: ")
    named = Figure().subplot_mosaic([["mine", "lyapunov"]])
    assert refused(named) == f"axes: expected 4 Axes, for {panels}; got 2: mine, lyapunov{advice}"
    whole = Figure(figsize=(4, 3))
    assert refused(whole, panels=["lyapunov"]) == (
        f"axes: expected 1 Axes, for lyapunov; got 1: Figure(400x300){advice}"
    )
    assert refused(whole.subplots(), swept_result, "forest", controllers=["eqt", "gt"]) == (
        "axes: figure 'forest' makes its own panels; leave out axes"
    )


@pytest.mark.ci("runs the tutorial as it stands")
def test_tutorial_runs_as_it_stands(tmp_path):
    for name in ("configs", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name)
    done = subprocess.run(
        [sys.executable, "-W", "error", "examples/tutorial.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "mean_torque, gt − eqt: 0" in done.stdout
    assert "kd = 1.0: final attitude error of eqt" in done.stdout


def test_a_sweep_says_how_many_points_it_has():
    sweep = [{"grid": {"gains.kd": [1, 2, 3]}}]
    loaded = eqt_cli.load_experiment(PAPER, {**FEW, "sweep": sweep})
    assert (
        repr(loaded)
        == "<experiment paper on SO3: 3 points, each with 3 runs of eqt, gt, nog, asym>"
    )


def test_figures_are_drawn_into_the_result_folder(result):
    files = eqt_cli.plot(result, "paper", formats=["svg", "json"], options={"log": True})
    assert files == [
        result.path / "figures" / name for name in ("paper.svg", "paper.json", "paper-caption.tex")
    ]
    assert all(file.exists() for file in files)


@pytest.mark.parametrize(("name", "first"), [("paper", "paper"), ("mine", "summary")])
def test_the_figure_of_the_paper_is_the_first_of_its_own_experiment(name, first, tmp_path):
    brief = FEW | {"name": name, "time.duration": 0.1, "time.samples": 3}
    mine = eqt_cli.run(eqt_cli.load_experiment(PAPER, brief), tmp_path)
    assert [file.stem for file in eqt_cli.plot(mine, formats=["json"])] == [first]


def test_figures_of_several_results(result, tmp_path):
    both = eqt_cli.plot([result, str(result.path)], out=tmp_path, formats=["json"])
    assert both == [tmp_path / "paper.json"] and both[0].exists()
    assert error_of(eqt_cli.plot, []) == "result: expected one or more results, got none"


def test_what_verify_refuses(result):
    assert (
        error_of(eqt_cli.verify, result, runs=2)
        == f"{result.path}: a result is verified as it is; leave runs out"
    )
    assert (
        error_of(eqt_cli.verify, eqt_cli.load_experiment(PAPER, FEW), point=1)
        == "point: expected one of 0 to 0, got 1"
    )


def test_controllers_are_selected_by_label(result):
    with open_at(result) as data:
        assert np.array_equal(data.read("effort", controller="gt"), data["effort"][1])
        chosen = data.read("effort", controller=["asym", "eqt"])
        assert np.array_equal(chosen, data["effort"][[3, 0]])
        assert error_of(data.read, "effort", run="first", kind=ResultError) == (
            f"{data.path}: 'effort': run: has no labels, so 'first' selects nothing; use positions"
        )


def test_open_results_describe_themselves(result):
    with open_at(result) as data:
        text = repr(data)
    assert text.startswith(
        f"<results {data.path}: {len(data.names)} variables over controller 4, run 3"
    )
    assert repr(data) == text.removesuffix(">") + ", closed>"


def test_a_page_that_cannot_be_written_is_refused_before_the_work(result, monkeypatch):
    def work(*arguments, **options):
        raise AssertionError("began")

    monkeypatch.setattr(verification, "verify_stored", work)
    target = Path(result) / "results.h5"
    with pytest.raises(EqtError, match=r"results\.h5: "):
        eqt_cli.report(result, out=target)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """A checkout with the results that examples read; its search is short."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(ROOT / "configs", folder / "configs")
    search = folder / "configs" / "tune_so2.yaml"
    text = search.read_text(encoding="utf-8")
    search.write_text(text.replace("samples: 1 #", "budget: 5\n  samples: 1 #"), encoding="utf-8")
    eqt_cli.run(eqt_cli.load_experiment(PAPER, FEW), folder / "results" / "paper")
    sweep = eqt_cli.load_experiment(ROOT / "configs" / "sweep_gains.yaml", FEW)
    eqt_cli.run(sweep, folder / "results" / "sweep_gains")
    return folder


DEMANDING = (
    "animate diff error_budget export fit live plot replay report run suite sweep tune verify worst"
).split()
PUBLIC = [name for name in eqt_cli.api.__all__ if inspect.isfunction(getattr(eqt_cli, name))]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.ci("computes, searches, fits, draws or writes"))
        if name in DEMANDING
        else name
        for name in PUBLIC
    ],
)
@pytest.mark.usefixtures("unarranged")
def test_the_example_of_a_function_works(examples, name, monkeypatch):
    if name == "live":
        pytest.importorskip("ziglang", reason="needs a compiler for WebAssembly")
    monkeypatch.chdir(examples)
    function = getattr(eqt_cli, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(
        function, name, globs={"eqt_cli": eqt_cli}
    )
    assert example.examples
    said = []
    doctest.DocTestRunner().run(example, out=said.append)
    assert "".join(said) == ""


@pytest.mark.parametrize("name", PUBLIC)
def test_what_a_function_returns_is_said(name):
    assert "Returns\n-------\n" in inspect.getdoc(getattr(eqt_cli, name))


def test_a_figure_is_there_to_be_edited(result, tmp_path):
    figure = eqt_cli.figure(result, "paper", options={"controllers": ["eqt"]}, width="page")
    panels = {axes.get_label(): axes for axes in figure.axes}
    assert {"torque_norm", "lyapunov"} <= {*panels}
    assert figure.get_size_inches()[0] == pytest.approx(7.16)
    panels["torque_norm"].axhline(0.5)
    figure.savefig(tmp_path / "edited.png")
    assert (tmp_path / "edited.png").stat().st_size > 10_000
    assert "unknown width 'pages'; did you mean 'page'?" in error_of(
        partial(eqt_cli.figure, width="pages"), result, "paper"
    )
