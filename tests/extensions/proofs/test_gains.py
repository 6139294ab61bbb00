"""Gains with a proof: against closed forms, fractions of a second program, and planted laws."""

from __future__ import annotations

import json
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from case_tables import in_ci
from plain_errors import INERTIA, POINTS, J, cross, forces, fractions, is_definite
from plugin_sources import component
from said import says

import eqt_cli
from eqt_cli.api.loading import document_from
from eqt_cli.base.errors import ConfigError
from eqt_cli.config.preflight import build
from eqt_cli.extensions.proofs import certified as proofs
from eqt_cli.extensions.proofs import gains

pytest.importorskip("clarabel", reason="the extra certify is not installed")
pytestmark = pytest.mark.needs("search")

PAPER = yaml.safe_load(Path("configs/paper.yaml").read_text(encoding="utf-8"))
RANGE = {"log": [0.1, 100]}


def tuning(*laws: Any, **tune: Any) -> dict[str, Any]:
    """The paper's body, with a section `tune`."""
    section = {
        "over": {"gains.kp": RANGE, "gains.kd": RANGE},
        "objective": "certified_rate",
        "proof": {"velocity": 1.2},
        "subject_to": {"step_torque": 5},
        "confirm": {"runs": 3},
    }
    short = {"ensemble": {"runs": 2}, "time": {"duration": 1.0, "samples": 11}, "solver": {}}
    return PAPER | short | {"name": "small", "controllers": [*laws], "tune": section | tune}


def best(config: Any) -> list[dict[str, Any]]:
    """The records of the best gains of each law, without the held-out runs."""
    from eqt_cli.extensions.search.tune import Search, prover_of

    search = Search.read(document_from(config, {}))
    prover = prover_of(search.section)
    return [prover.gains(law, search.section, search.base) for law in search.laws]


def refused(config: Any) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        best(config)
    return [f"{problem.path}: {problem.message}" for problem in caught.value.problems]


# Against closed forms -----------------------------------------------------------------------------

WHEEL: dict[str, Any] = {
    "group": "SO2",
    "inertia": 0.4,
    "gains": {"kp": 1.0, "kd": 0.8},
    "reference": {"kind": "constant"},
    "initial": {"pose": "haar"},
}


@pytest.mark.ci("searches twice, in as many directions as for a user")
@pytest.mark.parametrize("v", [0.0, 2.0])
def test_the_best_gains_of_a_wheel_are_critically_damped(v: float) -> None:
    # 𝕀x″ + k_d x′ + 2k x = 0: the fastest with k_d² = 8k𝕀, and a step takes the torque 2k + k_d v.
    config = tuning("gt", proof={"velocity": v}, subject_to={"step_torque": 3.0}) | WHEEL
    [law] = best(config)
    k_d = 0.4 * 2 * (-v + np.sqrt(v**2 + 3.0 / 0.4))
    # 1e-3 of the torque is left free; beside the fastest k_d, the rate falls as a square root.
    assert law["objectives"][0] == pytest.approx(k_d / 0.8, rel=0.02)
    assert law["values"]["gains.kd"] == pytest.approx(k_d, rel=0.02)
    assert 2 * law["values"]["gains.kp"] + law["values"]["gains.kd"] * v <= 3.0


def wheel_loop(**changes: Any) -> Any:
    [loop] = build(document_from(tuning("gt") | WHEEL | changes, {})).loops.values()
    return loop


def test_numbers_at_rest_are_those_of_the_oscillator() -> None:
    numbers = gains.at_rest(wheel_loop())
    assert numbers["bandwidth"] == pytest.approx(np.sqrt(2 / 0.4))
    assert numbers["damping"] == pytest.approx(0.8 / (2 * np.sqrt(2 * 0.4)))
    [margins] = eqt_cli.margins(tuning("gt") | WHEEL | {"tune": None}).laws
    assert numbers["delay_margin"] == pytest.approx(margins.delay)


def step_loop(label: str) -> Any:
    [loop] = build(document_from(tuning(label, subject_to={}), {})).loops.values()
    return loop


BOX = [(Fraction(-6, 5), Fraction(6, 5))] * 3


@pytest.mark.parametrize("label", POINTS)
@pytest.mark.parametrize("angle", [60, 120])
def test_the_torque_at_a_step_is_that_of_the_formula(label: str, angle: float) -> None:
    # The stiffness 2k sin θ points anywhere, the rest is that of the corner: the sizes add up.
    e, corners = np.zeros(3), map(np.array, product((-1.2, 1.2), repeat=3))
    fixed = max(np.linalg.norm(forces(label, e, -wd, wd)) for wd in corners)
    largest = fixed + np.linalg.norm(forces(label, np.array([1.0, 0, 0]), e, e)) * np.sin(
        np.radians(min(angle, 90))
    )
    size = gains.step_torque(step_loop(label), BOX, np.radians(angle))
    assert size == pytest.approx(largest, rel=1e-5)  # the last turns are 0.002 of the angle apart


@pytest.mark.parametrize("label", ["eqt", in_ci("as the other", "lee2012")])
def test_no_random_step_takes_a_larger_torque(label: str) -> None:
    loop, random = step_loop(label), np.random.default_rng(1)
    turns = random.normal(size=(20_000, 3))
    turns *= np.radians(random.uniform(60, 90, 20_000))[:, None] / np.linalg.norm(
        turns, axis=1, keepdims=True
    )
    Q, Vd = loop.group.exp(turns), 1.2 * random.choice([-1.0, 1.0], size=turns.shape)
    s = proofs.tracking(loop, Q, 0 * Vd, loop.group.identity + 0 * Q, Vd, 0 * Vd, {})
    largest = np.linalg.norm(loop.command(s), axis=-1).max()
    size = gains.step_torque(loop, BOX, np.radians(90))
    assert largest <= size == pytest.approx(largest, rel=0.01)


def test_faster_gains_prove_a_faster_rate() -> None:
    def rate(T: float, v: float) -> float:
        config = tuning("eqt") | {"gains": {"kp": T**2, "kd": T / 2}, "tune": None}
        [law] = eqt_cli.certified(config, [v])
        return float(law.rates[0].rate)

    # The rate is homogeneous, up to what the programs leave; so it grows at least like T at one v.
    assert rate(2.0, 2.4) == pytest.approx(2 * rate(1.0, 1.2), rel=0.01)
    assert rate(2.0, 1.2) > 2 * rate(1.0, 1.2)


# Against a second program -------------------------------------------------------------------------


def plain_A(label: str, k: Fraction, k_d: Fraction, wd: Any) -> Any:
    """A of the documentation in fractions, with any gains."""
    g, c, n = map(Fraction, POINTS[label])
    inertia, at, columns = np.array(INERTIA, dtype=object), np.array(wd, dtype=object), []
    rows = inertia
    inverse = np.array(
        [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])]
    ).T / (rows[0] @ cross(rows[1], rows[2]))
    for x in np.array([[Fraction(i == j) for j in range(6)] for i in range(6)], dtype=object):
        e, w = x[:3], x[3:]
        force = -2 * k * e - k_d * w - (1 - g) * cross(w, inertia @ at)
        force = force - (1 - c) * cross(at, inertia @ w) + n * (inertia @ cross(w, at))
        columns.append([*(w + cross(e, at)), *(inverse @ force)])
    return np.array(columns).T


@pytest.fixture(scope="module")
def few() -> Any:
    """Fewer directions than a user has; the proof is the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gains, "TRIED", 4)
        yield


@pytest.mark.ci("searches for the gains of a law, as the command does fast")
@pytest.mark.usefixtures("few")
def test_a_second_program_proves_the_winner() -> None:
    [gt] = best(tuning("gt"))
    k, k_d = (Fraction(repr(gt["values"][f"gains.{name}"])) for name in ("kp", "kd"))
    rate, P, v = Fraction(gt["proof"]["rate"]), fractions(gt["proof"]["P"]), Fraction(6, 5)
    products = [P @ plain_A("gt", k, k_d, w) + rate * P for w in product((-v, v), repeat=3)]
    assert is_definite(P)
    assert all(is_definite(-(M + M.T)) for M in products)
    assert 0.3 < gt["objectives"][0] <= rate <= gt["proof"]["slowest_rate"]
    assert gt["sentence"].startswith(
        "For every reference with |ω_d,i| ≤ 1.2 rad/s, small errors of GT with kp = "
    )
    assert gt["proved"] == f"0.122 → {gt['objectives'][0]}"


def torque_at_step(label: str, k: float, k_d: float, v: float) -> float:
    """The largest torque at 90° and a corner of the box, with any gains; J is the paper's."""
    g, c, n = POINTS[label]
    sizes = []
    for corner in product((-v, v), repeat=3):
        wd = np.array(corner)
        w = -wd
        fixed = cross(J @ w, w) - (1 - g) * cross(w, J @ wd) - (1 - c) * cross(wd, J @ w)
        sizes.append(np.linalg.norm(fixed - k_d * w + n * (J @ cross(w, wd))))
    return float(max(sizes)) + 2 * k


@pytest.mark.ci("proves rates at 60 gains of two laws")
@pytest.mark.parametrize("label", ["eqt", "asym"])
def test_no_gains_within_the_bound_are_better_by_2_percent(label: str) -> None:
    [law] = best(tuning(label))
    k, k_d = (law["values"][f"gains.{name}"] for name in ("kp", "kd"))
    tried = 0
    for a, b in product(np.geomspace(0.4, 2.5, 12), np.geomspace(0.5, 2.0, 12)):
        if torque_at_step(label, k * a, k_d * b, 1.2) > 5:
            continue
        changed = {"gains": {"kp": float(k * a), "kd": float(k_d * b)}, "tune": None}
        [other] = eqt_cli.certified(tuning(label) | changed, [1.2])
        assert float(other.rates[0].rate or 0) < 1.02 * law["objectives"][0]
        tried += 1
    assert tried > 50


# What a push does ---------------------------------------------------------------------------------


@pytest.mark.ci("18 programs at each gains")
@pytest.mark.usefixtures("few")
def test_a_push_turns_the_best_gains_least() -> None:
    [gt] = best(tuning("gt", objective="push_bound", proof={"velocity": 1.2, "push": "0.1 N m"}))
    values = {name: gt["values"][f"gains.{name}"] for name in ("kp", "kd")}
    [own] = eqt_cli.certified(tuning("gt") | {"gains": values, "tune": None}, [1.2], push=0.1)
    assert own.rates[0].gain.peak <= gt["objectives"][0] == pytest.approx(6.05, rel=0.03)
    assert "a push of at most 0.1 N m turns GT with kp = " in gt["sentence"]


# Planted laws, and what has no proof --------------------------------------------------------------

LAW = """
{name}(eqt_cli.components.laws.Controller):
    title: ClassVar[str] = "{name}"

    def torque(self, s):
        Q_E = s.G.inverse(s.Qd) @ s.Q
        e = s.G.vee(Q_E - Q_E.swapaxes(-1, -2)) / 2
        w = s.V - s.Vd
        kp, kd = s.gains.K[..., 0, :1], s.gains.K_d[..., 0, :1]
        feedforward = s.inertia.momentum(s.Vd_dot) - s.G.ad_star(s.V, s.inertia.momentum(s.V))
        return feedforward * {feedforward} - 2 * kp * e * {stiffness} - kd * w * {damping}
"""
PLANTED = {
    "right": ("1", "1", "1"),
    "pushes": ("1", "1", "-1"),
    "flees": ("1", "-1", "1"),
    "forgets": ("0", "1", "1"),
    "cubic": ("1", "s.Q[..., :1, 0]", "1"),
}


@pytest.mark.ci("searches for the gains of five laws")
@pytest.mark.usefixtures("few")
def test_planted_laws_have_no_proof_or_a_slower_one(tmp_path: Path) -> None:
    sources = []
    for name, parts in PLANTED.items():
        factors = dict(zip(("feedforward", "stiffness", "damping"), parts, strict=True))
        sources.append(component(LAW.format(name=name, **factors)))
    (tmp_path / "planted.py").write_text("\n".join(sources), encoding="utf-8")
    labels = [*PLANTED]
    config = tuning(*labels, subject_to={}, over={"gains.kp": [0.5, 1.0], "gains.kd": [0.5, 1.5]})
    config["plugins"] = [str(tmp_path / "planted.py")]
    found = dict(zip(labels, best(config), strict=True))
    none = "no proof was found with any gains of these ranges and bounds"
    assert found["pushes"]["why"] == found["flees"]["why"] == none
    assert "depends on the desired pose" in found["cubic"]["why"]
    # The right one cancels the gyroscopic terms, so that its errors do not see the reference.
    assert found["right"]["objectives"][0] > 1.2 * found["forgets"].get("objectives", [0.0])[0]


def test_bounds_that_no_gains_keep_say_by_how_much() -> None:
    [law] = best(tuning("gt", subject_to={"step_torque": 0.1}) | WHEEL | {"inertia": 4.0})
    assert law["values"] == {}
    assert law["why"].startswith("no gains keep the bounds; the least miss is ")


def test_a_stiffness_in_space_is_refused_by_its_reason() -> None:
    [law] = best(tuning("gt") | {"gains": {"kp": [1, 2, 3], "kd": 0.5}})
    assert law["why"] == "has a stiffness or damping in space that depends on the desired pose R_d"


def test_a_loop_without_any_proof_is_refused_before_runs() -> None:
    [said] = refused(tuning("gt", "eqt") | {"control": {"period": 0.1}})
    assert says(said, "tune.objective: no law has a proof: 'gt' is sampled…")


def test_what_does_not_go_with_a_proof_is_refused_at_its_place() -> None:
    names = "step_torque, bandwidth, delay_margin, damping"
    why = f"certified_rate has no runs; expected a number above 0 of {names}"
    assert refused(tuning("gt", subject_to={"effort": 5})) == [f"tune.subject_to.effort: {why}"]
    every = {"step_torque": {"max": 5}}
    assert refused(tuning("gt", subject_to=every)) == [f"tune.subject_to.step_torque: {why}"]
    assert refused(tuning("gt", objective="push_bound")) == [
        "tune.proof.push: push_bound needs the size of a push, such as 0.1 N m"
    ]
    assert refused(tuning("gt", proof={"velocity": [1.0, 2.0]})) == [
        "tune.proof.velocity: expected a number or 3 of them, got 2"
    ]
    assert refused(tuning("gt", proof={"velocity": [1.0, -2.0, 1.0]})) == [
        "tune.proof.velocity: expected 0 or more, as it is the size of V_d, got -2"
    ]
    rigid = {"group": "SE3", "inertia": [1, 1, 1, 2, 2, 2], "gains": {"kp": 1, "kd": 1}}
    still = {
        "reference": {"kind": "constant"},
        "initial": {"pose": {"kind": "exp_normal", "std": 1}},
    }
    assert refused(tuning("lee2012") | rigid | still) == [
        "tune.subject_to.step_torque: needs a group of rotations alone, got SE3; leave it out"
    ]


@pytest.mark.ci("searches for the gains of a law")
@pytest.mark.usefixtures("few")
def test_a_sentence_claims_no_more_than_the_box_of_its_proof() -> None:
    box = {"velocity": ["1 deg/s", "1 deg/s", "3 deg/s"]}
    options = {"over": {"controllers[0].gyroscopic": [0.8, 1.0]}, "subject_to": {}}
    law = {"kind": "family", "transport": 0.5, "connection": 0.5}
    [best_law] = best(tuning(law, proof=box, **options))
    # π/180 is 0.01745329…, which six digits would round up.
    start = "For every reference with |ω_d,i| ≤ 0.0174532, 0.0174532, 0.0523598 rad/s, small errors"
    assert best_law["sentence"].startswith(f"{start} of family with gyroscopic = ")


# The command --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unarranged", "few")
def test_the_command_prints_what_is_proved_and_keeps_it(
    eqt: Any, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "300")
    config = tuning("gt", objective="mean_pose_error") | WHEEL
    Path("t.yaml").write_text(json.dumps(config), encoding="utf-8")
    plan = eqt("tune", "t.yaml", "--objective", "certified_rate", "--dry-run")
    assert plan.out == "runs     at most 6 to judge the outcome\n"
    done = eqt("tune", "t.yaml", "--objective", "certified_rate", "--out", "out")
    assert done.code == 0
    notes = done.out.splitlines()
    [answer] = (line for line in notes if line.startswith("Best proved rate, 1/s: GT "))
    sentence = notes[notes.index(answer) + 1]
    assert sentence.startswith("For every reference with |ω_d,i| ≤ 1.2 rad/s, small errors of GT ")
    assert "To first order; no limits, delays or noise." in done.out
    assert "# For every reference with" in Path("out/tuned/gt.yaml").read_text(encoding="utf-8")
    assert "Best proved rate, 1/s: " in eqt("show", "out").out
    record = json.loads(Path("out/tuning.json").read_text(encoding="utf-8"))
    assert record["proved"]["objective"] == "certified_rate"
