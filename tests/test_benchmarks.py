"""What the benchmarks compare is the same work, and what they measure with counts all of it."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml

from benchmarks import (
    delays,
    figure,
    others,
    profile,
    quadrotor,
    sampled,
    table,
    waits,
    whole_command,
)
from benchmarks.cases import errors, load
from benchmarks.contenders.plain_loop import WRITTEN_OUT, body, literal
from benchmarks.contenders.rotorpy_loop import RotorPy
from benchmarks.machine import machine
from benchmarks.process import Spent, spent
from eqt_cli.extend import SolveIvp


@pytest.mark.parametrize("xp", [np, WRITTEN_OUT], ids=["numpy.cross", "written out"])
@pytest.mark.parametrize("t", [0.0, 1.7])
@pytest.mark.parametrize("name", ["paper", "se3"])
def test_literal_equations_are_those_of_the_configuration(name, t, xp):
    """Q̇ and V̇ of every law at a state and a reference state without any symmetry."""
    case = load(name, runs=1)
    random = np.random.default_rng(3)
    for law, loop in case.experiment.loops.items():
        G = loop.group
        Q, Qd = G.exp(random.standard_normal((2, G.dimension)))
        V, Vd = random.standard_normal((2, G.dimension))
        rate = loop.vector_field(t, loop.initial_state(Q, V, Qd, Vd))
        y = literal(case).start(Q, V, Qd, Vd)
        Q_dot, V_dot = literal(case).motion(literal(case).field(xp, t, y, law, body(case)))
        q, m = G.pose_length, G.dimension
        # The same sums in another order; their terms are up to some 100.
        np.testing.assert_allclose(G.pack(Q_dot), rate[:q], rtol=0, atol=1e-13)
        momentum_rate = loop.inertia.at(t).momentum(V_dot)
        np.testing.assert_allclose(momentum_rate, rate[q : q + m], rtol=0, atol=1e-12)


@pytest.mark.ci("integrates in plain Python, for the benchmarks only")
@pytest.mark.parametrize(
    "period", [0.1, pytest.param(0.01, marks=pytest.mark.ci("takes ten times as many steps"))]
)
@pytest.mark.parametrize(
    "way",
    ["plain loop", pytest.param("MuJoCo", marks=pytest.mark.ci("components/test_oracles.py"))],
)
def test_contenders_integrate_the_same_sampled_loop(way, period):
    case = load("paper", 1, [f"control.period={period}", "time.duration=1", "time.samples=21"])
    runs = np.array([0])
    if way == "MuJoCo":
        pytest.importorskip("mujoco")
        references = sampled._references(case, period)
        found = sampled._stepped(case, period, references, runs)
    else:
        found = sampled._plainly(case, period, runs)
    own = sampled._by(case, SolveIvp(rtol=1e-10, atol=1e-13))(runs)
    # Steps of 5 ms by MuJoCo's method: of order 4 since 4.0, of order 2 before.
    assert errors(found, own).max() < (1e-4 if way == "MuJoCo" else 1e-8)


@pytest.mark.ci("flies a second plain program; that of the paper is tried fast")
def test_the_plain_crazyflie_flies_as_the_configuration():
    """Steps of order 4, of 2 ms: measured 2e-8 over half a second."""
    overrides = [*sampled._undisturbed(), "time.duration=0.1", "time.samples=6"]
    case, runs = load("crazyflie", 1, overrides), np.array([0])
    own = sampled._by(case, SolveIvp(rtol=1e-10, atol=1e-12))(runs)
    assert errors(sampled._flown(case, runs), own).max() < 1e-7


def test_rotorpy_flies_the_same_quadrotor():
    """Vehicle, law, path and start are the same; what differs are the solvers."""
    pytest.importorskip("rotorpy", reason="RotorPy is not installed; make oracles installs it")
    case = load("quadrotor", 1, quadrotor.settings(0.1), quadrotor.CONFIG.parent)
    own = quadrotor._solved(case, SolveIvp(rtol=1e-10, atol=1e-13), np.array([0]))
    tight = RotorPy(quadrotor.TIGHT)
    for fly in (tight.loop, tight.environment):
        found = quadrotor._flown(case, fly, np.array([0]))
        # A hundred times the tolerance of `solve_ivp`; measured 5e-14.
        assert errors(found, own).max() < 1e-8


def test_a_process_of_rotorpy_starts_once_for_all_runs(monkeypatch):
    """1 run in 3 s and 4 runs in 9 s: a further run takes 2 s, and 100 take 201 s."""
    took = {"range(1)": 3.0, "range(4)": 9.0, "": 1.0}

    def measure(arguments, environment=None):
        wall = next(took[word] for word in took if word in arguments[1])
        return Spent(wall, 2 * wall, 1)

    monkeypatch.setattr(quadrotor, "spent", measure)
    monkeypatch.setattr(quadrotor.rotorpy_loop, "missing", lambda: None)
    eqt, other = quadrotor._processes(6.0, 100, 2, first=False)
    assert (eqt.wall, eqt.timed_runs) == (1.0, 100)
    assert (other.wall, other.cpu, other.timed_runs) == (201.0, 402.0, 4)


def test_a_stage_is_not_counted_for_the_one_that_begins_it(monkeypatch):
    clock = iter([1.0, 3.0, 7.0, 15.0, 31.0, 63.0])
    monkeypatch.setattr(profile.time, "process_time", lambda: next(clock))
    watch = profile.StopWatch()
    with watch.stage("signals"), watch.stage(profile.INTEGRATION):
        pass
    with watch.stage("cross-check"):  # what it integrates is its own
        monkeypatch.setattr(profile.time, "process_time", lambda: 63.0)
        with watch.stage(profile.INTEGRATION):
            monkeypatch.setattr(profile.time, "process_time", lambda: 127.0)
    assert watch.seconds == {
        profile.REST: 1.0 + 16.0,
        "signals": 2.0 + 8.0,
        profile.INTEGRATION: 4.0,
        "cross-check": 96.0,
    }


@pytest.mark.ci("imports everything in an interpreter of its own")
def test_every_stage_is_still_where_it_is_watched():
    code = (
        "from benchmarks.profile import StopWatch as S; w = S(); w.watch_stages(); print(w.missing)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=profile.ROOT
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


@pytest.mark.ci("starts processes, of the benchmarks only")
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_that_of_all_processes():
    child = "import time; x = bytearray(60_000_000); time.sleep(1)"
    both = (
        f"import subprocess, sys; x = bytearray(60_000_000); a = [sys.executable, '-c', {child!r}]"
    )
    assert spent(["-c", f"{both}; subprocess.run(a)"]).peak_memory > 120_000_000


def test_an_earlier_commit_is_checked_out_for_a_while(tmp_path, monkeypatch):
    monkeypatch.setattr(whole_command, "ROOT", tmp_path)
    author = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    (tmp_path / "file").write_text("first")
    for command in (["init"], ["add", "file"], [*author, "commit", "--message", "first"]):
        subprocess.run(["git", "-C", tmp_path, *command], check=True, capture_output=True)
    (tmp_path / "file").write_text("second")
    with whole_command.earlier("HEAD") as tree:
        assert (tree / "file").read_text() == "first"
    assert not tree.exists()
    with pytest.raises(LookupError, match="no-such"), whole_command.earlier("no-such"):
        pass


def test_whole_commands_run_configurations_that_there_are():
    ran = [arguments[1] for _, arguments, _ in whole_command._plan([]) if arguments[0] == "run"]
    assert "configs/se3_bluerov2_thrusters.yaml" in ran
    assert all((whole_command.ROOT / name).exists() for name in ran)


def measured(floor=0.25):
    """Results with one command, by two trees."""
    spent = {whole_command.NOW: Spent(3.0, 1.0, 4e7), whole_command.BEFORE: Spent(5.0, 2.5, 6e7)}
    command = whole_command.Command("margins paper", spent, floor=floor)
    return table.Results(machine(), "2026-01-01", {}, {}, commands=[command], load=[0.0])


def test_the_table_of_commands_tells_cpu_time_as_a_multiple_of_the_imports():
    [row] = [r for r in table.as_markdown(measured()).splitlines() if "margins paper" in r]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[-2:] == ["4.0", "10.0"]


def test_what_users_wait_for_is_told_beside_its_floor():
    results = measured()
    results.commands, results.waits = [], results.commands
    [row] = [r for r in table.as_markdown(results).splitlines() if "margins paper" in r]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:6] == ["1.00", "2.50", "2.50", "0.25", "4.0"]


def test_for_whom_eqt_is_slower_is_said_first_and_beside_what_users_wait_for():
    job, runs = waits.ALSO["run paper, 1 run"]
    results = measured()
    results.waits, results.commands = [replace(results.commands[0], name="run paper, 1 run")], []
    results.others = [
        others.Beside(job, runs, 0.9, "heyoka", 0.3, None, ""),
        others.Beside(job, runs, 0.9, "diffrax", 2.7, (2.0, 5.0), ""),
        others.Beside(job, 1000, 1.0, "diffrax", 4.0, None, ""),
    ]
    page = table.as_markdown(results)
    assert f"eqt is slower for: 1 × {job} (heyoka takes 0.33 of its time). CPU" in page
    [row] = [line for line in page.splitlines() if line.startswith("| run paper, 1 run |")]
    assert "| 3 (heyoka) |" in row
    [row] = [line for line in page.splitlines() if line.startswith(f"| {job} | 1 | diffrax |")]
    assert "| 3 | 2.5 |" in row
    assert {each.name for each in others._jobs()} >= {name for name, _ in waits.ALSO.values()}


def test_programs_run_in_turn_and_only_what_is_not_compiled_yet_in_the_first_pass(
    monkeypatch, tmp_path
):
    """Of CPU times that fall from process to process, the last counts; eqt's own part does not."""
    took = iter(range(100, 0, -1))
    order = []

    def measure(arguments, tree, environment, python=sys.executable):
        order.append((python, arguments[-1]))
        (tmp_path / "cache").mkdir(exist_ok=True)
        (tmp_path / "own").write_text("0.5")
        return Spent(1.0, float(next(took)), 1)

    monkeypatch.setattr(others, "spent", measure)
    job = others.Job("a job", "paper", (), {"heyoka": ["heyoka", "{}", others.OWN]})
    [small] = others._in_turn(job, 1, {"heyoka": "python"}, 2, tmp_path)
    [large] = others._in_turn(job, 9, {"heyoka": "python"}, 2, tmp_path)
    pair = [(sys.executable, "--force"), ("python", str(tmp_path / "own"))]
    assert order == [*pair, *pair, *pair, pair[0], *pair, *pair]
    assert (small.eqt, small.other, small.first) == (96.0, 94.5, (100.0, 98.5))
    assert (large.eqt, large.other, large.first) == (91.0, 89.5, None)


def test_jobs_that_users_wait_for_run_configurations_that_there_are():
    named = [word for arguments in waits.JOBS.values() for word in arguments if ".yaml" in word]
    assert len(named) > 7 and all((whole_command.ROOT / name).exists() for name in named)


def test_the_swept_job_has_10_000_points_of_one_run(tmp_path):
    config = yaml.safe_load(waits._swept(tmp_path / "sweep.yaml").read_text())
    [grid] = (entry["grid"] for entry in config["sweep"])
    assert np.prod([len(set(values)) for values in grid.values()]) == 10_000
    assert config["ensemble"]["runs"] == 1


def test_compiled_integration_is_timed_alone(tmp_path):
    run = ["run", "configs/satellite_wheels.yaml", "--engine", "native"]
    few = ["--set", "ensemble.runs=2", "--set", "time.duration=1"]
    assert 0 < waits._alone([*run, *few], tmp_path) < 1


def test_the_bars_of_commands_are_these_multiples():
    panel, *_ = figure.commands(measured()).axes
    assert sorted(bar.get_width() for bar in panel.patches) == [4.0, 10.0]
    assert [label.get_text() for label in panel.get_yticklabels()] == ["margins paper"]


def test_a_command_and_the_imports_are_measured_in_turn(monkeypatch, tmp_path):
    order = []

    def measure(arguments, tree=None, environment=None):
        order.append((arguments[0], tree))
        return Spent(1.0, float(len(order)), 1)

    monkeypatch.setattr(whole_command, "spent", measure)
    trees = {whole_command.NOW: "new", whole_command.BEFORE: "old"}
    found, floor = whole_command._in_turn(["margins"], trees, tmp_path, 2)
    assert order == 2 * [("-c", None), ("-m", "new"), ("-m", "old")]
    # The first pass fills the caches of the trees, and counts for the imports alone.
    assert floor == 1.0
    assert {tree: each.cpu for tree, each in found.items()} == {"now": 5.0, "before": 6.0}


@pytest.mark.ci("many estimates of delays")
def test_delays_are_named_and_covered_as_often_as_stated(monkeypatch):
    """Of 200 trials, at most 6 are false and 90 % contain the true delay, at 99.9 % by chance."""
    monkeypatch.setattr(delays, "TRIALS", 200)
    [cell] = [cell for cell in delays.CELLS if cell.name == "wave"]
    assert float(delays.shares(cell, 0.0).split(" | ")[0]) <= 5
    named, _, covered = map(float, delays.shares(cell, 0.05).split(" | "))
    assert (named, covered >= 90) == (100, True)
