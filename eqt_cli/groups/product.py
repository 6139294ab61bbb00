"""Direct products of groups, as block-diagonal matrices."""

from dataclasses import replace
from functools import cached_property, reduce
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array, maximum
from eqt_cli.core.errors import ComponentError
from eqt_cli.groups.base import MatrixLieGroup, Part

MAX_AXES = 64
"""Largest dimension of a product; the structure constants grow with its third power."""


class ProductGroup(MatrixLieGroup):
    """A direct product such as SO3*R3; coordinates and blocks in the order of its factors."""

    name = "<group>*<group>"

    def __init__(self, *factors: MatrixLieGroup) -> None:
        self.factors = factors
        self.name = "*".join(factor.name for factor in factors)
        self.blocks = _slices([factor.size for factor in factors])
        self.coordinates = _slices([factor.dimension for factor in factors])
        size, dimension = self.blocks[-1].stop, self.coordinates[-1].stop
        self.basis = np.zeros((dimension, size, size))
        for factor, block, coordinates in self._layout():
            self.basis[coordinates, block, block] = factor.basis
        self.axis_names = tuple(
            f"{axis}{_subscript(index)}"
            for index, factor in enumerate(factors)
            for axis in factor.axis_names
        )

    @classmethod
    def named(cls, name: str) -> Self | None:
        """Return the product of SO3 and R3 for SO3*R3."""
        from eqt_cli.groups import group_named

        factors = [factor.strip() for factor in name.split("*")]
        if len(factors) == 1:
            return None
        if "" in factors:
            raise ComponentError(f"group '{name}': a factor is missing beside '*'")
        # Each factor has at least one axis, so more factors need not be made to refuse the product.
        made = [group_named(factor) for factor in factors[: MAX_AXES + 1]]
        axes = sum(factor.dimension for factor in made)
        if axes > MAX_AXES:
            raise ComponentError(
                f"group '{factors[0]}*…': its {len(factors)} factors have more than {MAX_AXES} "
                f"axes; expected at most {MAX_AXES}"
            )
        return cls(*made)

    @classmethod
    def examples(cls) -> tuple[str, ...]:
        """A rigid body with an independent translation, and one with a wheel."""
        return "SO3*R3", "SE3*SO2"

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of all factors, numbered by factor."""
        parts = []
        for number, (factor, block, coordinates) in enumerate(self._layout(), 1):
            for part in factor.parts:
                name, axes = f"{part.name}_{number}", _shifted(part.axes, coordinates.start)
                rows, columns = (_shifted(each, block.start) for each in part.entries)
                parts.append(replace(part, name=name, axes=axes, entries=(rows, columns)))
        return tuple(parts)

    @property
    def compact(self) -> bool | None:
        """Whether all factors are compact."""
        return _all([factor.compact for factor in self.factors])

    @property
    def compact_times_vector(self) -> bool | None:
        """Whether all factors are of the class, which is closed under products."""
        return _all([factor.compact_times_vector for factor in self.factors])

    def principal_moments(self, inertia: Array) -> tuple[Array, ...]:
        """Return the moments of the rigid bodies of all factors."""
        return tuple(
            moments
            for factor, _, axes in self._layout()
            for moments in factor.principal_moments(inertia[..., axes, axes])
        )

    def inverse(self, Q: Array) -> Array:
        """Block by block."""
        return self.assemble([G.inverse(Q[..., own, own]) for G, own, _ in self._layout()])

    def Ad_matrix(self, Q: Array) -> Array:
        """Block by block."""
        blocks = [G.Ad_matrix(Q[..., own, own]) for G, own, _ in self._layout()]
        return _block_diagonal(blocks, self.coordinates)

    def exp(self, V: Array) -> Array:
        """Block by block."""
        return self.assemble([G.exp(V[..., own]) for G, _, own in self._layout()])

    def jacobian(self, x: Array) -> Array:
        """Block by block."""
        blocks = [G.jacobian(x[..., own]) for G, _, own in self._layout()]
        return _block_diagonal(blocks, self.coordinates)

    def cayley(self, V: Array) -> Array:
        """Block by block."""
        return self.assemble([G.cayley(V[..., own]) for G, _, own in self._layout()])

    def screw(self, V: Array) -> tuple[Array, Array, Array]:
        """Block by block; the numbers and rates of the factors are concatenated."""
        screws = [factor.screw(V[..., axes]) for factor, _, axes in self._layout()]
        frames, numbers, rates = zip(*screws, strict=True)
        joined = np.concatenate(numbers, axis=-1), np.concatenate(rates, axis=-1)
        return self.assemble(list(frames)), *joined

    def along(self, numbers: Array, angles: Array) -> Array:
        """Block by block."""
        return np.concatenate(
            [G.along(numbers[..., n], angles[..., k]) for G, n, k in self._screws], axis=-1
        )

    def exp_along(self, numbers: Array, angles: Array) -> Array:
        """Block by block."""
        return self.assemble(
            [G.exp_along(numbers[..., n], angles[..., k]) for G, n, k in self._screws]
        )

    @cached_property
    def _screws(self) -> list[tuple[MatrixLieGroup, slice, slice]]:
        """Each factor, with the places of its numbers and of its rates."""
        screws = [factor.screw(np.zeros(factor.dimension)) for factor in self.factors]
        numbers = _slices([len(each) for _, each, _ in screws])
        return list(zip(self.factors, numbers, _slices([len(r) for *_, r in screws]), strict=True))

    def log(self, Q: Array) -> Array:
        """Block by block."""
        return np.concatenate([G.log(Q[..., own, own]) for G, own, _ in self._layout()], axis=-1)

    def log_force(self, x: Array, p: Array) -> Array:
        """Block by block."""
        forces = [factor.log_force(x[..., at], p[..., at]) for factor, _, at in self._layout()]
        return np.concatenate(forces, axis=-1)

    def drift(self, Q: Array) -> Array:
        """The largest drift of a factor."""
        return reduce(maximum, [G.drift(Q[..., own, own]) for G, own, _ in self._layout()])

    def assemble(self, poses: list[Array]) -> Array:
        """Return the pose whose blocks are these poses of the factors."""
        return _block_diagonal(poses, self.blocks)

    def _layout(self) -> list[tuple[MatrixLieGroup, slice, slice]]:
        return list(zip(self.factors, self.blocks, self.coordinates, strict=True))


def _block_diagonal(matrices: list[Any], blocks: list[slice]) -> Array:
    """Return matrices with these blocks on the diagonal."""
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    like = next((each for each in matrices if not isinstance(each, np.ndarray)), matrices[0])
    shape = (*batch, blocks[-1].stop, blocks[-1].stop)
    whole = np.zeros_like(like, shape=shape, dtype=np.result_type(*matrices))
    for matrix, block in zip(matrices, blocks, strict=True):
        whole[..., block, block] = matrix
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


def _subscript(index: int) -> str:
    return "".join(chr(ord("₀") + int(digit)) for digit in str(index + 1))
