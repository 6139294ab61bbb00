"""What the benchmarks compare is the same work, and what they measure with counts all of it."""

import subprocess
import sys

import numpy as np
import pytest

from benchmarks import profile, sampled, whole_command
from benchmarks.cases import errors, load
from benchmarks.contenders.plain_loop import WRITTEN_OUT, body, literal
from benchmarks.process import spent
from eqt_cli.engines.solve_ivp import SolveIvp


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


@pytest.mark.parametrize(
    "period", [0.1, pytest.param(0.01, marks=pytest.mark.slow("takes ten times as many steps"))]
)
@pytest.mark.parametrize("way", ["plain loop", "MuJoCo"])
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


def test_the_plain_crazyflie_flies_as_the_configuration():
    """Steps of order 4, of 2 ms: measured 2e-8 over half a second."""
    overrides = [*sampled._undisturbed(), "time.duration=0.1", "time.samples=6"]
    case, runs = load("crazyflie", 1, overrides), np.array([0])
    own = sampled._by(case, SolveIvp(rtol=1e-10, atol=1e-12))(runs)
    assert errors(sampled._flown(case, runs), own).max() < 1e-7


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


@pytest.mark.slow("imports everything in an interpreter of its own")
def test_every_stage_is_still_where_it_is_watched():
    code = (
        "from benchmarks.profile import StopWatch as S; w = S(); w.watch_stages(); print(w.missing)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=profile.ROOT
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


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
