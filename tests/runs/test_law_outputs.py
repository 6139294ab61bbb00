"""Numbers of laws over time in a result: memory that jumps or moves, and what they add."""

from pathlib import Path

import numpy as np
import pytest
from plugin_sources import component

import eqt_cli
from eqt_cli.extend import EqtError

# The mode jumps with hysteresis in the first velocity; `pair` holds what a law may add.
HYSTERESIS = component("""
from typing import Any
import numpy as np
from eqt_cli.extend import less, where
hysteresis(eqt_cli.components.laws.Controller):
    title: ClassVar[str] = "Hysteresis"
    output_units: ClassVar[dict] = {"pair": "rad/s"}

    def memory(self, G):
        return {"mode": 1, "integral": G.dimension}

    def torque(self, s):
        return s.tau_d - s.V_tilde * (2.0 + s.memory["mode"]) - 0.1 * s.memory["integral"]

    def answer(self, s, period):
        mode, first = s.memory["mode"], s.V[..., :1]
        mode = where(less(0.5, first), 1.0 + 0.0 * mode, where(less(first, 0.2), 0.0 * mode, mode))
        return self.torque(s), {"mode": mode, "integral": s.memory["integral"] + period * s.V}

    def outputs(self, G):
        return {**self.memory(G), "pair": 2}

    def output(self, s):
        return {**s.memory, "pair": 3.0 * s.V[..., :2]}
""")

CONFIG = {
    "name": "states",
    "group": "SO3",
    "inertia": [1.0, 1.2, 1.5],
    "gains": {"kp": 1.0, "kd": 1.0},
    "reference": {"kind": "rates", "rates": ["0.8*sin(3*t)", "0.1", "0.2*cos(t)"]},
    "controllers": ["eqt", "hysteresis", "goodarzi2013"],
    "control": {"period": 0.1},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.3}},
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 4.0, "samples": 41},
    "plugins": ["law.py"],
}
PERIOD = 0.1


def made(tmp_path, monkeypatch, **changes):
    monkeypatch.chdir(tmp_path)
    Path("law.py").write_text(HYSTERESIS, encoding="utf-8")
    return eqt_cli.run(CONFIG | changes, "out", force=True).to_xarray()


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_states_of_laws_are_stored_over_time(tmp_path, monkeypatch, forget_plugins, engine):
    data = made(tmp_path, monkeypatch, solver={"engine": engine})
    names = ["mode", *(f"integral_{k}" for k in (1, 2, 3)), "pair_1", "pair_2"]
    assert data.output.values.tolist() == names
    assert data.output.attrs["units"] == "1; rad; rad; rad; rad/s; rad/s"
    assert np.isnan(data.law_output.sel(controller="eqt")).all()
    V, own = (data[name].sel(controller="hysteresis").values for name in ("velocity", "law_output"))
    mode, integral, modes = np.zeros(2), np.zeros((2, 3)), []
    for k in range(41):  # samples are the instants: each shows what follows from those before it
        mode = np.where(V[:, k, 0] > 0.5, 1.0, np.where(V[:, k, 0] < 0.2, 0.0, mode))
        modes.append(mode)
    jumps = np.abs(np.diff(np.array(modes), axis=0)).sum()
    assert jumps >= 4
    # A sample at an instant shows the state after it; the run ends before its last instant.
    np.testing.assert_array_equal(own[:, :-1, 0], np.array(modes).T[:, :-1])
    integral = PERIOD * np.cumsum(V, axis=1)
    np.testing.assert_allclose(own[:, :-1, 1:4], integral[:, :-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(own[:, :, 4:], 3 * V[:, :, :2], rtol=0, atol=1e-14)
    known = data.law_output.sel(controller="goodarzi2013")
    assert np.isfinite(known.sel(output="integral_1")).all()
    assert np.isnan(known.sel(output="mode")).all()


def test_engines_store_the_same(tmp_path, monkeypatch, forget_plugins):
    one = made(tmp_path, monkeypatch, solver={"engine": "solve_ivp"})
    other = made(tmp_path, monkeypatch, solver={"engine": "native"})
    modes = (each.law_output.sel(controller="hysteresis", output="mode") for each in (one, other))
    np.testing.assert_array_equal(*modes)
    np.testing.assert_allclose(one.law_output, other.law_output, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("memory", "stored"), [("auto", True), (False, False)])
def test_the_option_says_whether(tmp_path, monkeypatch, forget_plugins, memory, stored):
    data = made(tmp_path, monkeypatch, store={"memory": memory}, solver={"engine": "native"})
    assert ("law_output" in data) == stored


def test_a_result_without_them_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = {**CONFIG, "controllers": ["eqt"], "plugins": []}
    eqt_cli.run(config, "out")
    with pytest.raises(EqtError, match="finds no numbers of laws: none has memory"):
        eqt_cli.plot("out", "commands", options={"law_outputs": True})
