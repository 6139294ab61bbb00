"""Differential evolution in the unit cube. It proposes points; the caller scores them.

The steps are those of `scipy.optimize.differential_evolution` (strategy best1bin with dither). They
are written here for two reasons: the same loop serves one objective and Pareto fronts, and a
generation depends only on a seed and on the scores of the generations before it, so that a search
continues from stored generations bit for bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.tuning.ranking import Scores, best_of, first_front, survivors

MUTATION = (0.5, 1.0)
"""Range from which each generation draws the weight of the differences."""

CROSSOVER = 0.7
"""Probability that a trial takes a coordinate from the mutant."""


@dataclass(frozen=True)
class Population:
    """The points that survive a generation.

    Attributes
    ----------
    shares : (points, dimensions)
        Coordinates in the unit cube.
    scores
        Scores of the points.
    """

    shares: Array
    scores: Scores

    @property
    def best(self) -> int:
        """Index of the best point (`ranking.best_of`); with several objectives, by the first."""
        return best_of(self.scores)

    @property
    def front(self) -> Array:
        """Indices of the feasible points on the Pareto front, sorted by the first objective."""
        return first_front(self.scores)


def generator(seed: int, name: str, generation: int) -> np.random.Generator:
    """Return the random stream of one generation of a named search."""
    sequence = np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()), generation))
    return np.random.Generator(np.random.PCG64DXSM(sequence))


def first_points(
    count: int, keys: Sequence[str], start: Sequence[float] | None, seed: int
) -> Array:
    """Return a Latin hypercube whose first point is replaced by `start`, if there is one.

    Each key has its own random stream, so that laws start from the same values of the keys that
    they share.

    Returns
    -------
    (count, keys)
    """
    from scipy.stats import qmc

    strata = [qmc.LatinHypercube(1, rng=generator(seed, key, 0)).random(count) for key in keys]
    points: Array = np.concatenate(strata, axis=1)
    if start is not None:
        points[0] = start
    return points


def trials(population: Population, random: np.random.Generator, keeps_ends: bool = False) -> Array:
    """Return one trial for each point: the mutant best + F (a − b), crossed with the point.

    Coordinates outside the cube are clipped to it if `keeps_ends`, else drawn again uniformly. With
    several objectives, `best` is a random point of the front for each trial.
    """
    shares = population.shares
    count, dimensions = shares.shape
    weight = random.uniform(*MUTATION)
    front = population.front
    leading = random.integers(len(front), size=count) if len(front) else np.zeros(count, dtype=int)
    several = population.scores.objectives.shape[1] > 1 and len(front) > 0
    best = shares[front[leading]] if several else shares[population.best]
    others = np.array([_two_others(k, count, random) for k in range(count)])
    mutants = best + weight * (shares[others[:, 0]] - shares[others[:, 1]])
    crossed = random.random((count, dimensions)) < CROSSOVER
    crossed[np.arange(count), random.integers(dimensions, size=count)] = True
    outside = (mutants < 0) | (mutants > 1)
    drawn = random.random((count, dimensions))
    mutants = np.where(outside, np.clip(mutants, 0, 1) if keeps_ends else drawn, mutants)
    return np.where(crossed, mutants, shares)


def _two_others(this: int, count: int, random: np.random.Generator) -> Array:
    """Draw two different points, neither of which is `this`."""
    chosen: Array = random.permutation(count)[:3]
    return chosen[chosen != this][:2]


def selected(population: Population, tried: Population) -> Population:
    """Return the survivors of a population and its trials; trial k competes with point k."""
    kept = survivors(population.scores, tried.scores)
    shares = np.concatenate([population.shares, tried.shares])[kept]
    return Population(shares, Scores.joined(population.scores, tried.scores).at(kept))
