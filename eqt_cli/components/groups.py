"""Matrix Lie groups: what follows from a basis of the algebra, products, and the registry."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, Protocol, Self, runtime_checkable
from unicodedata import normalize

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix, inverse_spd, maximum, transpose
from eqt_cli.base.errors import ComponentError, TraceError, bare, suggestion
from eqt_cli.base.registry import Registry

# The abstract matrix Lie group: everything that follows from the basis of its Lie algebra ---------
#
# A group gives its basis and four closed forms (`inverse`, `exp`, `log`, `drift`). No code here or
# in a control law depends on the particular group. All operators take leading batch axes and object
# arrays of symbols. Without an `exp` that takes symbols, an estimator needs an engine that calls
# laws. A `drift` that takes no symbols makes the metrics of many runs slower, because they are then
# computed on arrays.


JACOBIAN_TERMS = 16
"""Of its series: what is left out is below 1e-14 where ‖ad_x‖ ≤ 4."""


@dataclass(frozen=True)
class Part:
    """A part of the coordinates with its own units, such as the rotation in a rigid motion.

    Attributes
    ----------
    name
        ``"rotation"`` or ``"translation"``.
    axes
        Its coordinates among the m algebra coordinates.
    entries
        Its rows and columns in the pose matrix.
    pose_unit, velocity_unit, force_unit
        Units of its entries of the pose, of the velocity coordinates, and of the dual coordinates.
    turns
        Whether its entries R are in SO(2) or SO(3), with one angle θ and ‖I − R‖_F = 2√2 sin(θ/2).
    """

    name: str
    axes: slice
    entries: tuple[slice, slice]
    pose_unit: str
    velocity_unit: str
    force_unit: str
    turns: bool = False

    @property
    def dimension(self) -> int:
        """Number of its coordinates."""
        return int(self.axes.stop - self.axes.start)

    @property
    def error_unit(self) -> str:
        """Unit of the coordinates of a pose error, log Q_d⁻¹Q."""
        return "rad" if self.turns else self.pose_unit

    @property
    def length_unit(self) -> str:
        """Unit of a displacement: that of a velocity, times s."""
        return self.velocity_unit.removesuffix("/s") if "^" not in self.velocity_unit else "m/s"


class MatrixLieGroup(ABC):
    """A matrix Lie group G of d×d matrices with an m-dimensional Lie algebra g.

    Coordinates of g refer to `basis`, those of g* to the dual basis, so that ⟨P, V⟩ = p·v and the
    dual of a linear map is its transpose (Hampsey et al. (2025), eq. (1)).

    Attributes
    ----------
    name
        As written in a configuration: ``SO3``.
    basis : (m, d, d)
        The matrices E_i that span g; mutually orthogonal in the Frobenius product.
    axis_names
        One short name per algebra coordinate, for figures and tables.
    """

    name: str
    basis: Array
    axis_names: Sequence[str]

    @property
    def dimension(self) -> int:
        """m, the dimension of the group."""
        return int(self.basis.shape[0])

    @property
    def size(self) -> int:
        """d, the number of rows of a pose matrix."""
        return int(self.basis.shape[1])

    @property
    @abstractmethod
    def parts(self) -> tuple[Part, ...]:
        """The parts of the coordinates, each with its own units."""

    @property
    def translation(self) -> Part | None:
        """The only part whose velocity is in m/s; None if there is none, or more than one."""
        moving = [part for part in self.parts if part.velocity_unit == "m/s"]
        return moving[0] if len(moving) == 1 else None

    @property
    def compact(self) -> bool | None:
        """Whether the group is compact, so that every trajectory is bounded; None: not known."""
        return None

    @classmethod
    def named(cls, name: str) -> Self | None:
        """Return the group that a configuration calls `name`, if it is of this class."""
        return cls() if bare(name) == bare(cls.name) else None

    @classmethod
    def examples(cls) -> tuple[str, ...]:
        """Return names of groups of this class, for tests and tables."""
        return (cls.name,)

    # The closed forms that a group gives.

    @abstractmethod
    def inverse(self, Q: Array) -> Array:
        """Q⁻¹ in closed form, for floats and symbols, ``(..., d, d)``."""

    @abstractmethod
    def exp(self, V: Array) -> Array:
        """The group exponential of algebra coordinates, ``(..., m) -> (..., d, d)``."""

    @abstractmethod
    def log(self, Q: Array) -> Array:
        """The principal logarithm in coordinates, ``(..., d, d) -> (..., m)``."""

    def jacobian(self, x: Array) -> Array:
        """J(x) = ∫₀¹ Ad_{exp(sx)} ds = Σ ad_xᵏ/(k + 1)!, ``(..., m) -> (..., m, m)``.

        exp(x + δ) = exp(Jδ) exp(x) to first order. By its series at x/4, and doubled twice by
        J(2y) = ½(I + exp(ad_y)) J(y), exp(ad_y) = I + ad_y J(y); a group may have a closed form.
        """
        one, half = np.eye(self.dimension), self.ad_matrix(x) / 4
        series = half * 0.0 + one
        for k in range(JACOBIAN_TERMS, 1, -1):
            series = one + half @ series / k
        for _ in range(2):
            series = (one + half @ series / 2) @ series
            half = 2 * half
        return series

    @abstractmethod
    def drift(self, Q: Array) -> Array:
        """Return the distance of Q from the group, 0 on it, ``(..., d, d) -> (...)``."""

    def gram_rate(self, Q: Array, V: Array) -> Array:
        """Return the rate of QᵀQ along Q̇ = Q V^; a group may override it by a shorter form."""
        half = transpose(Q) @ (Q @ self.hat(V))
        return half + transpose(half)

    # What follows from the basis alone.

    @cached_property
    def identity(self) -> Array:
        """I ∈ G."""
        return np.eye(self.size)

    @cached_property
    def _flat_basis(self) -> Array:
        return self.basis.reshape(self.dimension, -1)

    @cached_property
    def _dual_basis(self) -> Array:
        # Division by the squared norms is exact for entries 0 and ±1; a pseudo-inverse is not.
        return (self._flat_basis / (self._flat_basis**2).sum(axis=1, keepdims=True)).T

    def hat(self, V: Array) -> Array:
        """Return the algebra element with coordinates V, ``(..., m) -> (..., d, d)``."""
        return (V @ self._flat_basis).reshape(*V.shape[:-1], self.size, self.size)

    def vee(self, U: Array) -> Array:
        """Return the coordinates of an algebra element, ``(..., d, d) -> (..., m)``."""
        return U.reshape(*U.shape[:-2], self.size**2) @ self._dual_basis

    def contract(self, M: Array) -> Array:
        """The covector U ↦ tr(MᵀÛ) of a matrix, ``(..., d, d) -> (..., m)``."""
        return M.reshape(*M.shape[:-2], self.size**2) @ self._flat_basis.T

    @cached_property
    def _ad_tensor(self) -> Array:
        # ad_V has the entries (k, j) = Σ_i V_i c[i, j, k] with [E_i, E_j] = Σ_k c[i, j, k] E_k.
        products = self.basis[:, None] @ self.basis[None, :]
        c = self.vee(products - products.swapaxes(0, 1))
        return c.swapaxes(1, 2).reshape(self.dimension, -1)

    def ad_matrix(self, V: Array) -> Array:
        """The matrix of U ↦ ad_V U = [V, U], ``(..., m) -> (..., m, m)``."""
        return (V @ self._ad_tensor).reshape(*V.shape[:-1], self.dimension, self.dimension)

    def ad(self, V: Array, U: Array) -> Array:
        """ad_V U = [V, U] in coordinates."""
        return apply_matrix(self.ad_matrix(V), U)

    def ad_star(self, V: Array, P: Array) -> Array:
        """ad*_V P, the dual of ad_V: ⟨ad*_V P, U⟩ = ⟨P, [V, U]⟩; on SO(3), −V × P.

        Hampsey et al. (2025), eq. (2).
        """
        return apply_matrix(transpose(self.ad_matrix(V)), P)

    def Ad(self, Q: Array, V: Array) -> Array:
        """Ad_Q V = (Q V^ Q⁻¹)^∨ in coordinates."""
        return apply_matrix(self.Ad_matrix(Q), V)

    def Ad_matrix(self, Q: Array) -> Array:
        """The matrix of V ↦ Ad_Q V, ``(..., d, d) -> (..., m, m)``.

        A group may override it by the entries in closed form, which must equal this.
        """
        columns = self.vee(Q[..., None, :, :] @ self.basis @ self.inverse(Q)[..., None, :, :])
        return transpose(columns)

    def Ad_star(self, Q: Array, P: Array) -> Array:
        """Ad*_Q P, the dual of Ad_Q: ⟨Ad*_Q P, U⟩ = ⟨P, Ad_Q U⟩; on SO(3), Qᵀ P."""
        return apply_matrix(transpose(self.Ad_matrix(Q)), P)

    # The entries of a pose that can differ from the identity's, for compact states.

    @cached_property
    def _free_entries(self) -> tuple[Array, Array]:
        # Motion in the group changes exactly the entries of products of algebra elements.
        reached = (self.basis != 0).any(axis=0)
        while True:
            further = reached | (reached.astype(int) @ reached.astype(int) > 0)
            if (further == reached).all():
                rows, columns = np.nonzero(reached)
                return rows, columns
            reached = further

    @property
    def pose_length(self) -> int:
        """The number of entries of a pose matrix that can vary."""
        return len(self._free_entries[0])

    def pack(self, Q: Array) -> Array:
        """Return the entries of a pose that can vary, ``(..., d, d) -> (..., pose_length)``."""
        if self.pose_length == self.size**2:
            return Q.reshape(*Q.shape[:-2], self.pose_length)  # -1 fails for an empty batch
        rows, columns = self._free_entries
        return Q[..., rows, columns]

    def unpack(self, entries: Array) -> Array:
        """Return the pose with these entries, the others as in the identity; inverts `pack`."""
        if self.pose_length == self.size**2:
            return entries.reshape(*entries.shape[:-1], self.size, self.size)
        Q = np.empty_like(entries, shape=(*entries.shape[:-1], self.size, self.size))
        Q[...] = self.identity
        rows, columns = self._free_entries
        Q[..., rows, columns] = entries
        return Q

    def violation(self, Q: Array) -> float:
        """Return the distance of a float matrix from the group; 0 on the group."""
        constant = np.abs(self.unpack(self.pack(Q)) - Q).max()
        return float(max(constant, 2.0 if np.linalg.det(Q) < 0 else 0.0, self.drift(Q)))


# What the axes of a group are called --------------------------------------------------------------


def command_axes(G: MatrixLieGroup) -> tuple[str, ...]:
    """Return names of the coordinates of a command: torque x, force z; torque in the plane."""
    units = {k: part.force_unit for part in G.parts for k in range(G.dimension)[part.axes]}
    words = ["torque" if units[k] == "N m" else "force" for k in range(G.dimension)]
    axes = [normalize("NFKC", name) for name in G.axis_names]  # digits for subscripts
    names = ([f"{a} {b[k:]}".strip() for a, b in zip(words, axes, strict=True)] for k in (1, 0))
    return next(tuple(letters) for letters in names if len({*letters}) == len(letters))


def moving_parts(G: MatrixLieGroup) -> tuple[Part | None, Part | None]:
    """Return the first rotation of a group, and its first position in metres."""
    turning = next((part for part in G.parts if part.turns), None)
    return turning, next((part for part in G.parts if part.pose_unit == "m"), None)


# What a group may give besides, where somebody asks for it ----------------------------------------


@runtime_checkable
class HasHalfTurns(Protocol):
    """A group of rotations, perhaps with columns that they turn."""

    def half_turn(self, Q: Array) -> tuple[Array, Array]:
        """Return cos(θ/2) ≥ 0 and 2 sin(θ/2) times the axis of the shorter rotation to Q."""


@runtime_checkable
class DerivesLog(Protocol):
    """A group for laws that shape an energy of log Q."""

    def log_force(self, x: Array, p: Array) -> Array:
        """Return the covector f that the function `log_force` describes."""


def log_force(G: MatrixLieGroup, x: Array, p: Array) -> Array:
    """Return the covector f with ⟨f, V⟩ = ⟨p, d/dt log(Q exp(tV))⟩ at t = 0, where x = log Q.

    ``(..., m), (..., m) -> (..., m)``; f = J_r⁻ᵀ(x) p with the right Jacobian J_r.

    Raises
    ------
    ComponentError
        If the group does not give it.
    """
    if not isinstance(G, DerivesLog):
        raise ComponentError(f"group '{G.name}' has no derivative of the logarithm")
    return G.log_force(x, p)


@runtime_checkable
class HasRationalPoses(Protocol):
    """A group that Cayley's transform leaves, with another rational map."""

    def cayley(self, V: Array) -> Array:
        """Return poses of exact coordinates, by + − × ÷ only."""


def cayley(G: MatrixLieGroup, V: Array) -> Array:
    """Return Cayley's transform (I − V^)⁻¹(I + V^), ``(..., m) -> (..., d, d)``.

    It needs + − × ÷ only, so that exact numbers give an exact pose, and reaches almost every pose.
    The result is in the group if the group preserves a quadratic form, perhaps with columns that it
    acts on; `HasRationalPoses` is for others.
    """
    if isinstance(G, HasRationalPoses):
        return G.cayley(V)
    U = G.hat(V)
    return inverse_spd(G.identity - U) @ (G.identity + U)


@runtime_checkable
class HasRigidBodies(Protocol):
    """A group of the motions of rigid bodies in space."""

    def principal_moments(self, inertia: Array) -> tuple[Array, ...]:
        """Return the moments of `principal_moments`."""


def principal_moments(G: MatrixLieGroup, inertia: Array) -> tuple[Array, ...]:
    """Return the three principal moments of each rigid body in space, rising, kg m².

    They are about the centre of mass, ``(..., m, m) -> (..., 3)`` for each body.
    """
    return G.principal_moments(inertia) if isinstance(G, HasRigidBodies) else ()


@runtime_checkable
class Screws(Protocol):
    """Motion along one element of the algebra, which engines trace where it depends on time."""

    def screw(self, V: Array) -> tuple[Array, Array, Array]:
        """Return a frame h in which V is simple, V = Ad_h U, with numbers and rates.

        ``(..., m) -> (..., d, d), (..., n), (..., k)``; h is constant; the group chooses n and k.
        ``h exp_along(numbers, a * rates) h⁻¹`` is exp(aV) for every number a, and
        ``along(numbers, a * rates)`` is aU. Entries that are 0 cost nothing once compiled.
        """

    def along(self, numbers: Array, angles: Array) -> Array:
        """Return the algebra element by `screw`'s results, ``(..., n), (..., k) -> (..., m)``."""

    def exp_along(self, numbers: Array, angles: Array) -> Array:
        """Return the exponential of `along`, ``(..., n), (..., k) -> (..., d, d)``."""


def screws_of(G: MatrixLieGroup) -> Screws:
    """Return the group itself if it has screws, or else the ones of any group, on floats."""
    return G if isinstance(G, Screws) else _PlainScrews(G)


@dataclass(frozen=True)
class _PlainScrews:
    """h = I, and exp by the group's own."""

    G: MatrixLieGroup

    def screw(self, V: Array) -> tuple[Array, Array, Array]:
        size = self.G.size
        frame = np.broadcast_to(self.G.identity, (*V.shape[:-1], size, size))
        return frame, V, np.ones((*V.shape[:-1], 1))

    def along(self, numbers: Array, angles: Array) -> Array:
        return numbers * angles

    def exp_along(self, numbers: Array, angles: Array) -> Array:
        if angles.dtype == object or numbers.dtype == object:
            raise TraceError(
                f"group '{self.G.name}' has no method `exp_along` that takes symbols; "
                "give it one, as EuclideanGroup has, or use `engine: solve_ivp`"
            )
        return self.G.exp(self.along(numbers, angles))


groups = Registry(
    "group", "groups", MatrixLieGroup, ("components.matrix_groups", "components.groups")
)


def group_named(name: str) -> MatrixLieGroup:
    """Return the group that a configuration calls `name`, perhaps a product.

    Raises
    ------
    ComponentError
        If there is none; the message names the closest group, or else examples.
    """
    for kinds in (groups.core, groups.all):
        if group := next(filter(None, (kind.named(name) for kind in kinds())), None):
            return group
    examples = [example for kind in groups.all() for example in kind.examples()]
    simple = [example for example in examples if "*" not in example]
    products = [example for example in examples if example not in simple]
    listed = ", ".join(simple) + (f" and products such as {products[0]}" if products else "")
    hint = suggestion(bare(name), examples) or f"; known: {listed}"
    raise ComponentError(f"unknown group '{name}'{hint}")


def known_group(name: str) -> MatrixLieGroup | None:
    """Return the group of a result; None of several, or of a plugin that is not loaded."""
    with suppress(ComponentError):
        return group_named(name)
    return None


# Direct products of groups, as block-diagonal matrices --------------------------------------------


MAX_AXES = 64
"""Largest dimension of a product; the structure constants grow with its third power."""

SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


class ProductGroup(MatrixLieGroup):
    """A direct product such as SO3*R3; coordinates and blocks in the order of its factors."""

    name = "<group>*<group>"

    def __init__(self, *factors: MatrixLieGroup) -> None:
        self.factors = factors
        self.name = "*".join(factor.name for factor in factors)
        self.places = _slices([factor.size for factor in factors])
        self.coordinates = _slices([factor.dimension for factor in factors])
        size, dimension = self.places[-1].stop, self.coordinates[-1].stop
        self.basis = np.zeros((dimension, size, size))
        for factor, place, coordinates in self._layout():
            self.basis[coordinates, place, place] = factor.basis
        self.axis_names = tuple(
            f"{axis}{str(number).translate(SUBSCRIPTS)}"
            for number, factor in enumerate(factors, 1)
            for axis in factor.axis_names
        )

    @classmethod
    def named(cls, name: str) -> Self | None:
        """Return the product of SO3 and R3 for SO3*R3."""
        factors = [factor.strip() for factor in name.replace("×", "*").split("*")]
        if len(factors) == 1:
            return None
        if "" in factors:
            raise ComponentError(f"group '{name}': a factor is missing next to '*'")
        # Each factor has at least one axis, so more factors need not be read to refuse the product.
        groups = [group_named(factor) for factor in factors[: MAX_AXES + 1]]
        if sum(group.dimension for group in groups) > MAX_AXES:
            raise ComponentError(
                f"group '{factors[0]}*…': its {len(factors)} factors have more than {MAX_AXES} "
                f"axes; expected at most {MAX_AXES}"
            )
        return cls(*groups)

    @classmethod
    def examples(cls) -> tuple[str, ...]:
        """A rigid body with an independent translation, and one with a wheel."""
        return "SO3*R3", "SE3*SO2"

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of all factors, numbered by factor."""
        parts = []
        for number, (factor, place, coordinates) in enumerate(self._layout(), 1):
            for part in factor.parts:
                name, axes = f"{part.name}_{number}", _shifted(part.axes, coordinates.start)
                rows, columns = (_shifted(entry, place.start) for entry in part.entries)
                parts.append(replace(part, name=name, axes=axes, entries=(rows, columns)))
        return tuple(parts)

    @property
    def compact(self) -> bool | None:
        """Whether all factors are compact."""
        return _all([factor.compact for factor in self.factors])

    def principal_moments(self, inertia: Array) -> tuple[Array, ...]:
        """Return the moments of the rigid bodies of all factors."""
        return tuple(
            moments
            for factor, _, axes in self._layout()
            for moments in principal_moments(factor, inertia[..., axes, axes])
        )

    def inverse(self, Q: Array) -> Array:
        """Factor by factor."""
        return self.assemble([G.inverse(Q[..., at, at]) for G, at, _ in self._layout()])

    def Ad_matrix(self, Q: Array) -> Array:
        """Factor by factor."""
        matrices = [G.Ad_matrix(Q[..., at, at]) for G, at, _ in self._layout()]
        return _block_diagonal(matrices, self.coordinates)

    def exp(self, V: Array) -> Array:
        """Factor by factor."""
        return self.assemble([G.exp(V[..., axes]) for G, _, axes in self._layout()])

    def jacobian(self, x: Array) -> Array:
        """Factor by factor."""
        matrices = [G.jacobian(x[..., axes]) for G, _, axes in self._layout()]
        return _block_diagonal(matrices, self.coordinates)

    def cayley(self, V: Array) -> Array:
        """Factor by factor."""
        return self.assemble([cayley(G, V[..., axes]) for G, _, axes in self._layout()])

    def screw(self, V: Array) -> tuple[Array, Array, Array]:
        """Factor by factor; the numbers and rates of the factors are concatenated."""
        screws = [screws_of(G).screw(V[..., axes]) for G, _, axes in self._layout()]
        frames, numbers, rates = zip(*screws, strict=True)
        joined = np.concatenate(numbers, axis=-1), np.concatenate(rates, axis=-1)
        return self.assemble(list(frames)), *joined

    def along(self, numbers: Array, angles: Array) -> Array:
        """Factor by factor."""
        vectors = [s.along(numbers[..., n], angles[..., k]) for s, n, k in self._screws]
        return np.concatenate(vectors, axis=-1)

    def exp_along(self, numbers: Array, angles: Array) -> Array:
        """Factor by factor."""
        poses = [s.exp_along(numbers[..., n], angles[..., k]) for s, n, k in self._screws]
        return self.assemble(poses)

    @cached_property
    def _screws(self) -> list[tuple[Screws, slice, slice]]:
        """The screws of each factor, with the places of its numbers and of its rates."""
        kinds = [screws_of(factor) for factor in self.factors]
        _, numbers, rates = zip(
            *(s.screw(np.zeros(G.dimension)) for s, G in zip(kinds, self.factors, strict=True)),
            strict=True,
        )
        return list(
            zip(kinds, _slices([*map(len, numbers)]), _slices([*map(len, rates)]), strict=True)
        )

    def log(self, Q: Array) -> Array:
        """Factor by factor."""
        return np.concatenate([G.log(Q[..., at, at]) for G, at, _ in self._layout()], axis=-1)

    def log_force(self, x: Array, p: Array) -> Array:
        """Factor by factor."""
        forces = [log_force(G, x[..., at], p[..., at]) for G, _, at in self._layout()]
        return np.concatenate(forces, axis=-1)

    def drift(self, Q: Array) -> Array:
        """The largest drift of a factor."""
        return reduce(maximum, [G.drift(Q[..., at, at]) for G, at, _ in self._layout()])

    def assemble(self, poses: list[Array]) -> Array:
        """Return the pose that has these poses of the factors on its diagonal."""
        return _block_diagonal(poses, self.places)

    def _layout(self) -> list[tuple[MatrixLieGroup, slice, slice]]:
        return list(zip(self.factors, self.places, self.coordinates, strict=True))


def _block_diagonal(matrices: list[Any], places: list[slice]) -> Array:
    """Return a matrix with these matrices at places on its diagonal."""
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    like = next((block for block in matrices if not isinstance(block, np.ndarray)), matrices[0])
    shape = (*batch, places[-1].stop, places[-1].stop)
    whole = np.zeros_like(like, shape=shape, dtype=np.result_type(*matrices))
    for matrix, place in zip(matrices, places, strict=True):
        whole[..., place, place] = matrix
    return whole


def _all(answers: list[bool | None]) -> bool | None:
    if False in answers:
        return False
    return None if None in answers else True


def _slices(lengths: list[int]) -> list[slice]:
    ends = np.cumsum(lengths)
    return [slice(int(end - length), int(end)) for end, length in zip(ends, lengths, strict=True)]


def _shifted(part: slice, by: int) -> slice:
    return slice(part.start + by, part.stop + by)
