"""Closed loops with any inertia and gains."""

import numpy as np

from eqt_cli.extend import ClosedLoop, EqT, Gains, Inertia, TorqueReference, parse

TORQUE = ["cos(t)", "sin(t)", "cos(t)*sin(t)"] * 9
"""Of the paper, on any group."""


def any_matrix(n, seed):
    """A positive definite matrix with eigenvalues between ½ and about 2."""
    A = np.random.default_rng(seed).uniform(-1.0, 1.0, (n, n)) / np.sqrt(n)
    return A @ A.T + np.eye(n) / 2


def constant(matrix):
    return Inertia(matrix, np.linalg.inv(matrix))


def expressions(rows):
    """Rows of texts, as inertias that vary take them."""
    return tuple(tuple(map(parse, row)) for row in rows)


def closed_loop(G, law=None, reference=None, **parts):
    """A loop of EqT or another law, with an inertia and gains that have no symmetry."""
    m, law = G.dimension, law or EqT()
    known = {
        "inertia": constant(any_matrix(m, 1)),
        "gains": Gains(any_matrix(G.size, 2), any_matrix(m, 3)),
        "reference": reference
        or TorqueReference(TORQUE[:m] if "track" in law.tasks else [0.0] * m),
    }
    return ClosedLoop(group=G, controller=law, **known | parts)
