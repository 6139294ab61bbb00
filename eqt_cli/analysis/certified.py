"""Rates at which small errors decay along every reference whose velocity stays in a box, proved.

About a reference the loop is ẋ = A x to first order, with x = (ε, Ṽ or e, memory), Q = Q_d exp(ε).
Where A is affine in V_d and depends on nothing else, one P with AᵀP + PA + 2λP ≺ 0 at the corners
of a box proves ‖x(t)‖_P ≤ e^(−λt) ‖x(0)‖_P for every V_d(t) in it, however fast it changes. A is
computed exactly, semidefinite programs find P and λ in floats, and fractions prove them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.analysis import exact
from eqt_cli.analysis.exact import entrywise
from eqt_cli.analysis.sample import INVERSE, MATRIX
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, TraceError
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.mechanics import Tracking
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import leaves, with_fields, with_leaves

# A(V_d), exactly ----------------------------------------------------------------------------------


def affine(loop: ClosedLoop) -> Array:
    """Return the fractions of A(V_d) = A₀ + Σ V_d,k A_k, ``(1 + m, n, n)``, in the law's own chart.

    Its velocity error is Ṽ = V − V_d if that gives such an A, else e = V − Ad_{Q_L⁻¹}V_d.

    Raises
    ------
    InputError
        If there is no such A; the message goes on from the name of the law.
    """
    loop = replace(loop, vehicle=loop.vehicle.linear_part)
    G, law, vehicle = loop.group, loop.controller, loop.vehicle
    if vehicle.control is not None or vehicle.states(G) or law.reads_flat_output:
        raise InputError("is sampled, acts through actuators that lag, or is a cascade")
    varies = not isinstance(loop.inertia, Inertia) or law.held(G, 0.0) is not None
    if vehicle.forces or vehicle.inertia is not None or varies:
        raise InputError("has forces or an inertia unknown to it, or numbers that change in time")
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
    return entrywise(lambda each: exact.Exact.of(each).value, numbers)


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
    Vd_dot, poses[-2] = 0 * Vd, G.cayley(turn[None])[0]
    Vd_dot[-1] = any_rate
    moving = exact.with_rate(entrywise(exact.Exact.of, 0 * x), x)
    rates = _rates(loop, carried, np.array(poses, dtype=object), Vd, Vd_dot, moving)
    slopes = exact.rate_of(rates)
    if any(exact.Exact.of(each).degree for each in (*rates.flat, *slopes.flat)):
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
    V, Pd, Q = Vd + V_tilde, inertia.momentum(Vd), Qd @ (G.hat(eps) + G.identity)
    tau_d, P = inertia.momentum(Vd_dot) - G.ad_star(Vd, Pd), inertia.momentum(V)
    z = dict(zip(memory, states, strict=True))
    s = Tracking(G, inertia, loop.gains, 0.0, Q, P, Qd, Pd, tau_d, z)
    s = with_fields(s, V=V, Vd=Vd, Vd_dot=Vd_dot)
    force, _ = loop.acting_and_rates(s)
    V_dot, changes = inertia.velocity(G.ad_star(V, P) + force), loop.law.memory_rate(s)
    error_rate = V_dot - Vd_dot - carried * (G.ad(Vd_dot, eps) + G.ad(Vd, error))
    return np.hstack([V_tilde - turned, error_rate, *(changes[name] for name in memory)])


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
    found, best = (low + high) / 2, np.inf
    tried = found + np.concatenate([k * (corners - found) for k in np.linspace(0, 1, 9)] + [spread])
    for step in range(7):
        rates = -np.linalg.eigvals(A[0] + np.tensordot(tried, A[1:], axes=1)).real.max(axis=-1)
        if rates.min() < best - 1e-9:  # and not by rounding
            best, found = float(rates.min()), tried[rates.argmin()]
        tried = np.clip(found + spread / 3 ** (step + 1), low, high)
    return found, best


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
    """

    rate: Fraction | None
    P: list[list[str]] | None
    overshoot: float
    velocity: list[list[float]]
    slowest_constant: list[float]
    slowest_rate: float


def certified(A: Array, box: Box) -> Certified:
    """Return the largest rate that one P proves in a box of velocities."""
    pairs = zip(A[1:], box, strict=True)
    corners = list(product(*(sorted(set(ends)) if M.any() else ends[:1] for M, ends in pairs)))
    if len(corners) > 64:
        raise InputError("has errors that depend on more than six axes of the desired velocity")
    at_corners = [A[0] + np.tensordot(np.array(corner), A[1:], axes=1) for corner in corners]
    slowest, bound = _slowest(A.astype(float), np.array(corners, dtype=float), box)
    P = _searched(np.array(at_corners, dtype=float), bound)
    rate, proof = (None, None) if P is None else _proved(at_corners, P)
    overshoot = np.inf if proof is None else float(np.sqrt(np.linalg.cond(proof.astype(float))))
    rows = None if proof is None else entrywise(str, proof).tolist()
    return Certified(rate, rows, overshoot, np.array(box, float).tolist(), slowest.tolist(), bound)


def _searched(A: Array, bound: float) -> Array | None:
    """Return P with a rate of its own as large as possible, and then well conditioned.

    The largest t with AᵀP + PA + 2λP ≼ −tS gives a P whose own rate exceeds λ, with S = I at first
    and then the last P, by which the rates converge as fast as Newton's iteration.
    """
    none, one = np.zeros(A.shape[1:]), np.eye(A.shape[-1])
    P, rate = one, 0.0
    for _ in range(MOST_SOLVES if bound > 0 else 0):
        better = _solved(A, rate, P, none)
        if better is None or (own := _own_rate(A, better)) <= rate:
            break
        gain, rate, P = own - rate, own, better
        if gain <= ENOUGH * rate or rate >= (1 - SPARED / 2) * bound:
            break
    rounder = _solved(A, (1 - SPARED / 2) * rate, none, one) if rate else None
    if rounder is not None and _own_rate(A, rounder) >= (1 - SPARED) * rate:
        return rounder
    return P if rate else None


def _own_rate(A: Array, P: Array) -> float:
    """Return the largest λ with AᵀP + PA + 2λP ≼ 0 for all of A."""
    half = np.linalg.inv(np.linalg.cholesky(P))
    moved = half @ (P @ A + (P @ A).swapaxes(-1, -2)) @ half.T
    return float(-np.linalg.eigvalsh(moved).max() / 2)


def _solved(A: Array, rate: float, S: Array, least: Array) -> Array | None:
    """Return P for the largest t with AᵀP + PA + 2λP ≼ −tS for all of A, and t·least ≼ P ≼ I."""
    from scipy.sparse import csc_matrix  # slow to import

    try:
        import clarabel
    except ImportError as error:
        message = "certified rates need Clarabel (extra certify): pip install clarabel"
        raise EqtError(message) from error
    rows, columns = np.tril_indices(len(S))  # of the upper triangle, column by column
    weights = np.where(rows == columns, 1.0, np.sqrt(2.0))
    basis = np.zeros((len(rows), *S.shape))
    basis[range(len(rows)), rows, columns] = basis[range(len(rows)), columns, rows] = 1.0

    def packed(matrices: Array) -> Array:
        return matrices[..., rows, columns] * weights

    products = basis[:, None] @ A
    lmis = packed(products + products.swapaxes(-1, -2) + 2 * rate * basis[:, None])
    of_P = [lmis.reshape(len(rows), -1).T, -packed(basis).T, packed(basis).T]
    of_t = [*[packed(S)] * len(A), packed(least), 0 * weights]
    matrix = csc_matrix(np.column_stack([np.concatenate(of_P), np.concatenate(of_t)]))
    right = np.concatenate([0 * weights] * (len(A) + 1) + [packed(np.eye(len(S)))])
    settings, cones = clarabel.DefaultSettings(), [clarabel.PSDTriangleConeT(len(S))]
    settings.verbose, none = False, csc_matrix((len(rows) + 1, len(rows) + 1))
    program = none, [*0 * rows, -1.0], matrix, right, cones * (len(A) + 2), settings
    *entries, t = clarabel.DefaultSolver(*program).solve().x
    P = np.tensordot(entries, basis, axes=1)
    is_found = np.isfinite(P).all() and t > 0 and np.linalg.eigvalsh(P).min() > 0
    return P / np.linalg.norm(P, 2) if is_found else None


def _proved(A: Sequence[Array], P: Array) -> tuple[Fraction | None, Array | None]:
    """Return a rational rate and P, rounded, if they are proved for all of A."""
    own = _own_rate(np.array(A, dtype=float), P)
    rate = Fraction(int(own * (1 - SPARED / 10) * DIGITS), DIGITS)
    P = entrywise(lambda x: Fraction(round(x * DIGITS), DIGITS), P)
    products = (P @ each + rate * P for each in A)
    is_proved = _is_definite(P) and all(_is_definite(-(M + M.T)) for M in products)
    return (rate, P) if is_proved and rate > 0 else (None, None)


def _is_definite(matrix: Array) -> bool:
    """Return whether all pivots of LDLᵀ are positive, in fractions."""
    while len(matrix) and (pivot := matrix[0, 0]) > 0:
        matrix = matrix[1:, 1:] - matrix[1:, :1] @ matrix[:1, 1:] / pivot
    return not len(matrix)


class LawRates(NamedTuple):
    """The proved rates of a law in some boxes; `refused` says why it has none."""

    label: str
    rates: list[Certified]
    refused: str = ""


def rates_of(label: str, loop: ClosedLoop, boxes: Sequence[Box]) -> LawRates:
    """Return the proved rates of a loop in boxes, each within the next.

    What is proved in a box is proved in those within it, so that no rate is below the next.
    """
    found: list[Certified] = []
    try:
        A = affine(loop)
        for box in reversed(boxes):
            with threadpool_limits(1):  # threads slow down small matrices
                here = certified(A, box)
            if found and (found[-1].rate or 0) > (here.rate or 0):
                here = replace(
                    here, **{k: getattr(found[-1], k) for k in ("rate", "P", "overshoot")}
                )
            found.append(here)
    # The others come from code that does not run on fractions, as a law in C.
    except (InputError, TypeError, ValueError, AttributeError, TraceError) as error:
        other = "" if isinstance(error, InputError) else "cannot be evaluated on fractions: "
        return LawRates(label, [], f"{other}{error}")
    return LawRates(label, found[::-1])
