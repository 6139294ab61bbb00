"""What is proved of pushes and of regions, against a second program and trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from plain_errors import INERTIA, K_D, POINTS, J, K, cross, exact_A, forces, fractions, is_definite
from scipy.linalg import expm
from threadpoolctl import threadpool_limits

import eqt_cli
from eqt_cli.base.errors import InputError
from eqt_cli.extensions.proofs import certified, identities
from eqt_cli.extensions.proofs.identities import forms_of_W, weights_of
from eqt_cli.extensions.proofs.sample import ExactStates, Proof, Refutation, prove

pytest.importorskip("clarabel", reason="the extra certify is not installed")

BOX = np.array([[-0.8172, 1.9253], [-1.6112, 1.9623], [-1.3215, 0.1369]])
"""The box of the paper's own reference, rad/s."""

PUSH = 0.1


def paper(*labels: str, **changes: Any) -> dict[str, Any]:
    config = yaml.safe_load(Path("configs/paper.yaml").read_text(encoding="utf-8"))
    return {**config, "controllers": [*labels], **changes}


# Trajectories of the second program ---------------------------------------------------------------


def hat(v: Any) -> Any:
    zero = 0 * v[0]
    rows = [[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]]
    return np.moveaxis(np.array(rows), -1, 0)


def sine(R: Any) -> Any:
    """e = sin θ n, ``(3, k)``."""
    pairs = [(2, 1), (0, 2), (1, 0)]
    return 0.5 * np.stack([R[:, a, b] - R[:, b, a] for a, b in pairs])


def rotation(v: Any) -> Any:
    """exp(v^) by Rodrigues' formula, ``(k, 3, 3)`` of ``(3, k)``."""
    angle, S = np.linalg.norm(v, axis=0)[:, None, None] + 1e-300, hat(v)
    return np.eye(3) + np.sin(angle) / angle * S + (1 - np.cos(angle)) / angle**2 * S @ S


def simulated(label: str, R: Any, w: Any, steps: int, dt: float, velocity: Any, push: Any) -> Any:
    """Yield R_dᵀR and ω̃ of many runs by Runge–Kutta in R's entries; ω_d and w hold for a step."""

    def rates(R: Any, w: Any, wd: Any, tau: Any) -> Any:
        return R @ hat(w + wd) - hat(wd) @ R, np.linalg.solve(
            J, forces(label, sine(R), w, wd) + tau
        )

    for step in range(steps):
        wd, tau = velocity(step), push(step)
        k1 = rates(R, w, wd, tau)
        k2 = rates(R + dt / 2 * k1[0], w + dt / 2 * k1[1], wd, tau)
        k3 = rates(R + dt / 2 * k2[0], w + dt / 2 * k2[1], wd, tau)
        k4 = rates(R + dt * k3[0], w + dt * k3[1], wd, tau)
        R = R + dt / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        w = w + dt / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        yield R, w


def angle_of(R: Any) -> Any:
    cosine = (np.trace(R, axis1=1, axis2=2) - 1) / 2
    return np.degrees(np.arctan2(np.linalg.norm(sine(R), axis=0), cosine))


# Pushes -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def gains() -> dict[str, Any]:
    laws = eqt_cli.certified(paper("eqt", "gt"), push=PUSH)
    return {law.label: law.rates[0].gain for law in laws}


def matrices(label: str) -> tuple[Any, Any]:
    """A at 0 and its slopes, and the lower half of B, in floats."""
    (zero, B), *others = (
        exact_A(label, [Fraction(k == i) for k in range(3)]) for i in (3, 0, 1, 2)
    )
    return np.array([zero, *(A - zero for A, _ in others)], dtype=float), B[3:].astype(float)


def proves(
    label: str, proof: dict[str, Any], *, energy: bool, larger: Fraction = Fraction(1)
) -> bool:
    Q, alpha, mu = fractions(proof["Q"]), Fraction(proof["alpha"]), Fraction(proof["mu"]) / larger
    one = np.array([[Fraction(i == j) for j in range(3)] for i in range(3)], dtype=object)
    for corner in product(*([Fraction(str(x)) for x in side] for side in BOX)):
        A, B = exact_A(label, corner)
        if energy:
            top = A @ Q + Q @ A.T + B @ B.T
            M = np.block([[top, Q[:, :3]], [Q[:3], -mu * one]])
        else:
            M = A @ Q + Q @ A.T + alpha * Q + B @ B.T / alpha
        if not is_definite(-M):
            return False
    return is_definite(Q) and (energy or is_definite(mu * one - Q[:3, :3]))


@pytest.mark.parametrize(("label", "most", "least"), [("eqt", 25.9, 22.9), ("gt", 17.03, 14.8)])
def test_gains_of_the_paper_are_proved_by_a_second_program(
    label: str, most: float, least: float, gains: dict[str, Any]
) -> None:
    one = gains[label]
    assert least <= one.aligned <= one.peak <= most
    assert one.peak == pytest.approx(
        np.degrees(PUSH * float(Fraction(one.proofs["peak"]["mu"])) ** 0.5)
    )
    assert one.energy**2 == pytest.approx(float(Fraction(one.proofs["energy"]["mu"])))
    assert proves(label, one.proofs["peak"], energy=False)
    assert proves(label, one.proofs["energy"], energy=True)


def test_the_second_program_refuses_gains_that_are_not_proved(gains: dict[str, Any]) -> None:
    one, smaller = gains["eqt"].proofs, Fraction(1001, 1000)
    assert not proves("eqt", one["peak"], energy=False, larger=smaller)
    assert not proves("eqt", one["energy"], energy=True, larger=smaller)
    assert not proves("nog", one["peak"], energy=False)


def linear_pushes(label: str, gain: Any, runs: int) -> float:
    """The largest ‖ε‖ of random pushes and references, deg; and the energies stay below γ."""
    A, B = matrices(label)
    random, x, dt = np.random.default_rng(1), np.zeros((runs, 6, 1)), 0.25
    largest, energies = 0.0, np.zeros((2, runs))
    for step in range(160):
        if step % 4 == 0:
            share = np.where(
                random.uniform(size=(runs, 3)) < 0.5,
                np.round(random.uniform(size=(runs, 3))),
                random.uniform(size=(runs, 3)),
            )
            wd = BOX[:, 0] + share * (BOX[:, 1] - BOX[:, 0])
        # The best push at this instant is along the error's own velocity, with some noise.
        w = (
            x[:, 3:, 0]
            + 0.3 * random.standard_normal((runs, 3)) * np.abs(x[:, 3:, 0]).max()
            + 1e-9 * random.standard_normal((runs, 3))
        )
        w *= PUSH / np.linalg.norm(w, axis=1, keepdims=True)
        wide = np.zeros((runs, 9, 9))
        wide[:, :6, :6], wide[:, 3:6, 6:] = A[0] + np.tensordot(wd, A[1:], axes=1), B
        before = np.linalg.norm(x[:, :3, 0], axis=1)
        moved = expm(wide * dt)
        x = moved[:, :6, :6] @ x + moved[:, :6, 6:] @ w[..., None]
        after = np.linalg.norm(x[:, :3, 0], axis=1)
        energies += np.array([dt * np.minimum(before, after) ** 2, dt * PUSH**2 + 0 * after])
        largest = max(largest, float(after.max()))
    # The smaller end of each step leaves out a part of the integral, so this bound is not sharp.
    assert (energies[0] <= gain.energy**2 * energies[1]).all()
    return float(np.degrees(largest))


@pytest.mark.parametrize("label", ["eqt", "gt"])
def test_random_pushes_stay_below_the_bound(label: str, gains: dict[str, Any]) -> None:
    with threadpool_limits(1):
        reached = linear_pushes(label, gains[label], 20)
    assert 0.4 * gains[label].peak < reached <= gains[label].peak


def aligned(
    label: str, at: Sequence[float], steps: int = 1500, dt: float = 0.08
) -> tuple[Any, float]:
    """The aligned push at a constant ω_d, and what it reaches on the linear loop, deg."""
    A, B = matrices(label)
    A0 = A[0] + np.tensordot(at, A[1:], axes=1)
    wide = np.zeros((9, 9))
    wide[:6, :6], wide[3:6, 6:] = A0, B
    moved = expm(wide * dt)
    pulses = [moved[:6, 6:]]
    for _ in range(steps - 1):
        pulses.append(moved[:6, :6] @ pulses[-1])
    H, best = np.array(pulses)[:, :3], (0.0, np.zeros((steps, 3)))
    for c in np.random.default_rng(0).standard_normal((40, 3)):
        w = (c / np.linalg.norm(c)) @ H
        size = np.linalg.norm(w, axis=1, keepdims=True)
        best = max(best, (float(size.sum()), w / size), key=lambda each: each[0])
    return best[1][::-1], float(np.degrees(PUSH * best[0]))


@pytest.mark.parametrize("label", ["eqt", "gt"])
def test_the_aligned_push_reaches_what_is_printed(label: str, gains: dict[str, Any]) -> None:
    _, reached = aligned(label, gains[label].at)
    # The search here is coarse: forty directions.
    assert 0.985 * gains[label].aligned < reached < 1.002 * gains[label].aligned


def full_pushes(label: str, gain: Any, runs: int, size: float = PUSH / 10) -> tuple[float, float]:
    """The largest angles of the aligned push, and of random ones, on the full loop, deg."""
    push, _ = aligned(label, gain.at)
    at, turn = np.array(gain.at)[:, None], np.tile(np.eye(3), (1, 1, 1))
    path = simulated(
        label,
        turn,
        np.zeros((3, 1)),
        len(push),
        0.08,
        lambda _: at,
        lambda k: size * push[k][:, None],
    )
    first = max(float(angle_of(R).max()) for R, _ in path)
    random = np.random.default_rng(2)
    draws = random.uniform(BOX[:, :1], BOX[:, 1:], size=(40, 3, runs))
    pushes = random.standard_normal((80, 3, runs))
    pushes *= size / np.linalg.norm(pushes, axis=1, keepdims=True)
    path = simulated(
        label,
        np.tile(np.eye(3), (runs, 1, 1)),
        np.zeros((3, runs)),
        800,
        0.05,
        lambda k: draws[k // 20],
        lambda k: pushes[k // 10],
    )
    return first, max(float(angle_of(R).max()) for R, _ in path)


def test_pushes_of_a_tenth_stay_below_the_bound_on_the_full_loop(gains: dict[str, Any]) -> None:
    first, random = full_pushes("gt", gains["gt"], 10)
    assert random < first
    # At a tenth of the size, the first order is right to a per cent.
    assert 0.97 * gains["gt"].aligned / 10 < first < gains["gt"].peak / 10


@pytest.mark.ci("a thousand pushes on both loops")
@pytest.mark.parametrize("label", ["eqt", "gt"])
def test_a_thousand_pushes_stay_below_the_bound(label: str, gains: dict[str, Any]) -> None:
    with threadpool_limits(1):
        assert linear_pushes(label, gains[label], 1000) <= gains[label].peak
        assert max(full_pushes(label, gains[label], 1000)) <= gains[label].peak / 10


# Regions ------------------------------------------------------------------------------------------


def exact_rate(label: str, x: Any, z: Any, wd: Any, N: Any, M: Any) -> Fraction:
    """(1 + x²)Ẇ in fractions, from ė, ω̃̇ and L̇ = −k_d ω̃² by the product rule."""
    J = np.array(INERTIA, dtype=object)
    e, w, s = z[:3], z[3:], x @ x
    R = np.eye(3, dtype=int) * (1 - s) + 2 * np.outer(x, x)  # (1 + s)R without its odd part
    R = R + 2 * np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]], dtype=object)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    e_dot = (trace * w - R.T @ w) / 2 + (1 + s) * cross(e, wd)
    sine = 2 * x / (1 + s)
    # z is free in the form, but e in the cubic term and in the force is that of x.
    free = forces(label, e, w, wd, J) - cross(J @ w, w)
    cubic = sine @ N @ cross(J @ w, w)
    damping = -Fraction(1, 2) * (w @ w)
    return (1 + s) * (damping + e @ N @ free + cubic) + e_dot @ N @ (J @ w) + e @ M @ e_dot


@pytest.mark.parametrize(
    ("count", "least"),
    [(40, 3), pytest.param(1000, 50, marks=pytest.mark.ci("a thousand boxes in fractions"))],
)
def test_intervals_hold_the_exact_values(count: int, least: int) -> None:
    """T of boxes, against fractions at points in them; at least so many are ≺ 0 for sure."""
    random, surely = np.random.default_rng(3), 0
    sides = 2.0 ** -random.integers(2, 9, count)
    centres = random.integers(-2000, 2000, (count, 3)) / 1024
    shares = random.integers(-64, 65, (count, 3)) / 64
    for centre, side, share in zip(centres, sides, shares, strict=True):
        label = ("eqt", "gt", "nog")[random.integers(3)]
        N, M = random.integers(-64, 65, (2, 3, 3)) / 512
        N, M = N + np.eye(3) / 4, M + M.T
        wd, z = random.integers(-64, 65, 3) / 128, random.integers(-9, 10, 6)
        law = [certified.Ball.of(v) for v in weights_of((*POINTS[label], 0.0), K, K_D, J)]
        x = certified.Ball(centre[:, None], np.eye(3)[..., None] * side, np.zeros((3, 1)))
        _, T = forms_of_W(
            x, certified.Ball.of(wd[:, None]), law, certified.Ball.of(N), certified.Ball.of(M)
        )
        c, s, r, t, zs = (rational(v) for v in (T.c, T.s, T.r, share, z))
        at = c + sum(t[i] * s[i] for i in range(3))
        point = rational(centre) + t * Fraction(float(side))
        exact = exact_rate(label, point, zs, rational(wd), rational(N), rational(M))
        assert abs(exact - zs @ at @ zs) <= abs(zs) @ r @ abs(zs)
        if (-1.0 * T).is_positive():
            surely += 1
            columns = [
                exact_rate(
                    label, point, np.array(v, dtype=object), rational(wd), rational(N), rational(M)
                )
                for v in _pairs()
            ]
            assert is_definite(-_from_pairs(columns))
    assert surely > least


def rational(v: Any) -> Any:
    numbers = [Fraction(float(a)) for a in np.ravel(v)]
    return np.array(numbers, dtype=object).reshape(np.shape(v))


@cache
def _pairs() -> list[list[Fraction]]:
    one = [[Fraction(i == j) for j in range(6)] for i in range(6)]
    return [
        [a + b for a, b in zip(one[i], one[j], strict=True)] for i in range(6) for j in range(i + 1)
    ]


def _from_pairs(values: Sequence[Fraction]) -> Any:
    """A symmetric matrix from its form at e_i + e_j."""
    M, known = np.full((6, 6), Fraction(0), dtype=object), iter(values)
    rows = {(i, j): next(known) for i in range(6) for j in range(i + 1)}
    for i in range(6):
        M[i, i] = rows[i, i] / 4
    for (i, j), value in rows.items():
        if i != j:
            M[i, j] = M[j, i] = (value - M[i, i] - M[j, j]) / 2
    return M


def test_a_matrix_that_may_be_indefinite_is_not_positive() -> None:
    A = np.diag([1.0, 1e-3, 2.0])
    none = np.zeros((3, 3, 3))
    assert certified.Ball(A, none, 0.9e-3 * np.eye(3)).is_positive()
    assert not certified.Ball(A, none, 1.1e-3 * np.eye(3)).is_positive()
    assert not certified.Ball(
        A, np.stack([2e-3 * np.eye(3), *np.zeros((2, 3, 3))]), 0 * A
    ).is_positive()
    assert not certified.Ball.of(np.diag([1.0, -1e-12, 1.0])).is_positive()


AXIS = np.array([0.25, 0.25, -0.25])[:, None]
AT, SMALL = AXIS[None], np.tan(np.radians(45) / 2)
"""A constant ω_d, rad/s, as the only corner; and tan(θ/2) of the largest angle."""


@cache
def small_region(label: str) -> Any:
    """The region up to 45° for a constant ω_d, which takes two seconds and not a minute."""
    law = weights_of((*POINTS[label], 0.0), K, K_D, J)
    rate, N, M = certified.designed(law, AT, SMALL)
    _, holds = certified.proved(law, AT, SMALL, rate, N, M)
    return certified.Region(45.0, rate if holds else None, [], N.tolist(), M.tolist())


def check_region(label: str, one: Any, runs: int, draws: Any) -> None:
    """Starts in the region obey W(t) ≤ e^(−λt) W(0), and θ stays below its largest angle."""
    random = np.random.default_rng(4)
    N, M, most = np.array(one.N), np.array(one.M), 2 * K * (1 - np.cos(np.radians(one.angle)))
    axis, w = random.standard_normal((2, 3, runs))
    theta = np.radians(one.angle) * random.uniform(size=runs) ** 0.5
    R = rotation(theta * axis / np.linalg.norm(axis, axis=0))
    # Half of the starts have all the energy that the region allows.
    share = np.where(np.arange(runs) % 2, 1.0, random.uniform(size=runs))
    energy = share * (most - 2 * K * (1 - np.cos(theta)))
    w *= np.sqrt(2 * energy / np.einsum("ik,ij,jk->k", w, J, w))

    def W(R: Any, w: Any) -> Any:
        e = sine(R)
        L = 0.5 * (w * (J @ w)).sum(0) + K * (3 - np.trace(R, axis1=1, axis2=2))
        return L + (e * (N @ J @ w)).sum(0) + 0.5 * (e * (M @ e)).sum(0)

    first, dt = W(R, w), 0.02
    assert (first > 0).all()
    path = simulated(label, R, w, 20 * len(draws), dt, lambda k: draws[k // 20], lambda _: 0.0)
    for step, (at, speed) in enumerate(path):
        # Runge–Kutta errs by 1e-6 here.
        assert (W(at, speed) <= first * np.exp(-one.rate * dt * (step + 1)) + 1e-6).all()
        assert (angle_of(at) <= one.angle + 1e-3).all()


def test_starts_in_a_region_return_at_its_rate() -> None:
    one = small_region("eqt")
    assert one.rate > 0.15
    check_region("eqt", one, 40, np.tile(AXIS, (30, 1, 40)))


@pytest.mark.ci("regions up to 120 degrees, and ten thousand starts")
@pytest.mark.parametrize(("label", "least"), [("eqt", 0.085), ("gt", 0.10)])
def test_regions_of_the_paper(label: str, least: float) -> None:
    [law] = eqt_cli.certified(paper(label), [0.5], start=120.0)
    one = law.rates[0].region
    assert one.rate >= least
    # The failures that are known are the three half-turns at rest, where L = 4k.
    largest = 2 * K * (1 - np.cos(np.radians(one.angle)))
    assert largest < 4 * K
    for angle, speed in one.starts:
        L = np.linalg.eigvalsh(J).max() * speed**2 / 2 + 2 * K * (1 - np.cos(np.radians(angle)))
        assert pytest.approx(largest) == L
    random = np.random.default_rng(5)
    inner, outer = (
        random.uniform(-0.5, 0.5, (60, 3, 10_000)),
        random.choice([-0.5, 0.5], (60, 3, 1)),
    )
    with threadpool_limits(1):
        check_region(label, one, 10_000, np.where(np.arange(10_000) % 2, inner, outer))


def test_a_planted_sign_has_no_region() -> None:
    # c = −1 of EqT: L rises, no W is found, and EqT's own W does not prove it.
    one, planted = small_region("eqt"), weights_of((1.0, -1.0, 0.0, 0.0), K, K_D, J)
    matrices = np.array(one.N), np.array(one.M)
    assert one.rate > 0 and certified.designed(planted, 8 * AT, SMALL)[0] == 0.0
    assert not certified.proved(planted, AT, SMALL, one.rate, *matrices)[1]


def test_a_region_is_refused_at_a_larger_rate_angle_or_velocity() -> None:
    one, law = small_region("eqt"), weights_of((*POINTS["eqt"], 0.0), K, K_D, J)
    matrices = np.array(one.N), np.array(one.M)
    assert not certified.proved(law, AT, SMALL, 1.1 * one.rate, *matrices)[1]
    assert not certified.proved(law, AT, 1.5 * SMALL, one.rate, *matrices)[1]
    assert not certified.proved(law, 4 * AT, SMALL, one.rate, *matrices)[1]


def refusal(**changes: Any) -> str:
    [law] = eqt_cli.certified(paper(**({"controllers": ["eqt"]} | changes)), [0.5], start=30.0)
    return law.refused or law.rates[0].region.refused


def test_what_has_no_region_is_refused_by_name() -> None:
    none = "has no proved region: "
    of_space = f"{none}only laws (g, c, n) with errors in space on SO3 have one"
    assert refusal(controllers=["lee2010"]) == of_space
    planted = {"kind": "family", "transport": -1.0}
    off = f"{none}L falls if c + n is 1, and here c + n − 1 is "
    assert refusal(controllers=[planted]) == f"{off}-2"
    nearly = {"kind": "family", "transport": 1 - 0.7, "connection": 0.7}  # 0.30000000000000004
    assert refusal(controllers=[nearly]) == f"{off}4e-17"
    limited = refusal(actuators=[{"kind": "limit", "limit": 1.0}])
    assert limited == f"{none}torque limited"
    stiff = "has a stiffness or damping in space that depends on the desired pose R_d"
    assert refusal(gains={"kp": [1.0, 2.0, 3.0], "kd": K_D}) == stiff


def test_pushes_are_bounded_on_rotations_only() -> None:
    [law] = eqt_cli.certified(
        {
            "group": "SO2",
            "inertia": [1.0],
            "gains": {"kp": 1.0, "kd": 1.0},
            "reference": {"kind": "constant"},
            "controllers": ["eqt"],
            "time": {"duration": 1.0},
        },
        [0.5],
        push=1.0,
    )
    none = "has no proved bound for a disturbance: "
    assert str(law.rates[0].gain) == f"{none}eqt proves one on SO3 only"
    assert law.rates[0].rate  # which needs no push

    limited = paper("eqt", actuators=[{"kind": "limit", "limit": 0.01}])
    [law] = eqt_cli.certified(limited, [0.5], push=PUSH)  # more than the vehicle can give
    assert str(law.rates[0].gain) == f"{none}torque limited"


def test_a_gain_does_not_depend_on_the_unit_of_the_wrench() -> None:
    """ẍ = −x − ẋ/2 + w about three axes, and the same with w in units from 1e-8 to 1e8."""
    one, none = np.eye(3, dtype=int), np.zeros((3, 3), dtype=int)
    A = np.block([[none, one], [-one, -one * Fraction(1, 2)]]) + Fraction(0)
    B = np.vstack([none, one]) + Fraction(0)
    for share in (0.2, 0.0):
        mu = Fraction(certified._bounded([A], B, share)["mu"])
        for unit in (Fraction(1, 10**8), Fraction(1, 1000), Fraction(10**5), Fraction(10**8)):
            other = Fraction(certified._bounded([A], B * unit, share)["mu"])
            assert float(other / unit**2 / mu) == pytest.approx(1.0, rel=1e-3)


def test_what_is_not_proved_is_said_and_numbers_have_digits() -> None:
    assert str(certified.Gain(0.1)) == "has no proved bound for a disturbance of 0.1 N m"
    tiny = certified.Gain(1e-5, 0.00231, 0.00204, [0.0] * 3, 2.0093e-4, {})
    assert str(tiny) == (
        "is rotated by at most 0.002310° by a disturbance of 1e-05 N m to first order, and by "
        "0.002040° at the worst constant V_d; L2 gain 0.0002010 rad/(N m)"
    )
    slow = certified.Region(120.0, 1.239e-5, [[60.0, 0.004567]])
    assert str(slow) == (
        "from every start within 120° at rest or 60° and 0.00456 rad/s: W falls at 1.239e-05 1/s "
        "or faster"
    )


@pytest.mark.parametrize(("push", "start"), [(-1.0, 0.0), (float("nan"), 0.0), (0.0, 180.0)])
def test_what_cannot_be_asked_is_refused_first(push: float, start: float) -> None:
    with pytest.raises(InputError, match="expected 0"):
        certified.check_push_and_start(push, start)


# The evidence: W and its rate are those of the code -----------------------------------------------


@pytest.mark.parametrize("label", ["eqt", "gt", "nog", "asym"])
def test_the_forms_are_W_and_its_rate_along_the_code(label: str) -> None:
    loop = eqt_cli.load_experiment("configs/paper.yaml").experiment(0).loops[label]
    states = ExactStates(label, loop, np.random.default_rng(0))
    assert isinstance(prove(identities.sides_of_W, states), Proof)


@pytest.mark.parametrize("point", [(-1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.5)])
def test_code_of_other_weights_has_no_region(
    point: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = eqt_cli.load_experiment("configs/paper.yaml").experiment(0).loops["eqt"]
    claimed = (*point, 0.0, "spatial", "spatial")
    monkeypatch.setitem(identities.MEMBERS, "eqt", claimed)
    states = ExactStates("eqt", loop, np.random.default_rng(0))
    assert isinstance(prove(identities.sides_of_W, states), Refutation)
    refused = certified.region("eqt", loop, [(Fraction(-1), Fraction(1))] * 3, 30.0).refused
    assert refused.startswith("has no proved region: ")


# The theorem: W = L + δ eᵀ𝕀ω̃ ----------------------------------------------------------------------


def test_the_inequalities_of_the_theorem() -> None:
    """T + λV ≼ 0 with the δ and λ of the page, at random laws, inertias, poses and velocities."""
    random = np.random.default_rng(6)
    for _ in range(300):
        frame = np.linalg.qr(random.standard_normal((3, 3)))[0]
        inertia = frame @ np.diag(random.uniform(0.2, 3.0, 3)) @ frame.T
        k, k_d, v, g, n = random.uniform((0.1, 0.1, 0.0, -1.0, -1.0), (3.0, 3.0, 4.0, 2.0, 2.0))
        largest = np.linalg.eigvalsh(inertia).max()
        b = k_d + (abs(1 - n) + abs(1 - g) + abs(n)) * largest * v
        delta = min(4 * k * k_d / (b**2 + 16 * k * largest), np.sqrt(k / (2 * largest)))
        theta = np.radians(random.uniform(1, 175))
        level = 2 * k * (1 - np.cos(theta))
        kappa = delta * np.sqrt(largest / (2 * k))
        rate = (1 - 0.5**0.5) / (1 + kappa) * min(delta * (4 * k - level) / (2 * k), k_d / largest)
        axis, wd = random.standard_normal((2, 3, 200))
        x = np.tan(theta / 2) * random.uniform(size=200) * axis / np.linalg.norm(axis, axis=0)
        wd *= v * random.uniform(size=200) / np.linalg.norm(wd, axis=0)
        law = weights_of((g, 1 - n, n, 0.0), k, k_d, inertia)
        V, T = forms_of_W(x.T[..., None], wd.T[..., None], law, delta * np.eye(3), np.zeros((3, 3)))
        assert rate > 0 and np.linalg.eigvalsh(V).min() > 0
        assert np.linalg.eigvalsh(T + rate * V).max() <= 1e-12 * np.abs(T).max()
