"""Differential evolution in the unit cube, ask and tell; it knows neither laws nor runs.

Written here rather than with `scipy.optimize.differential_evolution`, whose steps these are
(strategy best1bin with dither), for two reasons: one loop serves one objective and fronts, and a
generation is a function of the scores of those before it and of a seed, so that a search goes on
from what is stored, bit for bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.tuning.ranking import Scores, best_of, first_front, survivors

MUTATION = (0.5, 1.0)
"""The weight of a difference is drawn between these for every generation."""

CROSSOVER = 0.7
"""The share of coordinates that a trial takes from the mutant."""


@dataclass(frozen=True)
class Population:
    """The points that a generation leaves behind.

    Attributes
    ----------
    shares : (points, dimensions)
        In the unit cube.
    scores
        Of each.
    """

    shares: Array
    scores: Scores

    @property
    def best(self) -> int:
        """The best point by the rules of `ranking`; of several objectives, by the first."""
        return best_of(self.scores)

    @property
    def front(self) -> Array:
        """The feasible points that no other betters in all objectives, by the first of these."""
        return first_front(self.scores)


def generator(seed: int, name: str, generation: int) -> np.random.Generator:
    """The random stream of one generation of a search that has a name."""
    sequence = np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()), generation))
    return np.random.Generator(np.random.PCG64DXSM(sequence))


def first_points(
    count: int, keys: Sequence[str], start: Sequence[float] | None, seed: int
) -> Array:
    """A Latin hypercube; its first point makes room for where the search starts, if that is in it.

    Each key has a random stream of its own, so that laws start from the same values of the keys
    that they share.

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
    """A point to be tried against each of the population: best + F (a − b), crossed with it.

    Coordinates that leave the cube are drawn anew, evenly, or become its ends. Of several
    objectives, the best is any point of the front, drawn for each trial.
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
    """Two points that are neither this one nor the same."""
    chosen: Array = random.permutation(count)[:3]
    return chosen[chosen != this][:2]


def selected(population: Population, tried: Population) -> Population:
    """What is left of a population and the trials, trial k standing against point k."""
    kept = survivors(population.scores, tried.scores)
    shares = np.concatenate([population.shares, tried.shares])[kept]
    return Population(shares, Scores.joined(population.scores, tried.scores).at(kept))
