"""The flights of examples/learned: their curves and starts, and the laws that fly them."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import yaml

import eqt_cli
from eqt_cli.extend import SE3

pytest.importorskip("onnx", reason="needs the extra network")
LEARNED = Path(__file__).parents[3] / "examples" / "learned"
CURVE = 7
UNREACHABLE = pytest.mark.filterwarnings("ignore:.*no law can follow it there")


@pytest.fixture(scope="module")
def learned():
    spec = importlib.util.spec_from_file_location("learned", LEARNED / "learned.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def flown(tmp_path, runs, duration, engine, **changes):
    """The metrics of each law on curve 3."""
    config = yaml.safe_load((LEARNED / "flights.yaml").read_text())
    del config["sweep"]
    config["plugins"] = [str(LEARNED / "learned.py")]
    for law in config["controllers"]:
        if "file" in law:
            law["file"] = str(LEARNED / law["file"])
    for section in (config["reference"], *config["initial"].values()):
        section["curve"] = 3
    config["ensemble"]["runs"] = runs
    config["time"] = {"duration": duration, "samples": round(50 * duration) + 1}
    config["solver"]["engine"] = engine
    config["store"] = {"trajectories": "all"}
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(config | changes))
    eqt_cli.run(tmp_path / "one.yaml", out=tmp_path / "one", workers=1)
    with eqt_cli.open_result(tmp_path / "one") as result:
        return {law: result.to_xarray().sel(controller=law) for law in result.labels}


def test_the_motion_of_a_curve_is_that_of_its_pose(learned):
    G, curve, t, h = SE3(), learned.Lissajous(CURVE), np.array([0.3, 4.1]), 1e-5
    (before, V0, _), (Q, V, V_dot), (after, V1, _) = (curve.motion(G, t + s) for s in (-h, 0, h))
    velocity = G.log(G.inverse(before) @ after) / (2 * h)
    np.testing.assert_allclose(V, velocity, atol=1e-8)
    np.testing.assert_allclose(V_dot, (V1 - V0) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(curve.flat_output(G, t).position[:, 0], Q[:, :3, 3])


def test_forward_differences_are_late_by_half_a_step_for_each_derivative(learned):
    G, h = SE3(), 0.02
    exact, given = (learned.Lissajous(CURVE, **d) for d in ({}, {"differences": h}))
    for order in range(1, 5):
        expected = exact.flat_output(G, 1.0 + order * h / 2).position[..., order, :]
        found = given.flat_output(G, 1.0).position[..., order, :]
        np.testing.assert_allclose(found, expected, rtol=4e-3)  # (ω h)² order/24, ω ≤ 3 rad/s


def test_a_run_starts_near_its_curve(learned):
    G, curve = SE3(), learned.Lissajous(CURVE)
    Qd, Vd, _ = curve.motion(G, 0.0)
    for run in range(20):
        generator = np.random.Generator(np.random.PCG64DXSM(run))
        relative, change = learned.start(CURVE, generator)
        Q, V = Qd @ relative, Vd + change
        moving = Q[:3, :3] @ V[3:] - Qd[:3, :3] @ Vd[3:]
        assert np.abs(Q[:3, 3] - Qd[:3, 3]).max() <= 0.5
        assert np.abs(moving).max() <= 0.1 + 1e-12
        assert np.abs(V[:3]).max() <= 0.1
        assert Q[2, 2] == pytest.approx(1.0)


@UNREACHABLE
def test_the_shipped_laws_begin_to_fly(tmp_path):
    laws = flown(tmp_path, 1, 0.3, "solve_ivp", metrics=["reward"])
    assert set(laws) == {"published", "tuned", "network"}
    for law in laws.values():
        assert np.isfinite(law.reward.values).all()


@UNREACHABLE
def test_with_a_round_inertia_the_attitude_law_is_that_of_lee(tmp_path):
    config = yaml.safe_load((LEARNED / "flights.yaml").read_text())
    ours, J = config["controllers"][0], 0.003
    ours["attitude"] = {"kind": "per_inertia", "kR": [700.0] * 3, "kW": [30.0] * 3}
    lee = ours | {"label": "lee", "attitude": "lee2010"}
    lee["gains"] = {"kp": 700.0 * J / 2, "kd": 30.0 * J}  # k_R is twice kp
    inertia = [J, J, J, 0.8, 0.8, 0.8]
    laws = flown(tmp_path, 1, 0.1, "solve_ivp", controllers=[ours, lee], inertia=inertia)
    np.testing.assert_allclose(laws["published"].pose, laws["lee"].pose, rtol=1e-9, atol=1e-9)


@UNREACHABLE
@pytest.mark.ci("three laws and five metrics are compiled, and fly 10 s")
def test_the_shipped_laws_fly_as_the_page_says(tmp_path):
    """Medians of 20 runs; the 10 of the page's sweep have 0.1 of the reward between quartiles."""
    laws = flown(tmp_path, 20, 10.0, "native")
    for law, reward, steady in (
        ("published", 14.00, 0.0002),
        ("tuned", 14.08, 0.0002),
        ("network", 14.39, 0.0143),
    ):
        assert np.median(laws[law].reward) == pytest.approx(reward, abs=0.1)
        assert np.median(laws[law].steady_error) == pytest.approx(steady, rel=0.5)
        assert not laws[law].lost.any()
