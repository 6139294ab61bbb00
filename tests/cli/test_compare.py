"""`eqt compare` on the paper's experiment with fewer runs, as a user types it."""

import csv
import io
import json
import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from case_tables import from_yaml
from said import says
from scipy.stats import ttest_rel
from small_experiment import FEW_RUNS as SMALL
from stored import fixed

from eqt_cli.extend import Native
from eqt_cli.results.result import open_result

BREAKS = Path(__file__).parents[2] / "configs" / "satellite_breaks.yaml"


@pytest.fixture(scope="session")
def breaks_result(invoke, made_once):
    """The folder of a shipped experiment whose third law has another function L."""
    short = ["--set=ensemble.runs=2", "--set=time.duration=0.5", "--set=time.samples=6"]
    short += ["--set=store.decimate=1"]
    run = ["run", BREAKS, *short, "--quiet", "--set=solver.rtol=1e-3", "--out"]
    return made_once("breaks", lambda folder: invoke(*run, folder / "result")) / "result"


@pytest.mark.ci("computes a sampled loop, draws and animates it")
@pytest.mark.needs("merging")
@pytest.mark.usefixtures("unarranged")
@pytest.mark.parametrize(("first", "second"), [("eqt", "lee2010"), ("gt", "eqt")])
def test_a_pair_of_laws_can_be_chosen_in_every_format(
    invoke, breaks_result, tmp_path, first, second
):
    folder, pair = breaks_result, ["--controller", first, "--controller", second]
    compare = ["compare", folder, *pair, "--resamples", 9]
    assert invoke(*compare, "--format", "latex").stdout.strip()
    document = json.loads(invoke(*compare, "--json").stdout)
    assert set(document["controllers"]) == {first, second}
    invoke("plot", folder, *pair, "--format", "json", "--out", tmp_path)
    kept = json.loads((tmp_path / "summary.json").read_text())
    edges = {f"{end} edge {law}" for end in ("lower", "upper") for law in (first, second)}
    assert {curve["name"] for curve in kept} == {first, second} | edges
    invoke("animate", folder, *pair, "--seconds", 0.2, "--out", tmp_path)


@pytest.fixture(scope="module")
def claim(invoke, paper_result):
    """The rows of the claims in which a text stands."""
    compared = invoke("compare", paper_result, "--resamples", 500, "--json")
    rows = json.loads(compared.stdout)["claims"]
    return lambda text: [row for row in rows if text in row["claim"]]


def test_superiority_is_measured_row_by_row(claim):
    rows = claim("superior to the two approximations")
    assert [(row["metric"], row["first"], row["second"]) for row in rows] == [
        (metric, first, second)
        for metric in ("mean_pose_error", "mean_torque")
        for first in ("eqt", "gt")
        for second in ("nog", "asym")
    ]
    verdicts = {(row["metric"], row["first"], row["second"]): row["verdict"] for row in rows}
    assert verdicts["mean_pose_error", "eqt", "nog"] == "supported"
    assert verdicts["mean_pose_error", "eqt", "asym"] == "not supported"


def test_all_four_are_stabilising(claim):
    rows = claim("stabilising")
    assert [(row["first"], row["held"], row["verdict"]) for row in rows] == [
        (label, 60, "supported") for label in ("eqt", "gt", "nog", "asym")
    ]


def test_the_answer_stands_first_and_tables_behind_their_names(invoke, paper_result, monkeypatch):
    few = ("--resamples", 500)
    monkeypatch.setenv("COLUMNS", "80")
    done = invoke("compare", paper_result, *few)
    lines = done.stdout.splitlines()
    assert len(lines) <= 25 and max(map(len, lines)) <= 80
    assert re.split(" {2,}", lines[0]) == ["law", "mean attitude error", "effort", "settled"]
    assert re.fullmatch(r"EqT +\d\d\.\d\d deg +\d\d\.\d\d \(N m\)² s +\d+ of 60", lines[2])
    error, effort = r"−\d+ % \[−\d+, −\d+\]", r"\+\d+ % \[.+\]"
    assert re.fullmatch(rf"GT +{error} ✓ +{effort}( [✗?])? +\+\d+ pp \[.+\] ✓", lines[3])
    assert [line.split()[0] for line in lines[4:6]] == ["nog", "asym"]
    with open_result(paper_result) as result:
        errors = result.metric("mean_attitude_error")[:2]
    median = 100 * np.median(errors[1] / errors[0] - 1)
    assert float(lines[3].split()[1].replace("−", "-")) == pytest.approx(median, abs=0.5)
    assert "claims of Hampsey et al. (2025), section 7: 3 supported; " in done.stdout
    # All numbers of the pose say the same as the matrix, which says it once.
    assert "also better in mean ‖V − V_d‖" in done.stdout
    assert "‖I − Q_E‖" not in done.stdout
    assert (
        done.stderr == "next: --table pairs, controllers, claims or all; --list for all metrics\n"
    )
    whole = invoke("compare", paper_result, *few, "--table", "all").stdout
    pairs = ["GT EqT", "nog EqT", "asym EqT", "nog GT", "asym GT", "asym nog"]
    titled = ["{0} against {1}, in % of {1}".format(*pair.split()) for pair in pairs]
    assert [line for line in whole.splitlines() if ", in % of " in line] == titled
    asked = "Claims of Hampsey et al. (2025), section 7, tested on this experiment"
    assert f"{asked}, at 60 runs per" in whole.replace("\n", " ")
    against = invoke("compare", paper_result, *few, "--against", "GT").stdout.splitlines()
    assert re.match(r"GT +\d\d\.\d\d deg", against[2])
    assert re.match(r"EqT +\+\d+ % \[.+?\] ✗", against[3])


def test_two_results_are_compared_law_by_law(invoke, changed):
    """Before and after a change of gains; the numbers from the two files alone."""
    two = [changed / "soft", changed / "stiff"]
    lines = invoke("compare", *two, "--resamples", 99).stdout.splitlines()
    assert [line.partition("  ")[0] for line in lines if re.match(r"\w+ \(\w+\)  ", line)] == [
        f"{law} ({name})" for law in ("EqT", "GT", "nog", "asym") for name in ("soft", "stiff")
    ]
    assert "runs are paired by their equal starts" in lines
    laws = ", ".join(f"{law} (stiff)" for law in ("EqT", "GT", "nog", "asym"))
    said = " ".join(map(str.strip, lines))
    assert f"gains are not matched: {laws}: 2 times the stiffness of the law in soft" in said
    assert "what differs: gains.kp 1.0 → 2.0" in lines
    rows = json.loads(invoke("compare", *two, "--json", "--resamples", 99).stdout)["pairs"]
    with open_result(two[0]) as soft, open_result(two[1]) as stiff:
        for number, law in enumerate(soft.labels):
            [row] = [
                row for row in rows if (row["metric"], row["first"]) == ("effort", f"stiff/{law}")
            ]
            efforts = [each.metric("effort", number) for each in (soft, stiff)]
            assert row["second"] == f"soft/{law}"
            assert row["relative"] == pytest.approx(efforts[1].mean() / efforts[0].mean() - 1)
            assert row["first_better"] == np.mean(efforts[1] < efforts[0])
    assert not [row for row in rows if "lyapunov" in row["metric"]]


@pytest.mark.ci("compiles the laws")
def test_two_engines_fly_pairs(invoke, tmp_path):
    """They round the same starts each in its way."""
    few = ["--set", "ensemble.runs=4", "--set", "time.duration=1", "-q"]
    for engine in ("native", "solve_ivp"):
        invoke("run", "paper", *few, "--engine", engine, "--out", tmp_path / engine)
    lines = invoke("compare", tmp_path / "native", tmp_path / "solve_ivp").stdout.splitlines()
    assert "runs are paired by their equal starts" in lines


def test_laws_are_compared_although_the_stored_configuration_is_damaged(invoke, changed, tmp_path):
    path = shutil.copytree(changed / "soft", tmp_path / "damaged") / "results.h5"
    with h5py.File(path, "a") as file:
        file.attrs["config"] = fixed("gains: [1, 2")
    assert "EqT: means of 20 runs from the same starts. " in invoke("compare", path).stdout
    said = invoke("show", path, "--config", code=2).stderr.splitlines()[-1]
    assert said == f"{path}[config]:1:8: the '[' is never closed"


def test_two_results_with_other_starts_are_no_pairs(invoke, changed):
    lines = invoke("compare", changed / "soft", changed / "other").stdout.splitlines()
    assert "runs are not paired: other starts" in lines
    assert "what differs: ensemble.runs 20 → 15, ensemble.seed 2025 → 3" in lines
    assert any(says(line, "the first result: …15 runs per law…") for line in lines)
    table = invoke("compare", changed / "soft", changed / "other", "--table", "pairs").stdout
    assert table.startswith("Differences, run by run")


def test_equal_results_have_no_difference(invoke, changed):
    done = invoke("compare", changed / "soft", changed / "soft").stdout
    assert "what differs: nothing" in done
    assert not re.search("[✓✗]|better", done.partition("runs per law")[0])


def test_two_results_refuse_what_is_of_one(invoke, changed):
    two = [changed / "soft", changed / "stiff"]
    done = invoke("compare", *two, "--against", "gt", code=2)
    assert done.stderr.endswith("and --against apply to one result; leave them out with two\n")
    invoke("run", "so2", *SMALL, "--out", changed / "so2")
    done = invoke("compare", two[0], changed / "so2", code=2)
    assert done.stderr.endswith("is of SO2, and the other result of SO3\n")
    wrong = {
        ("--confidence", "2"): "confidence 2: expected a number between 0 and 1, as 0.95",
        ("--resamples", "0"): "resamples 0: expected at least 1",
    }
    for words, said in wrong.items():
        assert invoke("compare", *two, *words, code=2).stderr == f"eqt: error: {said}\n"
    done = invoke("compare", *two, "--window", "0:99", "--resamples", 9)
    assert "Window 0:99 is cut to 0:20, since" in done.stderr
    document = json.loads(invoke("compare", *two, "--json", "--resamples", 9).stdout)
    assert document["between"][0] == "what differs: gains.kp 1.0 → 2.0"


def test_against_chooses_pairs(invoke, paper_result):
    asked = ["--against", "gt", "--metric", "mean_torque", "--resamples", 9, "--table", "pairs"]
    out = invoke("compare", paper_result, *asked).stdout
    assert [line for line in out.splitlines() if "in % of" in line] == [
        f"{law} against GT, in % of GT" for law in ("EqT", "nog", "asym")
    ]


def test_against_an_unknown_controller(invoke, paper_result):
    done = invoke("compare", paper_result, "--against", "asim", code=2)
    assert done.stderr == "eqt: error: --against: no controller 'asim'; did you mean 'asym'?\n"


def test_csv_has_full_precision(invoke, paper_result):
    few = ["--resamples", 9]
    asked = ["--metric", "effort", "-w", "0:5", "-w", "5:", *few]
    done = invoke("compare", paper_result, "--format", "csv", *asked)
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert [(row["window_start"], row["window_stop"]) for row in rows[::6]] == [
        ("0.0", "5.0"),
        ("5.0", "20.0"),
    ]
    document = json.loads(
        invoke("compare", paper_result, "-m", "effort", "-w", "0:5", *few, "--json").stdout
    )
    assert float(rows[0]["difference"]) == document["pairs"][0]["difference"]


def test_latex_is_a_booktabs_table(invoke, paper_result):
    out = invoke("compare", paper_result, "--format", "latex", "--table", "pairs").stdout
    assert out.splitlines()[1:4] == [
        r"\begin{tabular}{@{}lllllr@{}}",
        r"\toprule",
        r"measure & difference & median & verdict & better in & runs to decide \\",
    ]
    assert out.count(r"\midrule") == 6
    assert "−" not in out.partition(r"\bottomrule")[0]


LATEX = ("--format", "latex", "--table", "controllers", "--columns", 1)


def test_latex_is_the_table_of_the_laws_alone(invoke, paper_result):
    latex = "compare", paper_result, "--format", "latex"
    alone, other = invoke(*latex), invoke(*latex, "--table", "controllers")
    assert alone.stdout == other.stdout
    assert "--table pairs, claims or all" in alone.stderr


def test_latex_has_a_row_for_each_chosen_law_and_seven_columns(invoke, paper_result):
    laws = ["--controller", "GT", "--controller", "eqt", "--resamples", 9]
    out = invoke("compare", paper_result, *laws, "--format", "latex", "--table", "controllers")
    tables = [each.splitlines() for each in out.stdout.split("\n\n")]
    assert len(tables) == 3
    one = invoke(
        *("compare", paper_result, *laws, "-m", "effort", "-m", "peak_torque"), *LATEX
    ).stdout
    assert r"\begin{tabular}{@{}p{0.28\columnwidth}ll@{}}" in one
    [effort] = [line for line in one.splitlines() if line.startswith("effort")]
    assert effort.count(r"\textbf{") == 1 and r"& \textbf{" in effort.partition(" $\\pm$ ")[0]
    for table in tables:
        header, rows = table[3], [line for line in table if line.startswith(("EqT &", "GT &"))]
        assert header.startswith(r"controller & \shortstack[l]{") and header.count(" & ") <= 6
        assert [row.count(" & ") for row in rows] == 2 * [header.count(" & ")]
        assert not any(line.startswith("nog") for line in table)


def test_units_of_a_user(invoke, paper_result):
    def levels(*options):
        compared = invoke("compare", paper_result, *options, "--resamples", 9, "--json")
        document = json.loads(compared.stdout)
        return {
            (row["metric"], row["window_stop"]): (row["mean"], row["units"])
            for row in document["levels"]
            if row["controller"] == "eqt"
        }

    usual, other = levels(), levels("--unit", "mN m", "--unit", "mean_attitude_error=arcsec")
    factors = {"mean_torque": 1e3, "effort": 1e6, "mean_attitude_error": 3600.0}
    units = {"mean_torque": "mN m", "effort": "(mN m)^2 s", "mean_attitude_error": "arcsec"}
    for (name, window), (mean, unit) in usual.items():
        factor = 1e3 if unit == "N m" else factors.get(name, 1.0)
        wanted = "mN m" if unit == "N m" else units.get(name, unit)
        assert other[name, window] == (pytest.approx(factor * mean, rel=1e-14, nan_ok=True), wanted)


@from_yaml
def test_a_unit_that_fits_nothing_is_a_message(invoke, paper_result, wish, message):
    said = invoke("compare", paper_result, "--unit", wish, code=2).stderr
    assert says(said, f"eqt: error: {message}\n")


def test_chosen_laws_are_all_that_is_compared(invoke, paper_result):
    found = json.loads(
        invoke(
            *("compare", paper_result, "--controller", "eqt", "--controller", "nog", "--json"),
            *("--resamples", 9),
        ).stdout
    )
    assert list(found["controllers"]) == ["eqt", "nog"]
    assert {(pair["first"], pair["second"]) for pair in found["pairs"]} == {("nog", "eqt")}
    done = invoke("compare", paper_result, "--without-start", code=2)
    assert says(done.stderr, f"eqt: error: {paper_result}/results.h5: is not…a tuning…\n")


def test_list_shows_what_can_be_compared(invoke, paper_result):
    out = invoke("compare", paper_result, "--list").stdout
    assert "decay_rate" in out and "energy_residual" in out
    document = json.loads(invoke("compare", paper_result, "--list", "--json").stdout)
    assert document[0] == {"metric": "mean_torque", "is": "mean ‖τ‖", "window": "any"}


def test_a_claim_about_controllers_that_are_not_there_says_so(eqt, folder):
    eqt("run", "c.yaml", "--quiet")
    out = eqt("compare", "results/c", "--table", "claims").out
    says = "“All four of these controls are stabilising” (here without nog, asym)"
    assert any(line.startswith(says) for line in out.splitlines())


@pytest.mark.ci("runs another experiment")
def test_claims_about_the_ideal_loop_are_not_judged_on_another(eqt, folder):
    """Of a sampled loop, EqT and GT differ; of three runs, there are no intervals."""
    eqt("run", "c.yaml", "--set", "control.period=0.25", "--quiet")
    out = eqt("compare", "results/c").out
    assert "3 runs per law: too few for statistics; `ensemble.runs` sets how many" in out
    assert "supported" not in out and "claims" not in out and " [" not in out
    table = eqt("compare", "results/c", "--table", "claims", "-m", "effort").out
    assert "\nnot covered: beyond the theorems of these claims are sampled control.\n" in table
    rows = json.loads(eqt("compare", "results/c", "--json").out)["claims"]
    assert {row["verdict"] for row in rows} == {"not covered"}


def test_the_window_of_a_stored_metric_is_its_own(invoke, paper_result):
    out = invoke("compare", paper_result, "--json", "-m", "early_torque", "--resamples", 9).stdout
    row = json.loads(out)["levels"][0]
    assert (row["metric"], row["window_start"], row["window_stop"]) == ("early_torque", 0, 5)
    listed = json.loads(invoke("compare", paper_result, "--list", "--json").stdout)
    windows = {row["metric"]: row["window"] for row in listed}
    assert (windows["early_torque"], windows["energy_residual"]) == ("0:5 s", "whole run")


def test_csv_is_of_one_table_and_says_so(eqt, folder):
    eqt("run", "c.yaml", "--quiet")
    done = eqt("compare", "results/c", "--format", "csv")
    assert done.out.startswith("metric,")
    assert done.err == (
        "these are the pairs; --table controllers and --table claims print the others\n"
    )
    assert eqt("compare", "results/c", "--format", "csv", "-q").err == ""
    assert eqt("compare", "results/c", "-q").err == ""
    done = eqt("compare", "results/c", "--format", "csv", "--json")
    assert (done.code, done.err) == (
        2,
        "eqt: error: --json prints one document for all tables; leave --format out\n",
    )


SWEEP = ["sweep", "c.yaml", "--grid", "gains.kp=1,2", "--set", "ensemble.runs=6", "--out", "s"]


def test_a_sweep_is_compared_point_by_point(eqt, folder):
    assert eqt(*SWEEP, "-q").code == 0
    done = eqt("compare", "s", "--metric", "effort")
    assert done.code == 0
    assert "at 2 points of 6 runs each" in done.out
    assert "counts, times the number of points: with probability" in " ".join(done.out.split())
    found = json.loads(eqt("compare", "s", "--metric", "effort", "--json").out)["points"]
    assert [(row["point"], row["gains.kp"]) for row in found] == [(0, 1), (1, 2)]
    assert "at 2 points" not in eqt("compare", "s", "--table", "points").out
    shares = json.loads(eqt("compare", "s", "--metric", "settled", "--json").out)["points"]
    assert all(0 <= row["mean of eqt"] <= 1 for row in shares)  # of runs, which no file stores
    done = eqt("compare", "s", "--table", "pairs")
    assert done.code == 2
    assert "apply to one experiment; choose a point of the sweep with --point" in done.err


def test_a_sweep_with_positions_says_who_is_nearer_and_who_points_better(eqt):
    """The attitude may be another law's; both answers stand before the points."""
    short = ["--set", "ensemble.runs=2", "--set", "time.duration=1", "--set", "time.samples=11"]
    eqt("sweep", "se3", "--grid", "ensemble.seed=1,2", *short, "--out", "s", "-q")
    lines = [line for line in eqt("compare", "s").out.splitlines() if ", at 2 points" in line]
    assert [line.partition(", at")[0] for line in lines] == [
        "Which law has the better rms of ‖p − p_d‖",
        "Which law has the better mean attitude error",
    ]


def test_a_result_of_two_samples_is_compared(eqt):
    eqt("run", "c.yaml", "--set", "time.samples=2", "--out", "two", "--quiet")
    assert eqt("compare", "two").code == 0


@pytest.mark.ci("flies a quadrotor at two speeds")
@pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler")
def test_the_verdict_of_a_quadrotor_is_that_of_a_plain_program(invoke, tmp_path):
    """At each speed: the paired t-interval of rms ‖p − p_d‖, from the poses of the file alone."""
    config = Path(__file__).parents[2] / "configs" / "quadrotor_speeds.yaml"
    brief = [
        "--set",
        "time.duration=3",
        "--set",
        "time.samples=151",
        "--set",
        "solver.cross_check=0",
        "--engine",
        "native",
    ]
    invoke("sweep", config, *brief, "--out", tmp_path / "s", "--quiet")
    with h5py.File(tmp_path / "s" / "results.h5") as file:
        poses, desired = file["pose"][:], file["desired_pose"][:]
    for point in (0, 1):
        off = poses[point, ..., :3, 3] - desired[point][..., :3, 3]
        rms = np.sqrt(np.trapezoid((off**2).sum(axis=-1), dx=1 / 150, axis=-1))
        interval = ttest_rel(rms[1], rms[0]).confidence_interval()
        found = json.loads(invoke("compare", tmp_path / "s", "--point", point, "--json").stdout)
        [pair] = [row for row in found["pairs"] if row["metric"] == "position_rms"]
        assert (pair["first"], pair["second"]) == ("lqr", "cascade")
        assert pair["word"] == "better" and interval.high < 0
        assert pair["difference"] == pytest.approx((rms[1] - rms[0]).mean(), rel=1e-3)
        # The bootstrap's ends are those of t up to the skewness of 20 runs.
        half = (interval.high - interval.low) / 2
        assert pair["low"] == pytest.approx(interval.low, abs=0.3 * half)
        assert pair["high"] == pytest.approx(interval.high, abs=0.3 * half)


def test_identical_runs_have_no_statistics(eqt):
    """The ratio is that of the numbers in the file."""
    start = "--set", "initial={pose: {kind: fixed, coordinates: [2, 0, 0]}}"
    fixed = *start, "--set", "ensemble.runs=10", "--set", "time.duration=1", "-q"
    eqt("run", "c.yaml", *fixed, "--out", "r")
    lines = eqt("compare", "r").out.splitlines()
    with h5py.File("r/results.h5") as file:
        first, second = file["effort"][:, 0]
    assert lines[0] == (
        "all 10 runs of each law are identical, so there is nothing to estimate: no intervals and "
        "no p"
    )
    [law] = [line for line in lines if line.startswith("GT")]
    assert f" {100 * (second / first - 1):+.0f} % ".replace("-", "−") in law
    assert not any("p=" in line or "[" in line for line in lines)
    eqt("sweep", "c.yaml", *fixed, "--grid", "gains.kp=1,2", "--out", "s")
    whole = eqt("compare", "s").out
    assert re.search(r"identical runs +2\n", whole)
    assert "All 10 runs of a law are identical, so no test can decide." in whole


def test_laws_with_other_gains_are_named_first_and_claims_not_judged(invoke, tmp_path):
    """The paper's EqT, and GT with twice its stiffness, which tracks better for that alone."""
    text = (Path(__file__).parents[2] / "configs" / "paper.yaml").read_text()
    laws = "controllers: [eqt, { kind: gt, gains: { kp: 2 } }]"
    (tmp_path / "unequal.yaml").write_text(re.sub(r"(?m)^controllers: .*$", laws, text))
    invoke("run", tmp_path / "unequal.yaml", *SMALL, "--out", tmp_path / "result")
    compare = "compare", tmp_path / "result", "--resamples", 99
    first, *rest = invoke(*compare).stdout.splitlines()
    assert first == "gains are not matched: GT: 2 times the stiffness of EqT"
    assert "claims" not in "".join(rest)  # two of the paper's laws are missing
    compared = json.loads(invoke(*compare, "--json").stdout)
    verdicts = {row["verdict"] for row in compared["claims"] if "held" not in row}
    assert verdicts == {"not comparable"}
    table = invoke(*compare, "--table", "claims").stdout
    assert "not comparable: the two laws have not one stiffness and damping" in table
