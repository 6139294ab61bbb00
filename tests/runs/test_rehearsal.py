"""`config check` finds what a run would fail with, in one message with file and line."""

from pathlib import Path

import pytest
from case_tables import from_yaml
from plugin_sources import component
from small_experiment import configuration

LAW = component("""
import numpy as np
from eqt_cli.extend import dot
own(eqt_cli.extend.Controller):
    title: ClassVar[str] = "Own"
    gain: float = 1.0

    def torque(self, s):
        return BODY
""")
FORCE = component("""
import numpy as np
push(eqt_cli.extend.Force):
    departs: ClassVar[str] = "a push"

    def acting(self, G, t, Q, V):
        return BODY
""")
CONFIG = configuration(controllers="[eqt, CONTROLLERS]", solver=None, plugins="[own.py]")
OWN = "{kind: own, gain: 2.0}"
TOGETHER = "fails when runs are solved together, with every number of a law as an array (runs, 1): "


@pytest.fixture
def check(folder, invoke):
    """What `config check` says of a law with this torque, or of another text of the plugin."""

    def said(body, *sets, code=2, text=LAW, controllers=OWN, more="", command="config check"):
        Path("own.py").write_text(text.replace("BODY", body), encoding="utf-8")
        config = CONFIG.replace("CONTROLLERS", controllers) + more
        Path("c.yaml").write_text(config, encoding="utf-8")
        words = [f"--set={each}" for each in sets]
        done = invoke(*command.split(), "c.yaml", *words, code=code)
        return done.stderr if code else done.stdout

    return said


@from_yaml
def test_a_law(check, body, expected):
    said = check(body)
    where = "1 error in c.yaml\nc.yaml:5:20: controllers[1]: controller 'own' "
    assert said.startswith(where + expected.replace("TOGETHER: ", TOGETHER))
    assert said.count("\n") == 2


NET = component("""
import numpy as np
from eqt_cli.extend import apply_matrix, tanh
random = np.random.default_rng(1)
IN, OUT = random.standard_normal((300, 3)), random.standard_normal((3, 300))
SHIFT = random.standard_normal(300)
REST = apply_matrix(OUT, tanh(SHIFT))
own(eqt_cli.extend.EqT):
    title: ClassVar[str] = "Net"

    def torque(self, s):
        x = apply_matrix(IN, s.V_tilde) + SHIFT
        return super().torque(s) + 1e-3 * (apply_matrix(OUT, tanh(x)) - REST)
""")
ROTORS = """
actuators: [{kind: thrusters, time_constant: 0.02, low: 0, high: 50, thrust_constant: 1.0e-8,
  matrix: [[1, -1, 0, 0], [0, 0, 1, -1], [0.1, 0.1, -0.1, -0.1]]}]
"""


@pytest.mark.needs("thrusters")
def test_rounding_that_a_root_enlarges_mixes_no_runs(check):
    """A thrust that is 0 but for rounding: the root of 1e-18 N over 1e-8 N s² is 1e-5 rad/s."""
    still = ("initial={}", "ensemble.runs=1", "reference={torque: [0, 0, 0]}")
    check("", *still, text=NET, controllers="own", more=ROTORS, code=0)


@pytest.mark.needs("proofs")
@pytest.mark.parametrize("command", ["run", "verify"])
def test_a_law_that_mixes_runs_does_not_run_either(check, command):
    said = check("-s.V / np.max(np.abs(s.V))", command=command)
    assert "controller 'own' mixes runs: the rates of a run change by " in said


def test_nor_does_a_force(check):
    push = {"text": FORCE, "controllers": "gt", "more": "plant: {forces: [{kind: push}]}\n"}
    assert "mixes runs: the rates of a run" in check(
        "-V / np.max(np.abs(V))", command="run", **push
    )


LYAPUNOV = (
    LAW.replace("BODY", "-s.V")
    + """
    def lyapunov(self, s):
        return BODY
"""
)


@pytest.mark.parametrize("text", [LAW, LYAPUNOV], ids=["torque", "lyapunov"])
def test_a_number_goes_into_a_contraction_and_not_before_one(check, text):
    """`dot` has no last axis, along which a number of a run would be (runs, 1)."""
    right, wrong = "dot(self.gain * s.V, s.V)", "self.gain * dot(s.V, s.V)"
    energy = wrong  # the product that the message names
    if text is LAW:
        right, wrong = (f"-({each})[..., None] * s.V" for each in (right, wrong))
    check(right, text=text, code=0)
    said = check(wrong, text=text)
    assert all(word in said for word in ("(5, 1)", "(5,)", "[..., None]", energy))
    assert "(5, 1) and (5,)" in check(wrong, text=text, command="run")


def test_two_instances_of_a_law_are_solved_as_one(check):
    one, other = "{kind: own, gain: 2.0, label: a}", "{kind: own, gain: 3.0, label: b}"
    body = "-self.gain * s.V if np.size(self.gain) == 1 or np.ptp(self.gain) == 0 else 1 / 0"
    said = check(body, controllers=f"{one}, {other}")
    assert f"controllers[1]: controller 'own' {TOGETHER}ZeroDivisionError: " in said


def test_numbers_that_a_sweep_varies(check):
    body = "-self.gain * s.V if np.ptp(self.gain) == 0 else 1 / 0"
    check(body, code=0)
    more = "sweep: [{grid: {'controllers[1].gain': [1, 2, 3]}}]\n"
    assert f"controller 'own' {TOGETHER}ZeroDivisionError: " in check(body, more=more)


def test_a_law_that_cannot_be_compiled(check):
    body = "-np.maximum(s.V, 0.0)"
    said = check(body, "solver.engine=native")
    assert "controllers[1]: controller 'own' cannot be compiled: " in said
    assert f"own.py:14: return {body}" in said
    assert said.count("\n") == 2
    assert "cannot be compiled" not in check(body, "solver.engine=solve_ivp", code=0)


def test_a_torque_bound(check):
    check("-s.V", command="config check --most-torque 2", code=0)
    assert check("-s.V", command="config check --most-torque 0.5") == (
        "1 error in c.yaml\nc.yaml:4:1: reference: needs a torque of 1 at t = 0 s, more than 0.5\n"
    )


def test_a_check_keeps_to_its_time(check, monkeypatch):
    monkeypatch.setattr("eqt_cli.runs.preflight.MOST_SECONDS", -1.0)
    assert "not tried: eqt, own; the laws before took more than -1 s\n" in check("-s.V", code=0)
