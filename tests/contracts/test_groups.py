"""What every group must do, whoever wrote it; tests/components has the axioms at length."""

import numpy as np
import pytest

from eqt_cli.components.groups import cayley, screws_of

# Tens of last places, where SciPy's rigid motions leave their series; as in tests/components.
ROUNDING = 5e-13


@pytest.fixture
def elements(group_class):
    """The groups of a class, each with some of its elements and vectors."""
    found = []
    for name in group_class.examples():
        G = group_class.named(name)
        V, U, P = np.random.default_rng(2).uniform(-1, 1, (3, 2, 5, G.dimension))
        found.append((G, G.exp(V), V, U, P))
    return found


def test_a_group_is_called_by_its_name(group_class):
    assert group_class.examples()
    for name in group_class.examples():
        assert group_class.named(name).name == name
    assert group_class.named("no such group") is None


def test_parts_and_names_cover_every_axis_once(elements):
    for G, *_ in elements:
        axes = [axis for part in G.parts for axis in range(G.dimension)[part.axes]]
        assert axes == list(range(G.dimension))
        assert len(set(G.axis_names)) == G.dimension


def test_closed_forms_agree_with_the_basis(elements):
    for G, Q, V, U, P in elements:
        unit = np.broadcast_to(G.identity, Q.shape)
        assert np.abs(Q @ G.inverse(Q) - unit).max() < ROUNDING
        assert np.abs(G.log(Q) - V).max() < ROUNDING
        assert np.abs(G.hat(G.Ad(Q, U)) - Q @ G.hat(U) @ G.inverse(Q)).max() < ROUNDING
        assert np.abs((G.Ad_star(Q, P) * U - P * G.Ad(Q, U)).sum(-1)).max() < ROUNDING
        bracket = G.hat(V) @ G.hat(U) - G.hat(U) @ G.hat(V)
        assert np.abs(G.hat(G.ad(V, U)) - bracket).max() < ROUNDING


def test_elements_are_on_the_group_and_others_are_not(elements):
    for G, Q, *_ in elements:
        assert np.abs(G.drift(Q)).max() < ROUNDING
        assert G.drift(Q).shape == Q.shape[:-2]
        assert G.violation(Q[0, 0]) < ROUNDING
        assert G.violation(2 * Q[0, 0]) > 0.1


def test_what_is_left_out_of_a_state_is_constant(elements):
    for G, Q, *_ in elements:
        np.testing.assert_array_equal(G.unpack(G.pack(Q)), Q)


def test_symbols_give_the_same_as_floats(elements, symbols):
    to, back = symbols
    for G, Q, V, U, P in elements:
        q, v, u, p = (to(values[0, :2]) for values in (Q, V, U, P))
        for found, expected in (
            (G.inverse(q), G.inverse(Q)),
            (G.Ad(q, u), G.Ad(Q, U)),
            (G.Ad_star(q, p), G.Ad_star(Q, P)),
            (G.ad_star(v, p), G.ad_star(V, P)),
        ):
            np.testing.assert_allclose(back(found), expected[0, :2], rtol=0, atol=ROUNDING)


def test_motion_along_an_element_is_its_exponential(elements):
    """V = Ad_h U, and exp(aV) is h exp(aU) h⁻¹."""
    for G, _, V, *_ in elements:
        screws = screws_of(G)
        frame, numbers, rates = screws.screw(V)
        along, moved = (f(numbers, 0.7 * rates) for f in (screws.along, screws.exp_along))
        assert np.abs(G.Ad(frame, along) - 0.7 * V).max() < ROUNDING
        assert np.abs(frame @ moved @ G.inverse(frame) - G.exp(0.7 * V)).max() < ROUNDING


@pytest.mark.needs("proofs")
def test_cayleys_transform_is_rational_and_stays_in_the_group(elements):
    """In floats up to rounding; in exact numbers Q⁻¹Q is I."""
    from eqt_cli.extensions.proofs.exact import Exact, free

    for G, _, V, *_ in elements:
        poses = cayley(G, V)
        assert max(G.violation(Q) for Q in poses.reshape(-1, G.size, G.size)) < ROUNDING
        c = np.array([[free(3 * k - 4) / 7 for k in range(G.dimension)]], dtype=object)
        Q = cayley(G, c)
        product = G.inverse(Q) @ Q - G.identity
        assert not any(Exact.of(entry).numerator for entry in product.flat)
