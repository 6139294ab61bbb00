"""Rates at which small errors decay along every reference whose velocity stays in a box, proved.

About a reference the loop is ẋ = A x to first order, with x = (ε, Ṽ or e, memory), Q = Q_d exp(ε).
Where A is affine in V_d and depends on nothing else, one P with AᵀP + PA + 2λP ≺ 0 at the corners
of a box proves ‖x(t)‖_P ≤ e^(−λt) ‖x(0)‖_P for every V_d(t) in it, however fast it changes. A is
computed exactly, semidefinite programs find P and λ in floats, and fractions prove them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import product
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, TraceError
from eqt_cli.components.groups import cayley
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.mechanics import Tracking
from eqt_cli.extensions.proofs import exact
from eqt_cli.extensions.proofs.exact import entrywise
from eqt_cli.extensions.proofs.identities import claimed_point, forms_of_W, sides_of_W, weights_of
from eqt_cli.extensions.proofs.sample import INVERSE, MATRIX, ExactStates, Proof, prove
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.linearised import off_limits
from eqt_cli.numbers.leaves import leaves, with_fields, with_leaves

# A(V_d), exactly ----------------------------------------------------------------------------------


def departures(loop: ClosedLoop) -> str:
    """Say why a loop has no certified rate, whatever its equations are: parts of it; else ""."""
    G, law, vehicle = loop.group, loop.controller, loop.vehicle
    varies = not isinstance(loop.inertia, Inertia) or law.held(G, 0.0) is not None
    free = loop.task.words(loop.gains)
    reasons = {
        f"leaves {free} free, so that not all small errors decay": bool(free),
        "is sampled": vehicle.control is not None,
        "acts through actuators that lag": vehicle.control is None and bool(vehicle.states(G)),
        "is a cascade": law.reads_flat_output,
        "has forces or an inertia unknown to it, or time-varying numbers": (
            bool(vehicle.forces) or vehicle.inertia is not None or varies
        ),
    }
    return "; ".join(why for why, holds in reasons.items() if holds)


def affine(loop: ClosedLoop) -> Array:
    """Return the fractions of A(V_d) = A₀ + Σ V_d,k A_k, ``(1 + m, n, n)``, in the law's own chart.

    Its velocity error is Ṽ = V − V_d if that gives such an A, else e = V − Ad_{Q_L⁻¹}V_d.

    Raises
    ------
    InputError
        If there is no such A; the message goes on from the name of the law.
    """
    loop = off_limits(loop)
    if why := departures(loop):
        raise InputError(why)
    # The decimal numbers of a configuration, and not the floats next to them.
    numbers = {p: entrywise(lambda x: _exact(repr(float(x))), v) for p, v in leaves(loop).items()}
    numbers[INVERSE] = exact.inverse(numbers[MATRIX])
    refusals, loop = [], with_leaves(loop, numbers)
    for carried in (0, 1):
        try:
            with exact.noting(exact.Ledger(lambda: exact.free(1))):  # for branches not taken
                return _matrices(loop, carried)
        except (InputError, exact.NotRationalError) as error:
            refusals.append(str(error))
    raise InputError(refusals[0])


def _exact(x: Any) -> exact.Exact:
    return exact.Exact(Fraction(x))


def _values(numbers: Array) -> Array:
    return entrywise(lambda number: exact.Exact.of(number).value, numbers)


def _matrices(loop: ClosedLoop, carried: int) -> Array:
    """Return the A_k in the chart of Ṽ, or of e with `carried` 1.

    They follow from A at V_d = 0 and along each axis. Then ẋ is compared at a random pose, and at a
    random V_d and V̇_d: a polynomial of degree d that is not 0 vanishes there with probability
    d / 2³² at most.
    """
    G, m = loop.group, loop.group.dimension
    n, random = 2 * m + sum(loop.controller.memory(G).values()), np.random.default_rng(0)
    drawn = [random.integers(-(2**31), 2**31, count) for count in (n, m, m, m)]
    any_x, any_V, any_rate, turn = (entrywise(lambda k: _exact(int(k)) / 2**31, k) for k in drawn)
    one, axes = np.eye(n), np.vstack([np.zeros(m), np.eye(m)])
    x = np.vstack([np.tile(one, (1 + m, 1)), [any_x] * 2])
    Vd, poses = np.vstack([np.repeat(axes, n, axis=0), [any_V] * 2]), [G.identity] * len(x)
    Vd_dot, poses[-2] = 0 * Vd, cayley(G, turn[None])[0]
    Vd_dot[-1] = any_rate
    moving = exact.with_rate(entrywise(exact.Exact.of, 0 * x), x)
    rates = _rates(loop, carried, np.array(poses, dtype=object), Vd, Vd_dot, moving)
    slopes = exact.rate_of(rates)
    if any(exact.Exact.of(number).degree for number in (*rates.flat, *slopes.flat)):
        raise InputError("has errors whose equation is not rational, or branches")
    if _values(rates).any():
        raise InputError("does not stay on its reference")
    slopes = _values(slopes)
    A = slopes[:-2].reshape(1 + m, n, n).swapaxes(1, 2)
    A[1:] = A[1:] - A[0]
    expected = (A[0] + np.tensordot(_values(any_V), A[1:], axes=1)) @ _values(any_x)
    if (slopes[-1] != expected).any():
        raise InputError("has errors whose equation is not affine in the velocity alone")
    if (slopes[-2] != expected).any():
        raise InputError("has a stiffness or damping in space that depends on the desired pose R_d")
    return A


def _rates(loop: ClosedLoop, carried: int, Qd: Array, Vd: Array, Vd_dot: Array, x: Array) -> Array:
    """Return ẋ, ``(k, n)``, to first order in x."""
    G, m, inertia = loop.group, loop.group.dimension, loop.inertia.at(0.0)
    memory = loop.controller.memory(G)
    eps, error, *states = np.split(x, np.cumsum([m, m, *memory.values()])[:-1], axis=1)
    turned = G.ad(Vd, eps)  # Ṽ = e + ad_{V_d} ε
    V_tilde = error + carried * turned
    V, Q = Vd + V_tilde, Qd @ (G.hat(eps) + G.identity)
    s = tracking(loop, Q, V, Qd, Vd, Vd_dot, dict(zip(memory, states, strict=True)))
    force, _ = loop.acting_and_rates(s)
    V_dot, changes = inertia.velocity(G.ad_star(V, s.P) + force), loop.law.memory_rate(s)
    error_rate = V_dot - Vd_dot - carried * (G.ad(Vd_dot, eps) + G.ad(Vd, error))
    return np.hstack([V_tilde - turned, error_rate, *(changes[name] for name in memory)])


def tracking(loop: ClosedLoop, Q: Any, V: Any, Qd: Any, Vd: Any, Vd_dot: Any, z: Any) -> Tracking:
    """Return what a law may read at poses, velocities, a rate of V_d and states z of its memory."""
    G, inertia = loop.group, loop.inertia.at(0.0)
    P, Pd = inertia.momentum(V), inertia.momentum(Vd)
    tau_d = inertia.momentum(Vd_dot) - G.ad_star(Vd, Pd)
    s = Tracking(G, inertia, loop.gains, 0.0, Q, P, Qd, Pd, tau_d, z)
    return with_fields(s, V=V, Vd=Vd, Vd_dot=Vd_dot)


# The slowest constant V_d of a box ----------------------------------------------------------------

Box = list[tuple[Fraction, Fraction]]


def box_of(velocities: Array) -> Box:
    """Return the least and the largest V_d of some along each axis, to 4 digits outwards."""
    ends = zip(np.floor(1e4 * velocities.min(0)), np.ceil(1e4 * velocities.max(0)), strict=True)
    return [(Fraction(int(low), 10**4), Fraction(int(high), 10**4)) for low, high in ends]


def _slowest(A: Array, corners: Array, box: Box) -> tuple[Array, float]:
    """Return the constant V_d with the slowest mode, and the rate of this mode, 1/s.

    The middle, those on the way to the corners, and random ones are tried, and then those nearer
    and nearer to the slowest.
    """
    low, high = np.array(box, dtype=float).T
    spread = np.random.default_rng(0).uniform(low - high, high - low, (500, len(box))) / 2
    Vd, best = (low + high) / 2, np.inf
    tried = Vd + np.concatenate([k * (corners - Vd) for k in np.linspace(0, 1, 9)] + [spread])
    for step in range(7):
        rates = -np.linalg.eigvals(A[0] + np.tensordot(tried, A[1:], axes=1)).real.max(axis=-1)
        if rates.min() < best - 1e-9:  # and not by rounding
            best, Vd = float(rates.min()), tried[rates.argmin()]
        tried = np.clip(Vd + spread / 3 ** (step + 1), low, high)
    return Vd, best


# P and λ by semidefinite programs in floats, then proved in fractions -----------------------------

MOST_SOLVES = 12  # Programs that raise the rate: 3 to 5 where P is well conditioned.
ENOUGH = 3e-3  # Relative gain at which they end: the next would be a hundredth of it.
SPARED = 1e-4  # Share of the rate that is given up for a well conditioned P, and for rounding.
DIGITS = 10**9  # P and λ are multiples of 1/DIGITS; the largest eigenvalue of P is about 1.


@dataclass(frozen=True)
class Certified:
    """The proved rate of a loop for every reference whose velocity stays in a box.

    Attributes
    ----------
    rate
        λ, 1/s; None if no P was found, and then P is None, too.
    P
        Rows of fractions, as text, with AᵀP + PA + 2λP ≺ 0 at every corner.
    overshoot
        √cond P: ‖x(t)‖ ≤ overshoot · e^(−λt) ‖x(0)‖.
    velocity
        The box: least and largest V_d along each axis.
    slowest_constant
        The constant V_d of the box with the slowest mode, as far as was searched.
    slowest_rate
        The rate of this mode, 1/s, which no proved rate exceeds.
    gain, region
        What a push does, and from where a law returns, if asked.
    """

    rate: Fraction | None
    P: list[list[str]] | None
    overshoot: float
    velocity: list[list[float]]
    slowest_constant: list[float]
    slowest_rate: float
    gain: Gain | None = None
    region: Region | None = None


def certified(A: Array, box: Box, B: Array | None = None, push: float = 0.0) -> Certified:
    """Return the largest rate that one P proves in a box of velocities, and the gain of a push."""
    pairs = zip(A[1:], box, strict=True)
    corners = list(product(*(sorted(set(ends)) if M.any() else ends[:1] for M, ends in pairs)))
    if len(corners) > 64:
        raise InputError("has errors that depend on more than six axes of the desired velocity")
    at_corners = [A[0] + np.tensordot(np.array(corner), A[1:], axes=1) for corner in corners]
    slowest, bound = _slowest(A.astype(float), np.array(corners, dtype=float), box)
    P = _search(np.array(at_corners, dtype=float), bound)
    rate, proof = (None, None) if P is None else _prove(at_corners, P)
    overshoot = np.inf if proof is None else float(np.sqrt(np.linalg.cond(proof.astype(float))))
    rows = None if proof is None else entrywise(str, proof).tolist()
    ends, gain = np.array(box, dtype=float), None
    if B is not None:
        tried = np.vstack([np.array(corners, dtype=float), slowest])
        gain = Gain(push)
        if rate is not None:
            gain = _gain(at_corners, B, float(rate), push, tried, A.astype(float)) or gain
    return Certified(rate, rows, overshoot, ends.tolist(), slowest.tolist(), bound, gain)


def _search(A: Array, bound: float) -> Array | None:
    """Return P with a rate of its own as large as possible, and then well conditioned.

    The largest t with AᵀP + PA + 2λP ≼ −tS gives a P whose own rate exceeds λ, with S = I at first
    and then the last P, by which the rates converge as fast as Newton's iteration.
    """
    none, one = np.zeros(A.shape[1:]), np.eye(A.shape[-1])
    P, rate = one, 0.0
    for _ in range(MOST_SOLVES if bound > 0 else 0):
        better = _solve(A, rate, P, none)
        if better is None or (new_rate := _own_rate(A, better)) <= rate:
            break
        gain, rate, P = new_rate - rate, new_rate, better
        if gain <= ENOUGH * rate or rate >= (1 - SPARED / 2) * bound:
            break
    rounder = _solve(A, (1 - SPARED / 2) * rate, none, one) if rate else None
    if rounder is not None and _own_rate(A, rounder) >= (1 - SPARED) * rate:
        return rounder
    return P if rate else None


def _own_rate(A: Array, P: Array) -> float:
    """Return the largest λ with AᵀP + PA + 2λP ≼ 0 for all of A."""
    half = np.linalg.inv(np.linalg.cholesky(P))
    moved = half @ (P @ A + (P @ A).swapaxes(-1, -2)) @ half.T
    return float(-np.linalg.eigvalsh(moved).max() / 2)


def _solve(A: Array, rate: float, S: Array, least: Array) -> Array | None:
    """Return P for the largest t with AᵀP + PA + 2λP ≼ −tS for all of A, and t·least ≼ P ≼ I."""
    basis, one = basis_of(len(S)), np.eye(len(S))
    products, zero = basis @ A[:, None], np.zeros((len(A), 1, *S.shape))
    lmis = products + products.swapaxes(-1, -2) + 2 * rate * basis
    by_t = np.broadcast_to(S, zero.shape)
    above, below = [0 * S, *-basis, least], [-one, *basis, 0 * S]
    blocks = [np.hstack([zero, lmis, by_t]), [above], [below]]
    solution = minimum([*np.zeros(len(basis)), -1.0], blocks)
    P = np.tensordot(solution[:-1], basis, axes=1)
    is_found = np.isfinite(P).all() and solution[-1] > 0 and np.linalg.eigvalsh(P).min() > 0
    return P / np.linalg.norm(P, 2) if is_found else None


def basis_of(n: int) -> Array:
    """Return the symmetric matrices with a 1 at one place of the lower triangle, ``(k, n, n)``."""
    rows, columns = np.tril_indices(n)
    basis = np.zeros((len(rows), n, n))
    basis[range(len(rows)), rows, columns] = basis[range(len(rows)), columns, rows] = 1.0
    return basis


def minimum(cost: Sequence[float], lmis: Sequence[Any]) -> Array:
    """Return the x with the least cost · x where F₀ + Σ x_j F_j ≼ 0; it may not be feasible.

    Each of `lmis` has the F of some inequalities of one size, ``(…, 1 + k, n, n)``.
    """
    from scipy.sparse import csc_matrix  # slow to import

    clarabel, entries, cones = _clarabel(), [], []
    for F in map(np.asarray, lmis):
        rows, columns = np.tril_indices(F.shape[-1])  # of the upper triangle, column by column
        packed = F[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0))
        entries.append(packed.swapaxes(-1, -2).reshape(-1, F.shape[-3]))
        cones += [clarabel.PSDTriangleConeT(F.shape[-1])] * (entries[-1].shape[0] // len(rows))
    stacked, none = np.vstack(entries), csc_matrix((len(cost), len(cost)))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    program = none, cost, csc_matrix(stacked[:, 1:]), -stacked[:, 0], cones, settings
    return np.array(clarabel.DefaultSolver(*program).solve().x)


def _clarabel() -> Any:
    try:
        import clarabel
    except ImportError as error:
        message = "certified rates need Clarabel (extra certify): pip install clarabel"
        raise EqtError(message) from error
    return clarabel


def check_push_and_start(push: float, start: float) -> None:
    """Refuse a push, N m, or an angle of a start, deg, of which nothing can be proved here."""
    if not 0 <= push < np.inf:
        raise InputError(f"push: expected 0 N m or more, got {push:g}")
    if not 0 <= start < 180:
        raise InputError(f"the angle of a start: expected 0 to below 180 deg, got {start:g}")
    _clarabel()


def _prove(A: Sequence[Array], P: Array) -> tuple[Fraction | None, Array | None]:
    """Return a rational rate and P, rounded, if they are proved for all of A."""
    float_rate = _own_rate(np.array(A, dtype=float), P)
    rate = Fraction(int(float_rate * (1 - SPARED / 10) * DIGITS), DIGITS)
    P = entrywise(lambda x: Fraction(round(x * DIGITS), DIGITS), P)
    products = (P @ vertex + rate * P for vertex in A)
    is_proved = is_definite(P) and all(is_definite(-(M + M.T)) for M in products)
    return (rate, P) if is_proved and rate > 0 else (None, None)


def is_definite(matrix: Array) -> bool:
    """Return whether all pivots of LDLᵀ are positive, in fractions."""
    while len(matrix) and (pivot := matrix[0, 0]) > 0:
        matrix = matrix[1:, 1:] - matrix[1:, :1] @ matrix[:1, 1:] / pivot
    return not len(matrix)


# Disturbance bound: how far a bounded wrench moves the loop ---------------------------------------

SLACK = 1e-6  # Keeps matrices below 0 when Q and μ are rounded.
STEPS = 2000  # Steps of a simulated push, over eight time constants.


@dataclass(frozen=True)
class Gain:
    """What a wrench w does to a loop on its reference, to first order; ε is its attitude error.

    Attributes
    ----------
    push
        Bound of ‖w(t)‖ at all times, N m.
    peak
        Proved bound of ‖ε(t)‖ for every such w and every reference of the box, deg.
    aligned
        ‖ε‖ that such a push reaches, always along the worst axis, at the worst constant V_d, deg.
    at
        That V_d, as far as was searched.
    energy
        Proved γ with ∫‖ε‖² dt ≤ γ² ∫‖w‖² dt, rad/(N m).
    proofs
        Of ``peak`` and ``energy``, α, μ (the square in rad/(N m)) and Q in fractions, as text: with
        ε = Cx, AQ + QAᵀ + αQ + BBᵀ/α ≺ 0 and CQCᵀ ≺ μI at every corner; or
        [[AQ + QAᵀ + BBᵀ, QCᵀ], [CQ, −μI]] ≺ 0.
    refused
        Reason why nothing was tried; without one and ``peak``, nothing was proved.
    """

    push: float
    peak: float | None = None
    aligned: float | None = None
    at: list[float] | None = None
    energy: float | None = None
    proofs: dict[str, Any] = field(default_factory=dict)
    refused: str = ""

    def __str__(self) -> str:
        """What is proved, in words that go on from the name of the law; bounds are rounded up."""
        if self.peak is None or self.aligned is None or self.energy is None:
            return self.refused or f"has no proved bound for a disturbance of {self.push:g} N m"
        return (
            f"is rotated by at most {rounded(self.peak, 4, up=True)}° by a disturbance of "
            f"{self.push:g} N m to first order, and by {rounded(self.aligned, 4)}° at the worst "
            "constant V_d; "
            f"L2 gain {rounded(self.energy, 4, up=True)} rad/(N m)"
        )


def rounded(number: float, digits: int, *, up: bool = False) -> str:
    """Return a positive number with so many significant digits, rounded down or up."""
    unit = 10.0 ** (math.floor(math.log10(number)) + 1 - digits) if number > 0 else 1.0
    return f"{(math.ceil if up else math.floor)(number / unit) * unit:#.{digits}g}"


def _gain(
    corners: list[Array], B: Array, rate: float, push: float, V: Array, A: Array
) -> Gain | None:
    """Return the gains; None if one is not proved. The aligned push is tried at velocities V."""
    tried = (_bounded(corners, B, share * rate) for share in np.linspace(0.6, 1.5, 18))
    peak = min(filter(None, tried), key=lambda one: Fraction(one["mu"]), default=None)
    if peak is None or not (energy := _bounded(corners, B, 0.0)):
        return None
    reached = _aligned(A[0] + np.tensordot(V, A[1:], axes=1), B.astype(float))
    gains = [float(Fraction(one["mu"])) ** 0.5 for one in (peak, energy)]
    most, aligned = np.degrees(push * np.array([gains[0], reached.max()])).tolist()
    at, proofs = V[reached.argmax()].tolist(), {"peak": peak, "energy": energy}
    return Gain(push, most, aligned, at, gains[1], proofs)


def _block(A: Array, B: Array, Q: Array, alpha: Any, mu: Any) -> Array:
    """Return the matrix that proves a peak if it is below 0, or the energy with α = 0."""
    m, is_peak = B.shape[1], int(alpha > 0)
    top = A @ Q + (A @ Q).T + alpha * Q + B @ B.T / (alpha or 1)
    side, end = (1 - is_peak) * Q[:, :m], is_peak * Q[:m, :m] - mu * np.eye(m, dtype=int)
    return np.block([[top, side], [side.T, end]])


def _bounded(corners: Sequence[Array], B: Array, rate: float) -> dict[str, Any]:
    """Return α, the least μ, and Q if fractions prove them at all corners; else nothing."""
    # In a unit of the wrench in which B is about 1: slack and digits must not depend on the units.
    unit = Fraction(2) ** round(np.log2(np.abs(B.astype(float)).max()))
    basis, alpha, lmis = basis_of(len(B)), Fraction(round(rate * DIGITS), DIGITS), []
    B = B / unit
    for A in corners:
        floats, none = (A.astype(float), B.astype(float)), 0 * basis[0]
        F = _block(*floats, none, rate, 0.0)
        of_Q = (_block(*floats, E, rate, 0.0) - F for E in basis)
        lmis.append([F + SLACK * np.eye(len(F)), *of_Q, _block(*floats, none, rate, 1.0) - F])
    solution = np.nan_to_num(minimum([*np.zeros(len(basis)), 1.0], [lmis]))
    solution[-1] *= 1 + 10 * SLACK
    *entries, mu = (Fraction(round(x * DIGITS), DIGITS) for x in solution)
    Q = np.tensordot(np.array(entries), basis.astype(int), axes=1)
    if not (is_definite(Q) and all(is_definite(-_block(A, B, Q, alpha, mu)) for A in corners)):
        return {}
    mu, Q = mu * unit**2, Q * unit**2
    return {"alpha": str(alpha), "mu": str(mu), "Q": entrywise(str, Q).tolist()}


def _aligned(A: Array, B: Array) -> Array:
    """Return for each of A the largest ‖ε‖ that ‖w‖ ≤ 1 reaches, as far as was searched.

    The push w(t) = H(T − t)ᵀc / ‖H(T − t)ᵀc‖, H the response of ε to a pulse of a time step, makes
    c · ε(T) as large as can be. For c, the direction of this ε(T) is taken again and again.
    """
    from scipy.linalg import expm  # slow to import

    (k, n, _), m = A.shape, B.shape[1]
    steps = 8 / (STEPS * -np.linalg.eigvals(A).real.max(axis=-1))
    wide = np.pad(np.concatenate([A, np.tile(B, (k, 1, 1))], axis=2), ((0, 0), (0, m), (0, 0)))
    moved = expm(wide * steps[:, None, None])[:, :n]
    pulses = [moved[..., n:]]
    for _ in range(STEPS - 1):
        pulses.append(moved[..., :n] @ pulses[-1])
    H, c = np.stack(pulses, axis=1)[:, :, :m], np.eye(m)[:, None, None, None]
    for _ in range(10):
        w = c @ H
        end = (H @ (w / np.linalg.norm(w, axis=-1, keepdims=True)).mT).sum(axis=2)
        reached = np.linalg.norm(end, axis=2, keepdims=True)
        c = (end / reached).mT[:, :, None]
    return reached.max(axis=(0, 2, 3))


def _by_wrench(loop: ClosedLoop, A: Array) -> Array:
    """Return the fractions of B with ẋ = A x + B w, ``(n, 3)``, for wrenches w on SO(3)."""
    none = "has no proved bound for a disturbance: "
    if loop.group.name != "SO3":
        raise InputError(f"{none}eqt proves one on SO3 only")
    if not loop.vehicle.is_ideal:  # such as limits of the torque, which its linear part lacks
        raise InputError(f"{none}{loop.vehicle.departures}")
    matrix = entrywise(lambda x: _exact(repr(float(x))), loop.inertia.at(0.0).matrix)
    return np.pad(_values(exact.inverse(matrix)), ((3, A.shape[-1] - 6), (0, 0)))


# From where a law on SO(3) surely returns, with a proved rate -------------------------------------
#
# With R_dᵀR = exp(θ n^), e = sin θ · n, ω̃ = ω − ω_d, K = kI and K_d = k_d I, a law (g, c, n, q)
# with c + n = 1 does not let L = ½ω̃ᵀ𝕀ω̃ + 2k(1 − cos θ) rise. W = L + eᵀN𝕀ω̃ + ½eᵀMe has W = zᵀVz and
# Ẇ = zᵀTz in z = (e, ω̃), where T is affine in ω_d and else depends on R_dᵀR alone. So T + λV ≺ 0
# at the corners of a box of ω_d and wherever θ ≤ θ_max proves W(t) ≤ e^(−λt) W(0) from every start
# with L ≤ 2k(1 − cos θ_max), however large ω̃ is there. In x = tan(θ/2) n, (1 + x²)T is a
# polynomial; branch and bound over x prove its sign.

MOST_SECONDS = 60.0  # Of the proof; then it is not decided.
WIDE = 0.05  # Share of the rate that is given up, so that the boxes of the proof may be large.
DIGIT = 2.0**-20  # N, M and λ are multiples of it, and so exact as floats.
PROGRAMS, SPLITS = 5, 9  # Programs for N and M, and most halvings of a box.


@dataclass(frozen=True)
class Region:
    """From where a law surely returns to every reference whose velocity stays in a box.

    Attributes
    ----------
    angle
        θ_max, deg: L ≤ 2k(1 − cos θ_max) at the start, and then θ ≤ θ_max at all times.
    rate
        λ with W(t) ≤ e^(−λt) W(0), 1/s; None if it was not decided.
    starts
        Angles, deg, each with the ‖ω̃‖, rad/s, up to which every start lies in the region.
    N, M
        The matrices of W, exact as floats.
    boxes
        Number of boxes of R_L at which the sign was tried.
    refused
        Reason why the law has no region.
    """

    angle: float
    rate: float | None = None
    starts: list[list[float]] = field(default_factory=list)
    N: list[list[float]] | None = None
    M: list[list[float]] | None = None
    boxes: int = 0
    refused: str = ""

    def __str__(self) -> str:
        """What is proved, in words that go on from the name of the law."""
        if self.refused or not self.rate:
            return self.refused or f"has no decided region up to {self.angle:g}°"
        within = (f" or {a:g}° and {rounded(v, 3)} rad/s" for a, v in self.starts)
        falls = f"W falls at {rounded(self.rate, 4)} 1/s or faster"
        return f"from every start within {self.angle:g}° at rest{''.join(within)}: {falls}"


def region(label: str, loop: ClosedLoop, box: Box, angle: float) -> Region:
    """Return the region up to θ_max, in degrees, of a law that has a certified rate."""
    try:
        law = _numbers(label, loop)
    except InputError as error:
        return Region(angle, refused=str(error))
    corners, top = np.array([*product(*map(set, box))], dtype=float)[..., None], np.radians(angle)
    with threadpool_limits(1):  # threads slow down small matrices
        rate, N, M = designed(law, corners, np.tan(top / 2))
        boxes, holds = proved(law, corners, np.tan(top / 2), rate, N, M) if rate else (0, False)
    if not holds:
        return Region(angle, boxes=boxes)
    room = 4 * float(law[0]) / np.linalg.eigvalsh(law[2].astype(float)).max()
    degrees = np.array([angle / 2, 0.0])
    speeds = np.sqrt(room * (np.cos(np.radians(degrees)) - np.cos(top)))
    starts = np.stack([degrees, speeds], axis=1).tolist()
    return Region(angle, rate, starts, N.tolist(), M.tolist(), boxes)


def _numbers(label: str, loop: ClosedLoop) -> tuple[Any, ...]:
    """Return a law's numbers in fractions, after a proof that its code has the Ẇ of `forms_of_W`.

    Raises
    ------
    InputError
        If it has no W; the message goes on from the name of the law.
    """
    none, point = "has no proved region: ", claimed_point(loop.controller)
    if point is None or point[4] != "spatial" or loop.group.name != "SO3":
        raise InputError(f"{none}only laws (g, c, n) with errors in space on SO3 have one")
    if not loop.vehicle.is_ideal:
        raise InputError(f"{none}{loop.vehicle.departures}")
    numbers = point[:4], loop.gains.K, loop.gains.K_d, loop.inertia.at(0.0).matrix
    weights, K, K_d, J = (entrywise(lambda x: Fraction(repr(float(x))), x) for x in numbers)
    if weights[1] + weights[2] != 1:
        off = float(weights[1] + weights[2] - 1)
        raise InputError(f"{none}L falls if c + n is 1, and here c + n − 1 is {off:.3g}")
    if any((gain != gain[0, 0] * np.eye(3, dtype=int)).any() for gain in (K, K_d)):
        raise InputError(f"{none}kp and kd must be multiples of the identity")
    if not isinstance(prove(sides_of_W, ExactStates(label, loop, np.random.default_rng(0))), Proof):
        raise InputError(f"{none}its torque is not the one of its weights")
    return weights_of(list(weights), K[0, 0], K_d[0, 0], J)


def designed(law: Sequence[Any], corners: Array, top: float) -> tuple[float, Array, Array]:
    """Return λ, N and M, found at random points x with |x| ≤ top; λ is 0 if there are none.

    The largest t with T + λV ≼ −tS gives a rate above λ, with S = I at first and then the last V.
    λ is the rate at 6000 points, of which 200 are in the programs.
    """
    law, random = [np.asarray(x, dtype=float) for x in law], np.random.default_rng(0)
    points = random.standard_normal((6000, 1, 3, 1))
    points *= top / np.linalg.norm(points, axis=2, keepdims=True)
    points[0], points[2000:] = 0, points[2000:] * random.uniform(size=(4000, 1, 1, 1))
    Ns, Ms = np.zeros((2, 16, 3, 3))
    Ns[1:10], Ms[10:] = np.eye(9).reshape(9, 3, 3), basis_of(3)
    V, T = forms_of_W(points[::30, :, None], corners[:, None], law, Ns, Ms)
    pairs = (array.reshape(-1, 16, 6, 6) for array in np.broadcast_arrays(V, T))
    V, T = (np.hstack([pair[:, :1], pair[:, 1:] - pair[:, :1]]) for pair in pairs)
    best, S = (0.0, Ns[0], Ms[0]), np.eye(6) + 0 * V[:, :1]
    for _ in range(PROGRAMS):
        lmis = [np.hstack([T + best[0] * V, S]), [[*-V[0], 0 * S[0, 0]]]]
        weights = np.array([1.0, *minimum([*np.zeros(15), -1.0], lmis)[:-1]])
        S = np.tensordot(V, weights, axes=(1, 0))[:, None]
        if not np.isfinite(S).all() or np.linalg.eigvalsh(S).min() <= 0:
            break
        N, M = (np.round(np.tensordot(weights / DIGIT, x, axes=1)) * DIGIT for x in (Ns, Ms))
        V_of, T_of = forms_of_W(points, corners, law, N, M)
        half = np.linalg.inv(np.linalg.cholesky(V_of))
        rate = -float(np.linalg.eigvalsh(half @ T_of @ half.mT).max())
        if rate <= best[0] * 1.002:
            break
        best = rate, N, M
    return float(np.floor((1 - WIDE) * best[0] / DIGIT) * DIGIT), *best[1:]


def proved(
    law: Sequence[Any], corners: Array, top: float, rate: float, N: Any, M: Any
) -> tuple[int, bool]:
    """Return the number of boxes tried, and whether V ≻ 0 and T + λV ≺ 0 hold for all |x| ≤ top.

    The boxes are cubes whose centres and sides are floats without rounding. V grows with |x|.
    """
    balls, end = [Ball.of(number) for number in law], process_time() + MOST_SECONDS
    N, M, origin = Ball.of(N), Ball.of(M), Ball.of(np.zeros((3, 1)))
    c, h, count = np.zeros((1, 3)), np.array([side := np.ceil(1024 * top + 1) / 1024]), 0
    is_open = bool(forms_of_W(origin, origin, balls, N, M)[0].is_positive())
    while is_open and len(c) and process_time() < end and h[-1] > side / 2**SPLITS:
        (c, at), (h, half) = np.split(c, [-1000]), np.split(h, [-1000])  # of the smallest boxes
        near = np.maximum(np.abs(at) - half[:, None], 0.0)
        is_near = (near**2).sum(axis=1) <= (1.000001 * top) ** 2
        at, half = at[is_near], half[is_near]
        x = at[:, None, :, None], np.eye(3)[..., None] * half[:, None, None, None, None]
        V, T = forms_of_W(Ball(*x, 0 * x[0]), Ball.of(corners), balls, N, M)
        left = ~(-1.0 * (T + V * rate)).is_positive().all(axis=1)
        half, count = np.repeat(half[left] / 2, 8), count + len(at)
        corner = np.tile(CORNERS, (left.sum(), 1)) * half[:, None]
        c, h = np.concatenate([c, np.repeat(at[left], 8, axis=0) + corner]), np.append(h, half)
    return count, is_open and not len(c)


# Numbers with outward rounding --------------------------------------------------------------------

U, TINY = 2.0**-53, 1e-300  # Unit roundoff; more than what underflow loses.


class Ball:
    """Matrices c + Σ s_i t_i ± r for all |t_i| ≤ 1: r holds what is not linear in t, and rounding.

    c and r are ``(…, n, m)``, s is ``(…, 3, n, m)``. One operation of floats errs by U of its
    result at most, and a product of matrices of size 6 by 6 U |A||B|, in any order of its sums.
    """

    __array_ufunc__ = None  # so that NumPy leaves a @ b to this class

    def __init__(self, c: Array, s: Array, r: Array) -> None:
        self.c, self.s, self.r = c, s, r
        self.center, self.slope = np.abs(c), np.abs(s).sum(axis=-3)

    @classmethod
    def of(cls, x: Any) -> Ball:
        """Convert numbers, which may have been rounded to floats."""
        if isinstance(x, Ball):
            return x
        c = np.atleast_2d(np.asarray(x, dtype=float))
        return cls(c, np.zeros((3, *c.shape[-2:])), 2 * U * np.abs(c) + TINY)

    @property
    def mT(self) -> Ball:
        """The transposed matrices."""
        return Ball(self.c.mT, self.s.mT, self.r.mT)

    def __add__(self, other: Any) -> Ball:
        b = Ball.of(other)
        rounding = 8 * U * (self.center + self.slope + b.center + b.slope)
        return Ball(self.c + b.c, self.s + b.s, (self.r + b.r + rounding) * (1 + 8 * U))

    def _times(self, other: Any, product: Callable[[Array, Array], Array]) -> Ball:
        b = Ball.of(other)
        s = product(self.c[..., None, :, :], b.s) + product(self.s, b.c[..., None, :, :])
        whole, b_whole = self.center + self.slope + self.r, b.center + b.slope + b.r
        r = product(self.slope, b.slope + b.r) + product(self.center, b.r)
        r = r + product(self.r, b_whole) + 64 * U * product(whole, b_whole) + TINY
        return Ball(product(self.c, b.c), s, r * (1 + 64 * U))

    def __mul__(self, other: Any) -> Ball:
        return self._times(other, np.multiply)

    def __matmul__(self, other: Any) -> Ball:
        return self._times(other, np.matmul)

    def __rmatmul__(self, other: Any) -> Ball:
        return Ball.of(other)._times(self, np.matmul)

    __radd__, __rmul__ = __add__, __mul__

    def is_positive(self) -> Array:
        """Whether all symmetric matrices in it are positive definite, ``(…)``; False if unsure.

        They are affine in t but for ± r, so that the eight corners of t decide. A matrix S makes
        the middle nearly I; Gershgorin's circles of all S(A ± r)Sᵀ are then right of 0.
        """
        holds = np.ones(self.c.shape[:-2], dtype=bool)
        for t in CORNERS:
            at = holds.copy()
            A = self.c[at] + np.tensordot(t, self.s[at], axes=(0, -3))
            r = self.r[at] + 8 * U * (self.center[at] + self.slope[at])
            values, vectors = np.linalg.eigh(A)
            S = vectors / np.sqrt(np.where(values > 0, values, 1.0))[:, None]
            turned, size = S.swapaxes(-1, -2) @ A @ S, np.abs(S)
            r = (size.swapaxes(-1, -2) @ (r + 64 * U * np.abs(A)) @ size).sum(axis=-1)
            diagonal = np.diagonal(turned, axis1=-2, axis2=-1)
            others = np.abs(turned).sum(axis=-1) - np.abs(diagonal)
            holds[at] = (diagonal - others - r > 1e-9 * (diagonal + others + r)).all(axis=-1)
        return holds


CORNERS = np.array(list(product([-1.0, 1.0], repeat=3)))


# All of it for one law ----------------------------------------------------------------------------


class LawRates(NamedTuple):
    """The proved rates of a law in some boxes; `refused` says why it has none."""

    label: str
    rates: list[Certified]
    refused: str = ""


def rates_of(
    label: str, loop: ClosedLoop, boxes: Sequence[Box], push: float = 0.0, start: float = 0.0
) -> LawRates:
    """Return the proved rates of a loop in boxes, each within the next; push and start if not 0.

    What is proved in a box is proved in those within it, so that no rate is below the next.
    """
    rates, refused, B = list[Certified](), "", None
    try:
        A = affine(loop)
        try:
            B = _by_wrench(loop, A) if push else None
        except InputError as error:
            refused = str(error)
        for box in reversed(boxes):
            with threadpool_limits(1):  # threads slow down small matrices
                here = certified(A, box, B, push)
            if rates and (rates[-1].rate or 0) > (here.rate or 0):
                last = rates[-1]
                here = replace(here, rate=last.rate, P=last.P, overshoot=last.overshoot)
            here = replace(here, gain=Gain(push, refused=refused)) if refused else here
            rates.append(replace(here, region=region(label, loop, box, start)) if start else here)
    # The others come from code that does not run on fractions, as a law in C.
    except (InputError, TypeError, ValueError, AttributeError, TraceError) as error:
        other = "" if isinstance(error, InputError) else "cannot be evaluated on fractions: "
        return LawRates(label, [], f"{other}{error}")
    return LawRates(label, rates[::-1])
