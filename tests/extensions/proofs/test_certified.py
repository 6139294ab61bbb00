"""Certified rates: A(V_d), and the proofs by a second program."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from plain_errors import POINTS, exact_A, fractions, is_definite
from scipy.linalg import expm
from threadpoolctl import threadpool_limits

import eqt_cli
from eqt_cli.extend import EqtError
from eqt_cli.extensions.proofs.certified import affine
from eqt_cli.loop.linearised import linearised

pytest.importorskip("clarabel", reason="the extra certify is not installed")


def proves(label: str, rate: Fraction, rows: Sequence[Sequence[str]], v: Fraction) -> bool:
    """By a second program, which knows fractions only."""
    P = fractions(rows)
    products = (P @ exact_A(label, w)[0] + rate * P for w in product((-v, v), repeat=3))
    falls = all(is_definite(-(M + M.T)) for M in products)
    return bool((P == P.T).all()) and falls and is_definite(P)


# The rates of the paper's laws --------------------------------------------------------------------

FIGURES = {
    "0.5": {"eqt": 0.1185, "gt": 0.1383, "nog": 0.0849, "asym": 0.1408},
    "1.2": {"eqt": 0.0702, "gt": 0.1220, "nog": 0.0289, "asym": 0.1406},
    "2.3": {"eqt": 0.0310, "gt": 0.0757, "nog": 0.0092, "asym": 0.1398},
}
"""Rates, 1/s, that a prototype proved, by v, rad/s."""

PAIRS = [(label, v) for v, row in FIGURES.items() for label in row]


@pytest.fixture(scope="module")
def paper() -> dict[tuple[str, str], Any]:
    laws = eqt_cli.certified("configs/paper.yaml", [float(v) for v in FIGURES])
    assert not any(law.refused for law in laws)
    return {(law.label, v): one for law in laws for v, one in zip(FIGURES, law.rates, strict=True)}


@pytest.mark.parametrize(("label", "v"), PAIRS)
def test_rates_of_the_paper_are_proved_by_a_second_program(
    label: str, v: str, paper: dict[tuple[str, str], Any]
) -> None:
    one = paper[label, v]
    assert FIGURES[v][label] <= one.rate <= one.slowest_rate
    assert proves(label, one.rate, one.P, Fraction(v))


def test_the_second_program_refuses_what_is_not_proved(paper: dict[tuple[str, str], Any]) -> None:
    one = paper["eqt", "1.2"]
    assert not proves("eqt", one.rate * Fraction(1001, 1000), one.P, Fraction("1.2"))
    assert not proves("eqt", one.rate, one.P, Fraction("1.21"))
    assert not proves("nog", one.rate, one.P, Fraction("1.2"))


def test_rates_never_rise_with_the_bound() -> None:
    # Without care, rounding lets that of slotine_li rise by 1e-5 of it.
    bounds = [0.25, 0.5, 1.2]
    laws = eqt_cli.certified(_reviewers("slotine_li", "gt"), bounds)
    for law in laws:
        rates = [one.rate for one in law.rates]
        assert rates == sorted(rates, reverse=True)
        assert [one.velocity[0] for one in law.rates] == [[-v, v] for v in bounds]


def test_the_law_of_lee_2010_has_one_rate_at_any_bound() -> None:
    [law] = eqt_cli.certified(_reviewers("lee2010"), [0.5, 50.0])
    assert 0.1408 < law.rates[0].rate == law.rates[1].rate < 0.1410


def test_the_box_of_the_reference_is_the_default(paper: dict[tuple[str, str], Any]) -> None:
    eqt, *_ = eqt_cli.certified("configs/paper.yaml")
    [one] = eqt.rates
    assert np.ravel(one.velocity).tolist() == pytest.approx(
        [-0.8172, 1.9253, -1.6112, 1.9623, -1.3215, 0.1369], abs=1e-4
    )
    assert 0.0495 <= one.rate < one.slowest_rate


# A(V_d) against the formula, and against finite differences of the loop ---------------------------


def _reviewers(*labels: str, file: str = "configs/reviewers.yaml") -> Any:
    config = yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    kinds = ((x, x if isinstance(x, str) else x["kind"]) for x in config["controllers"])
    return {**config, "controllers": [law for law, kind in kinds if kind in labels]}


@pytest.mark.parametrize("label", POINTS)
def test_A_is_the_equation_of_the_documentation(label: str) -> None:
    A = affine(eqt_cli.load_experiment("configs/paper.yaml").experiment(0).loops[label])
    w = [Fraction(3, 7), Fraction(-2, 5), Fraction(9, 4)]
    found = A[0] + sum(k * M for k, M in zip(w, A[1:], strict=True))
    assert (found == exact_A(label, w)[0]).all()


def test_A_is_that_of_finite_differences() -> None:
    experiment = eqt_cli.load_experiment("configs/reviewers.yaml").experiment(0)
    loops, G = experiment.loops, experiment.group
    times = np.array([0.7, 3.1])
    poses = G.exp(np.array([[0.3, -0.7, 0.2], [1.0, 0.4, -0.5]]))
    velocities = np.array([[0.4, -1.1, 0.3], [-0.8, 0.5, 1.4]])
    for label, loop in loops.items():
        linear = linearised(loop, times, poses, velocities)
        state = loop.initial_state(poses, velocities, poses, velocities, times)
        rates = loop.tracking(times, state).Vd_dot
        A = affine(loop).astype(float)
        for closed, V, rate in zip(linear.closed, velocities, rates, strict=True):
            mine = A[0] + np.tensordot(V, A[1:], axes=1)
            T, change = np.eye(len(mine)), np.zeros_like(mine)
            T[3:6, :3], change[3:6, :3] = G.ad_matrix(V), G.ad_matrix(rate)
            carried = np.linalg.inv(T) @ (mine @ T - change)  # of Ṽ = e + ad_{V_d} ε
            error = min(np.abs(each - closed).max() for each in (mine, carried))
            # The differences err by 1e-12 of the largest values, about 10.
            assert error < 1e-9, label


# Trajectories of the linearised loop along random references --------------------------------------


@pytest.mark.parametrize("label", ["eqt", "nog"])
def test_no_random_reference_is_slower(label: str, paper: dict[tuple[str, str], Any]) -> None:
    one, random = paper[label, "1.2"], np.random.default_rng(0)
    A = affine(eqt_cli.load_experiment("configs/paper.yaml").experiment(0).loops[label]).astype(
        float
    )
    half = np.linalg.cholesky(np.array([[float(Fraction(x)) for x in row] for row in one.P])).T
    x = random.standard_normal((100, 6, 1))
    start, elapsed = np.linalg.norm(half @ x, axis=(1, 2)), np.zeros(100)
    with threadpool_limits(1):
        for _ in range(12):
            V, dt = 1.2 * random.uniform(-1, 1, (100, 3)), random.exponential(0.7, 100)
            x, elapsed = (
                expm((A[0] + np.tensordot(V, A[1:], 1)) * dt[:, None, None]) @ x,
                elapsed + dt,
            )
            bound = np.exp(-float(one.rate) * elapsed) * start
            assert (np.linalg.norm(half @ x, axis=(1, 2)) <= bound).all()


# What has no certificate --------------------------------------------------------------------------


def refusal(config: Any, **changes: Any) -> str:
    [law, *_] = eqt_cli.certified({**config, **changes}, [0.5])
    return law.refused


SPIN: dict[str, Any] = {
    "group": "SO3",
    "inertia": [2.0, 1.0, 3.0],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"kind": "constant"},
    "controllers": ["eqt"],
    "time": {"duration": 2.0},
}

LAG = [{"kind": "lag", "time_constant": 0.1}]
RIGID = {"group": "SE3", "inertia": [1.0, 1.0, 1.0, 2.0, 2.0, 2.0], "controllers": ["lee2012"]}
GRAVITY = [{"kind": "restoring", "weight": 19.62}]


def test_a_stiffness_in_space_is_refused() -> None:
    why = "has a stiffness or damping in space that depends on the desired pose R_d"
    assert refusal(SPIN, gains={"kp": [1.0, 2.0, 3.0], "kd": 0.5}) == why
    assert refusal(SPIN, gains={"kp": 1.0, "kd": [0.5, 0.6, 0.7]}) == why
    assert refusal(SPIN, gains={"kp": [1.0, 2.0, 3.0], "kd": 0.5}, controllers=["lee2012"]) == ""


def test_sampled_and_lagging_loops_are_refused() -> None:
    why = "acts through actuators that lag"
    assert refusal(SPIN, control={"period": 0.1}) == "is sampled"
    drag = {"forces": [{"kind": "drag", "linear": 0.1}]}
    unknown = "has forces or an inertia unknown to it, or time-varying numbers"
    assert refusal(SPIN, control={"period": 0.1}, plant=drag) == f"is sampled; {unknown}"
    assert refusal(SPIN, actuators=LAG) == why
    assert refusal(SPIN, actuators=LAG, controllers=["lee2010"]) == why
    assert refusal(SPIN, actuators=[{"kind": "limit", "limit": 1.0}]) == ""


def test_an_inertia_that_changes_is_refused() -> None:
    why = "has forces or an inertia unknown to it, or time-varying numbers"
    turning = {"matrix": [["2+sin(t)", 0, 0], [0, 1, 0], [0, 0, 3]]}
    assert refusal(SPIN, inertia=turning, rigid=False) == why


def test_gravity_is_refused() -> None:
    why = "has forces or an inertia unknown to it, or time-varying numbers"
    assert refusal(SPIN | RIGID, plant={"forces": GRAVITY}) == why


def test_without_clarabel_one_line_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(EqtError) as caught:
        eqt_cli.certified(SPIN, [0.5])
    expected = "certified rates need Clarabel (extra certify): pip install clarabel"
    assert str(caught.value) == expected


def test_a_loop_without_a_certificate_has_no_rate() -> None:
    [law] = eqt_cli.certified(_reviewers("goodarzi2013"), [2.3])
    [one] = law.rates
    assert (one.rate, one.P) == (None, None)
    assert one.slowest_rate < 0  # at a corner: the constant reference itself is unstable


@pytest.mark.ci("12 states, as on SE(3)")
def test_a_law_on_se3_is_certified() -> None:
    [law] = eqt_cli.certified(_reviewers("lee2012", file="configs/reviewers_se3.yaml"), [0.3])
    assert 0.0918 <= law.rates[0].rate <= law.rates[0].slowest_rate < 0.0920
