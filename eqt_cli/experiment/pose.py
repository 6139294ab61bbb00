"""A pose from a configuration: `identity`, a matrix, or rotation and translations by name.

For a product of groups also a list with one of these per factor.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.core.numbers import Real
from eqt_cli.core.problems import Problems
from eqt_cli.core.validation import shown, validated
from eqt_cli.experiment.tensors import square, vector
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.product import ProductGroup

GROUP_TOLERANCE = 1e-9
"""Largest ‖QᵀQ − I‖ of a pose written in decimal; less than the integrators' own tolerances."""


def pose_from(value: Any, G: MatrixLieGroup, problems: Problems) -> Array | None:
    """The pose that `value` describes, or None after noting what is wrong with it."""
    if value == "identity":
        return G.identity
    if isinstance(G, ProductGroup) and isinstance(value, list) and len(value) != G.size:
        if len(value) != len(G.factors):
            problems.add(f"expected {_alternatives(G)}, got a list of {len(value)}")
            return None
        found = [
            pose_from(entry, factor, problems.at(index))
            for index, (entry, factor) in enumerate(zip(value, G.factors, strict=True))
        ]
        poses = [pose for pose in found if pose is not None]
        return G.assemble(poses) if len(poses) == len(found) else None
    if isinstance(value, dict) and isinstance(G, EuclideanGroup):
        return _from_parts(value, G, problems)
    if not isinstance(value, list):
        problems.add(f"expected {_alternatives(G)}, got {shown(value)}")
        return None
    rows = validated(list[list[Real]], value, problems)
    if rows is None:
        return None
    with problems.catching():
        Q = square(rows, G.size, G)
        violation = G.violation(Q)
        if violation <= GROUP_TOLERANCE:
            return Q
        raise InputError(
            f"expected an element of {G.name}, got a matrix that is {violation:.2g} away from one "
            f"(at most {GROUP_TOLERANCE:g} is rounding); give {_alternatives(G)}"
        )
    return None


def _alternatives(G: MatrixLieGroup) -> str:
    """The ways to write a pose of this group."""
    matrix = f"a {G.size}×{G.size} matrix with all its digits"
    if isinstance(G, ProductGroup):
        return f"identity, {matrix}, or a list of {len(G.factors)} poses for {G.name}"
    if isinstance(G, EuclideanGroup):
        parts = ", ".join(f"{key}: …" for key in _lengths(G))
        return f"identity, {matrix}, or {{{parts}}} for {G.name}"
    return f"identity or {matrix} for {G.name}"


def _lengths(G: EuclideanGroup) -> dict[str, int]:
    """The parts of a pose and how many numbers each has."""
    turn = {"rotvec": G.rotations} if G.rotations else {}
    return turn | dict.fromkeys(G.columns, G.space)


def _from_parts(value: dict[str, Any], G: EuclideanGroup, problems: Problems) -> Array | None:
    known = _lengths(G)
    parts = {name: np.zeros(length) for name, length in known.items()}
    for key, entry in value.items():
        if key not in known:
            has = f"a pose of {G.name} has {', '.join(known)}"
            problems.at(key).add(f"unknown key; {has}")
            continue
        numbers = validated(Real | list[Real], entry, problems.at(key))
        if numbers is not None:
            with problems.catching(key):
                parts[key] = vector(numbers, known[key], G)
    if problems:
        return None
    turn = np.zeros(G.dimension)
    turn[: G.rotations] = parts.get("rotvec", 0.0)
    columns = np.array([parts[name] for name in G.columns]).reshape(-1, G.space).T
    return G.assemble(G.rotation(G.exp(turn)), columns)
