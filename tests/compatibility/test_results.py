"""Results of the first version: shown, compared, verified, drawn, reported, run again, resumed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.store.reader import open_results

FIRST = Path(__file__).parent / "first_version"
DOCUMENTS = sorted(path.stem for path in (FIRST / "documents").glob("*.json"))
FIGURES = sorted(path.relative_to(FIRST / "figures") for path in FIRST.glob("figures/*/*.json"))
CHANGING = ("begun", "rate", "remaining_s", "writer", "path")
"""Of a folder that is not finished."""


ROUGH = ("low", "high", "verdict")
"""Of a comparison of six runs: a bootstrap of so few has steps, and rounding decides for one."""


def documents(command: str) -> list[str]:
    return [name for name in DOCUMENTS if name.startswith(command)]


@pytest.mark.parametrize("name", documents("show"))
def test_show_says_what_it_said(name, eqt, kept, unlike) -> None:
    code, out, _ = eqt("show", f"results/{name.partition('_')[2]}", "--json")
    then, now = kept(name), json.loads(out)
    for key in CHANGING if "done" in then else ():
        then.pop(key)
    assert code == 0
    assert unlike(then, now) == []


@pytest.mark.parametrize("name", documents("compare"))
def test_compare_says_what_it_said(name, eqt, kept, unlike) -> None:
    code, out, _ = eqt("compare", f"results/{name.partition('_')[2]}", "--json")
    assert code == 0
    then, now = kept(name), json.loads(out)
    for table in ("levels", "pairs"):  # what controllers are compared by may have become more
        known = {entry["metric"] for entry in then[table]}
        now[table] = [entry for entry in now[table] if entry["metric"] in known]
    for entry in (*then["levels"], *then["pairs"], *then["claims"]):
        for key in ROUGH:
            entry.pop(key, None)
    assert unlike(then, now) == []


@pytest.mark.parametrize("name", documents("verify"))
def test_verify_finds_what_it_found(name, eqt, kept) -> None:
    """Verdicts; what was measured of rounding errors differs from machine to machine."""
    _, out, _ = eqt("verify", f"results/{name.partition('_')[2]}", "--json", "--trust-plugins")
    then, now = (
        {(row["name"], row["controller"]): row["verdict"] for row in document["rows"]}
        for document in (kept(name), json.loads(out))
    )
    assert {key: now.get(key) for key in then} == then


RENAMED = {
    "": {"effort ((N m)^2 s)": "effort (N^2 m^2 s)"},
    "_rotation": {"‖I - Q_E‖_F": "‖I - R_E‖_F", "‖V - V_d‖ (rad/s)": "‖ω - ω_d‖ (rad/s)"},
    "_translation": {
        "‖I - Q_E‖_F (m)": "‖x_E‖ (m)",
        "‖V - V_d‖ (m/s)": "‖v - v_d‖ (m/s)",
        "‖τ‖ (N)": "‖f‖ (N)",
    },
}
"""The names of scales that have changed since, by how the name of a panel ends."""

AS_BEFORE = {
    "phase": ["--option", "runs=20"],
    "sphere": ["--option", "runs=20"],
    "torque": ["--option", "bands=quantiles"],
}
"""Options of figures that have other defaults now."""


def overlaid(curve):
    """A curve of figure torque, whose laws had panels of their own."""
    axis, law = curve["panel"].split(" ")
    names = {"mean": law, "desired": "desired"}
    name = names.get(curve["name"], curve["name"].replace("of runs", law))
    return curve | {"panel": axis, "name": name, "up": curve["up"].replace("τ_ω", "τ_")}


@pytest.mark.parametrize("figure", FIGURES, ids=str)
def test_figures_show_the_numbers_that_they_showed(figure, eqt, plugins) -> None:
    plugins()  # figures of a result's own plugins were found where these were loaded
    result, name = figure.parent.name, figure.stem
    path = Path("figures") / figure
    curves = json.loads(path.read_text(encoding="utf-8"))
    for curve in curves:
        for ending, names in RENAMED.items():
            if curve["panel"].endswith(ending):
                curve |= {axis: names.get(curve[axis], curve[axis]) for axis in ("across", "up")}
    if name == "torque":
        curves = list({(c["panel"], c["name"]): c for c in map(overlaid, curves)}.values())
    path.write_text(json.dumps(curves), encoding="utf-8")
    more = AS_BEFORE.get(name, [])
    code, out, err = eqt(
        "plot", f"results/{result}", "--figure", name, *more, "--check", f"figures/{result}"
    )
    assert (code, err) == (0, ""), out


@pytest.mark.parametrize(("name", "figure"), [("failed", "runs"), ("ragged", "pareto")])
def test_a_page_is_written(name, figure, eqt) -> None:
    code, _, err = eqt("report", f"results/{name}", "--figure", figure, "--out", "page.html")
    assert code == 0, err
    assert f"<title>{name}" in Path("page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["single", "thinned"])
def test_a_run_moves(name, eqt) -> None:
    code, _, err = eqt("animate", f"results/{name}", "--run", 0, "--format", "html", "--out", ".")
    assert code == 0, err
    assert list(Path().glob("*.html"))


@pytest.mark.parametrize("name", ["single", "sweep", "ragged"])
def test_a_result_is_complete(name, eqt) -> None:
    """Nothing is computed again for the same configuration and folder."""
    before = Path(f"results/{name}/results.h5").read_bytes()
    command = "run" if name == "single" else "sweep"
    code, _, err = eqt(command, f"configurations/{name}.yaml", "--out", f"results/{name}")
    assert code == 0, err
    assert Path(f"results/{name}/results.h5").read_bytes() == before


def assert_equal(one: Path, other: Path) -> None:
    with open_results(one) as then, open_results(other) as now:
        for name in then.names:
            values = then[name]
            if values.dtype.kind == "f":
                # Rounding on another machine, as steps of adaptive length carry it on.
                np.testing.assert_allclose(now[name], values, rtol=1e-7, atol=1e-9, err_msg=name)
            else:
                np.testing.assert_array_equal(now[name], values, err_msg=name)


def test_a_result_runs_again_alone_with_its_plugins(eqt) -> None:
    refused = eqt("run", "results/all_kinds/results.h5", "--out", "again")
    assert refused[0] == 2
    assert "which eqt executes only on request" in refused[2]
    code, _, err = eqt("run", "results/all_kinds/results.h5", "--out", "again", "--trust-plugins")
    assert code == 0, err
    assert_equal(Path("results/all_kinds"), Path("again"))


def test_failed_runs_are_run_again(eqt) -> None:
    code, _, err = eqt(
        "run", "configurations/failed.yaml", "--out", "results/failed", "--rerun-failed"
    )
    assert code == 3, err  # they fail again
    assert_equal(FIRST / "results/failed", Path("results/failed"))


@pytest.mark.parametrize("name", ["unfinished", "unfinished_sweep"])
def test_a_folder_that_was_begun_is_finished_with_the_right_numbers(name, eqt) -> None:
    command = "sweep" if "sweep" in name else "run"
    config = f"configurations/{name}.yaml"
    code, _, err = eqt(command, config, "--out", f"results/{name}")
    assert code == 0, err
    assert eqt(command, config, "--out", "whole")[0] == 0
    assert_equal(Path("whole"), Path(f"results/{name}"))
