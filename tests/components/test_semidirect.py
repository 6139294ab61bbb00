"""The semidirect group G ⋉ g* of Hampsey et al. (2025), §4, §5 and appendix, on every group.

Each identity is checked against what defines it: products, or derivatives of products by the
five-point differences of the fixture `derivative`.
"""

import numpy as np
import pytest
from drawn import drawn

from eqt_cli.components.mechanics import Semidirect, lie_poisson
from eqt_cli.extend import dot

# Tens of last places of numbers up to a hundred; measured 5e-15.
ROUNDING = 1e-13
# Five-point differences of such numbers; measured 8e-12.
DIFFERENCES = 1e-10


@pytest.fixture(scope="session")
def S(G):
    return Semidirect(G)


def assert_equal(left, right, tolerance=ROUNDING):
    """Two pairs of arrays are equal."""
    for one, other in zip(left, right, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance)


def plus(X, Y, factor=1.0):
    return X[0] + factor * Y[0], X[1] + factor * Y[1]


def minus(X, Y):
    return plus(X, Y, -1.0)


def along(G, U, t):
    """The curve (exp(tV), tP) through the identity with velocity U, as in the appendix."""
    V, P = U
    return G.exp(t * V), t * P


def moved(G, X, U, t):
    """A curve through X whose velocity at t = 0 is that of eq. (5) for the input U."""
    (Q, P), (V, tau) = X, U
    return Q @ G.exp(t * V), P + t * (G.ad_star(V, P) + tau)


def translated(G, Y, tangent):
    """DR_Y of a tangent vector (Q̇, Ṗ) anywhere, from eq. (15): (Q̇ Q_Y, Ad*_{Q_Y} Ṗ)."""
    (Q_Y, _), (Q_dot, P_dot) = Y, tangent
    return Q_dot @ Q_Y, G.Ad_star(Q_Y, P_dot)


def left(S, Y, U):
    """DL_Y[U], eq. (25)."""
    (Q, P), (V, tau) = Y, U
    return Q @ S.G.hat(V), S.G.ad_star(V, P) + tau


def right(S, Y, U):
    """DR_Y[U], eq. (26)."""
    (Q, _), (V, tau) = Y, U
    return S.G.hat(V) @ Q, S.G.Ad_star(Q, tau)


def ad(S, W, U):
    """The bracket of the algebra of G ⋉ g*, as in section 4: eq. (28)."""
    (V_W, P_W), (V_U, P_U) = W, U
    return S.G.ad(V_W, V_U), S.G.ad_star(V_U, P_W) - S.G.ad_star(V_W, P_U)


# The group ----------------------------------------------------------------------------------------


@drawn()
def test_equation_15_product_is_the_coadjoint_one(samples, S, data):
    G, ((Q1, P1), (Q2, P2)), V = samples.G, samples.states(data, 2), samples.vector(data)
    Q, P = S.compose((Q1, P1), (Q2, P2))
    np.testing.assert_allclose(Q, Q1 @ Q2, rtol=0, atol=0)
    np.testing.assert_allclose(dot(P, V), dot(P1, G.Ad(Q2, V)) + dot(P2, V), atol=ROUNDING)


@drawn()
def test_identity_is_neutral_and_inverses_undo(samples, S, data):
    X = samples.state(data)
    assert_equal(S.compose(X, S.identity), X)
    assert_equal(S.compose(S.identity, X), X)
    I = tuple(np.broadcast_to(part, X[k].shape) for k, part in enumerate(S.identity))
    assert_equal(S.compose(X, S.inverse(X)), I)
    assert_equal(S.compose(S.inverse(X), X), I)


# Its tangent maps and its algebra -----------------------------------------------------------------


@drawn()
def test_equation_25_derivative_of_left_translation(samples, S, data, derivative):
    G, Y, U = samples.G, samples.state(data), samples.input(data)
    rate = derivative(lambda t: S.compose(Y, along(G, U, t)))
    assert_equal(left(S, Y, U), rate, DIFFERENCES)


@drawn()
def test_equation_26_derivative_of_right_translation(samples, S, data, derivative):
    G, Y, U = samples.G, samples.state(data), samples.input(data)
    rate = derivative(lambda t: S.compose(along(G, U, t), Y))
    assert_equal(right(S, Y, U), rate, DIFFERENCES)


@drawn()
def test_equation_27_Ad_turns_right_translation_into_left(samples, S, data):
    """Ad_Y = DR_{Y⁻¹} DL_Y, that is DL_Y U = DR_Y Ad_Y U."""
    G, Y, U = samples.G, samples.state(data), samples.input(data)
    assert_equal(left(S, Y, U), right(S, Y, S.Ad(Y, U)))
    V_hat, force = translated(G, S.inverse(Y), left(S, Y, U))
    assert_equal((G.vee(V_hat), force), S.Ad(Y, U))


@drawn()
def test_equation_28_ad_is_the_derivative_of_Ad(samples, S, data, derivative):
    G, (W, U) = samples.G, samples.inputs(data, 2)
    rate = derivative(lambda t: S.Ad(along(G, W, t), U))
    assert_equal(ad(S, W, U), rate, DIFFERENCES)


# Extended Lie-Poisson systems ---------------------------------------------------------------------


@drawn()
def test_equation_5_lie_poisson(samples, data):
    """Q̇ = Q V^ and ⟨Ṗ, U⟩ = ⟨P, [V, U]⟩ + ⟨τ, U⟩."""
    G, (Q, P), (V, tau), U = (
        samples.G,
        samples.state(data),
        samples.input(data),
        samples.vector(data),
    )
    Q_dot, P_dot = lie_poisson(G, Q, P, V, tau)
    bracket = G.vee(G.hat(V) @ G.hat(U) - G.hat(U) @ G.hat(V))
    np.testing.assert_allclose(Q_dot, Q @ G.hat(V), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(dot(P_dot, U), dot(P, bracket) + dot(tau, U), atol=ROUNDING)


@drawn()
def test_theorem_4_1_system_is_left_invariant(samples, S, data):
    """f_U(X) = DL_X[U]."""
    X, U = samples.state(data), samples.input(data)
    assert_equal(lie_poisson(samples.G, *X, *U), left(S, X, U))


@drawn()
def test_theorem_4_1_system_is_right_equivariant(samples, S, data):
    """DR_Y f_U(X) = f_{Ad_{Y⁻¹} U}(X Y)."""
    G, (X, Y), U = samples.G, samples.states(data, 2), samples.input(data)
    pushed = translated(G, Y, lie_poisson(G, *X, *U))
    assert_equal(pushed, lie_poisson(G, *S.compose(X, Y), *S.Ad(S.inverse(Y), U)))


# The error ----------------------------------------------------------------------------------------


@drawn()
def test_equation_17_error(samples, S, data):
    """E = X X_d⁻¹ = (Q Q_d⁻¹, Ad*_{Q_d⁻¹}(P − P_d))."""
    G, (X, X_d) = samples.G, samples.states(data, 2)
    (Q, P), (Q_d, P_d) = X, X_d
    E = S.error(X, X_d)
    assert_equal(E, (Q @ np.linalg.inv(Q_d), G.Ad_star(G.inverse(Q_d), P - P_d)))
    assert_equal(S.compose(E, X_d), X)


@drawn()
def test_error_is_right_invariant(samples, S, data):
    """(X Y)(X_d Y)⁻¹ = X X_d⁻¹."""
    X, X_d, Y = samples.states(data, 3)
    assert_equal(S.error(S.compose(X, Y), S.compose(X_d, Y)), S.error(X, X_d))


@drawn()
def test_lemma_5_1_error_dynamics(samples, S, data, derivative):
    """Ė = f_{U_E}(E) with U_E = Ad_{X_d}(U − U_d): eq. (18) and (19)."""
    G, (X, X_d), (U, U_d) = samples.G, samples.states(data, 2), samples.inputs(data, 2)
    rate = derivative(lambda t: S.error(moved(G, X, U, t), moved(G, X_d, U_d, t)))
    U_E = S.Ad(X_d, minus(U, U_d))
    assert_equal(lie_poisson(G, *S.error(X, X_d), *U_E), rate, DIFFERENCES)


@drawn()
def test_equation_20_gives_the_error_the_input_that_is_asked_for(samples, S, data):
    """With τ = τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E), eq. (19) returns (V_E, τ_E): τ_E is free."""
    G, X_d, (V_d, tau_d) = samples.G, samples.state(data), samples.input(data)
    V_E, tau_E = samples.input(data)
    tau = S.closed_loop_input(X_d, tau_d, (V_E, tau_E))
    V = V_d + G.Ad(G.inverse(X_d[0]), V_E)
    assert_equal(S.error_input(X_d, (V, tau), (V_d, tau_d)), (V_E, tau_E))
