"""`eqt plot`, within this process: styles, options, and plugins of results."""

import json
import re
from pathlib import Path

import pytest
from case_tables import from_yaml
from plugin_sources import component
from said import says
from small_experiment import configuration

pytestmark = pytest.mark.usefixtures("unarranged")


def svg(eqt, result, *options):
    done = eqt("plot", result, "--format", "svg", "-q", *options)
    assert (done.code, done.err) == (0, "")
    return Path(result, "figures", "summary.svg").read_text(encoding="utf-8")


@pytest.mark.ci("draws several figures in several styles")
@pytest.mark.usefixtures("unarranged")
def test_styles_are_laid_over_each_other(eqt, result):
    Path("mine.mplstyle").write_text("axes.facecolor: 123456\n", encoding="utf-8")
    plain = svg(eqt, result)
    styled = svg(eqt, result, "--style", "dark_background", "--style", "mine.mplstyle")
    assert "#123456" not in plain
    assert "#123456" in styled
    assert "stroke: #ffffff" in styled  # the frames, on the other sheet's black paper
    assert svg(eqt, result) == plain


def test_names_and_remarks_are_for_print(eqt, result):
    chosen = ("--controller", "eqt", "--from", "0.1", "--title", "eqt=ours & co")
    both = ("--format", "json", "--format", "svg")
    done = eqt("plot", result, *both, "--out", "print", "-q", *chosen)
    assert (done.code, done.err) == (0, "")
    assert Path("print/summary-caption.tex").read_text(encoding="utf-8").splitlines()[1] == (
        "Thin dashes: threshold of settled. Curves: median, quartiles, 3 runs.%"
    )
    kept = json.loads(Path("print/summary.json").read_text(encoding="utf-8"))
    assert {curve["name"] for curve in kept} == {"eqt", "lower edge eqt", "upper edge eqt"}
    assert min(curve["x"][0] for curve in kept) >= 0.1


@from_yaml
def test_what_cannot_be_drawn_for_print_is_said(options, message, refused, result):
    assert says(refused("plot", result, *options.split()), f"{message}\n")


def test_a_wrong_style_is_one_line_on_stderr(refused, result):
    Path("mine.mplstyle").write_text("axes.grid: perhaps\n", encoding="utf-8")
    assert refused("plot", result, "--style", "mine.mplstyle") == (
        "mine.mplstyle:1: the style sheet is wrong: Key axes.grid: Cannot convert 'perhaps' "
        "to bool\n"
    )
    assert not Path(result, "figures").exists()


def test_what_is_printed_is_the_files_a_line_for_each_figure(eqt, result):
    done = eqt("plot", result, "--format", "svg")
    summary = Path("out/figures/summary.svg")
    assert (done.out, done.err) == (f"figure   {summary} (-caption.tex)\n", "")


BOTH = ("--figure", "summary", "--figure", "torque", "--format", "json")


@pytest.mark.ci("draws several figures")
@pytest.mark.usefixtures("unarranged")
def test_options_go_to_the_figures_that_have_them(eqt, result):
    def curves(*options):
        """How many curves each of the figures has."""
        assert eqt("plot", result, *BOTH, *options).code == 0
        files = (Path(result, "figures", f"{name}.json") for name in ("summary", "torque"))
        return [len(json.loads(file.read_text(encoding="utf-8"))) for file in files]

    paper, torque = curves("--option", "log=true")  # torque has none
    both = curves("--option", "controllers=[eqt]")
    assert both[0] < paper
    assert both[1] < torque
    assert curves("--option", "summary.controllers=[eqt]") == [both[0], torque]


@from_yaml
def test_an_option_that_no_figure_has(eqt, result, option, said):
    done = eqt("plot", result, *BOTH, "--option", option)
    assert done.code == 2
    assert says(done.err, f"eqt: error: --option[0]: {said}\n")


def test_an_option_of_one_figure_is_refused_by_it(refused, result):
    assert refused("plot", result, *BOTH, "--option", "torque.shrae=total").startswith(
        "figure 'torque': shrae: unknown key; did you mean 'share'?"
    )


@pytest.mark.ci("runs a sweep")
def test_a_sweep_of_three_keys_says_why_it_is_drawn_as_a_front_only(eqt):
    grid = ("--grid", "gains.kp=1,2", "--grid", "gains.kd=1,2", "--grid", "ensemble.seed=1,2")
    brief = ("--set", "controllers=[eqt]", "--set", "time.duration=0.1")
    eqt("sweep", "c.yaml", *grid, *brief, "--out", "out")
    done = eqt("plot", "out", "--format", "svg")
    assert done.err == (
        "figure 'sweep' shows at most two swept keys, and this result has 3 (gains.kp, gains.kd, "
        "ensemble.seed); drew 'pareto' instead; --point draws one point\n"
    )
    assert done.out.startswith(f"figure   {Path('out/figures/pareto.svg')}")


DEFINED = component("""
spectrum(eqt_cli.extend.OverTime):
    def compose(self, runs, width):
        return runs.nothing
""")


def test_a_figure_of_a_plugin_in_a_result(eqt, monkeypatch):
    """It is known where the plugins are trusted, and an error in it is told with its line."""
    config = configuration(plugins="[own.py]", controllers="[eqt]")
    Path("own.yaml").write_text(config, encoding="utf-8")
    Path("own.py").write_text(DEFINED, encoding="utf-8")
    assert eqt("run", "own.yaml", "--out", "out", "-q").code == 0
    monkeypatch.setattr("eqt_cli.figures.figure.figures._plugins", {})
    words = ("plot", "out", "--figure", "spectrum", "--format", "json", "-q")
    assert eqt(*words).err.startswith("eqt: error: unknown figure 'spectrum'; known: ")
    assert says(
        eqt(*words, "--trust-plugins").err,
        "eqt: error: AttributeError: 'ShownRuns' object has no attribute…: return runs.nothing\n",
    )


def test_every_figure_is_listed_with_a_sentence(eqt):
    from eqt_cli.figures.figure import figures

    done = eqt("plot", "--list")
    assert done.code == 0
    names = re.findall(r"^(\w+)  +[A-Z]", done.out, re.M)
    assert sorted(names) == sorted(figures.names())


def test_a_figure_replaces_no_file_of_others(refused, result, monkeypatch):
    """It is refused before anything is drawn."""
    monkeypatch.setattr("eqt_cli.figures.render.render", None)
    path = Path("out/figures/torque.svg")
    path.parent.mkdir()
    path.write_text('<?xml version="1.0"?><svg/>', encoding="utf-8")
    assert refused("plot", result, "--figure", "paper", "--figure", "torque") == (
        f"{path}: exists, but eqt did not write it; choose another place with --out\n"
    )
