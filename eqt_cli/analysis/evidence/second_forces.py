"""Second, independent form of every force, in floats and for one run: from potentials or by terms.

A form takes the group, the options of the run, and the generator after they were drawn. It returns
a function of times ``(n,)``, poses and velocities that gives the force in the force's frame.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from eqt_cli.analysis.evidence.plain_algebra import Ad_matrix, applied
from eqt_cli.analysis.evidence.redrawn import Options, entries, redrawn, tensor
from eqt_cli.core.arrays import Array
from eqt_cli.core.expressions import formula
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.forces import Force

Acting = Callable[[Array, Array, Array], Array]
"""Returns a force from times, poses and velocities."""

Form = Callable[[MatrixLieGroup, Options, np.random.Generator], Acting]


def _constant(G: MatrixLieGroup, given: Options, random: np.random.Generator) -> Acting:
    """Return f."""
    return lambda t, Q, V: entries(given["force"], G.dimension) + 0 * V


def _expression(G: MatrixLieGroup, given: Options, random: np.random.Generator) -> Acting:
    """Return f(t), time by time."""
    written = [formula(entry) for entry in given["force"]]
    return lambda t, Q, V: np.array([[f.evaluate({"t": at}) for f in written] for at in t.tolist()])


def _drag(G: MatrixLieGroup, given: Options, random: np.random.Generator) -> Acting:
    """Return −Σ_j (D₁_ij + D₂_ij |U_j|) U_j with U = V − V_c.

    The pose of a body carried by the medium has the rate Q V_c^, which is c in the column of its
    position.
    """
    D1, D2 = (tensor(given[name], G.dimension) for name in ("linear", "quadratic"))

    def acting(t: Array, Q: Array, V: Array) -> Array:
        U = V if given["current"] is None else V - carried(t, Q)
        return -applied(D1 + D2 * np.abs(U)[..., None, :], U)

    def carried(t: Array, Q: Array) -> Array:
        c = np.array([[_at(entry, at) for entry in given["current"]] for at in t.tolist()])
        (place,) = [part for part in G.parts if part.velocity_unit == "m/s"]
        rate = np.zeros_like(Q)
        rate[(..., *place.entries)] = c[..., None]
        if given["frame"] == "spatial":
            return np.einsum("...ij,kij->...k", rate, G.basis)
        return np.einsum("...ij,kij->...k", np.linalg.solve(Q, rate), G.basis)

    return acting


def _at(entry: Any, t: float) -> float:
    """Return a number, or the value of an expression at a time."""
    return float(formula(entry).evaluate({"t": t})) if isinstance(entry, str) else float(entry)


def _gust(G: MatrixLieGroup, given: Options, random: np.random.Generator) -> Acting:
    """Return the sum of n sines with the variance σ²/n each.

    A share (k + ½)/n of the spectrum lies below the frequency ω of sine k. The share of the
    spectrum below ω is (2/π) atan(ωT).
    """
    phase = random.uniform(0.0, 2 * np.pi, (12, G.dimension))
    n = len(phase)
    omega = [1 / (given["time_constant"] * np.tan(np.pi / 2 * (n - k - 0.5) / n)) for k in range(n)]
    size = entries(given["std"], G.dimension) * np.sqrt(2.0 / n)

    def acting(t: Array, Q: Array, V: Array) -> Array:
        waves = [np.sin(np.multiply.outer(t, w) + p[:, None]).T for w, p in _columns(omega, phase)]
        return size * np.sum(waves, axis=0)

    return acting


def _columns(omega: list[float], phase: Array) -> list[tuple[Array, Array]]:
    return [(np.array(w), p) for w, p in zip(omega, phase, strict=True)]


def _restoring(G: MatrixLieGroup, given: Options, random: np.random.Generator) -> Acting:
    """Return −dU along every axis, U(Q) = ⟨up, W Q r_G − B Q r_B⟩ for points (r, 1)."""
    up = np.array([*(given["up"] or (0.0, 0.0, 1.0)), 0.0])
    up = up / np.sqrt(up @ up)
    weight, lift = (
        given[size] * np.array([*(given[at] or (0.0, 0.0, 0.0)), 1.0])
        for size, at in (("weight", "centre_of_mass"), ("buoyancy", "centre_of_buoyancy"))
    )
    return lambda t, Q, V: -np.einsum("i,...ij,kjl,l->...k", up, Q, G.basis, weight - lift)


def _gravity_gradient(G: MatrixLieGroup, given: Options, random: np.random.Generator) -> Acting:
    """Return −dU along every axis, U = (3/2)n² dᵀR 𝕁 Rᵀd, with d from the body to the planet."""
    rate, inertia = given["rate"], tensor(given["inertia"], 3)

    def acting(t: Array, Q: Array, V: Array) -> Array:
        d = np.stack([-np.cos(rate * t), -np.sin(rate * t), 0 * t], axis=-1)
        R, turns = Q[..., :3, :3], G.basis[:, :3, :3]
        slope = np.einsum("...i,...ij,kjl,lm,...nm,...n->...k", d, R, turns, inertia, R, d)
        return -3 * rate**2 * slope

    return acting


FORMS: dict[str, Form] = {
    "constant": _constant,
    "expression": _expression,
    "drag": _drag,
    "gust": _gust,
    "restoring": _restoring,
    "gravity_gradient": _gravity_gradient,
}
"""By the registered name of the force."""


def second_force(G: MatrixLieGroup, force: Force, random: np.random.Generator) -> Acting | None:
    """Return a force of one run in the body frame; None if it has no second form."""
    form = FORMS.get(force.name)
    if form is None:
        return None
    acting = form(G, redrawn(force, random), random)
    if force.frame == "body":
        return acting

    def in_body(t: Array, Q: Array, V: Array) -> Any:
        """Convert a force in space, whose power is ⟨f, Ad_Q V⟩."""
        matrix = Ad_matrix(G, Q)
        return applied(np.swapaxes(matrix, -1, -2), acting(t, Q, applied(matrix, V)))

    return in_body
