"""The keys of a configuration that say what is searched for: `tune` and `worst`."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, Tag

from eqt_cli.base.option_types import (
    ANY,
    VELOCITY,
    Angle,
    AnyReal,
    Count,
    CountOrNone,
    Positive,
    Real,
    Unit,
    one_of,
    rank,
)
from eqt_cli.config.designs import DrawnRange
from eqt_cli.config.marks import SEARCH, NotSwept, Section


class LogRange(Section):
    """A range on a logarithmic scale, in short.

    Attributes
    ----------
    log
        Its ends.
    off
        A further value, of a law without this number: `{log: [0.01, 10], off: 0}`. That law is
        searched first, so that no law is worse in training than one that it contains.
    times
        Another number of the law, such as `kp`, which the ends are multiples of.
    """

    log: Annotated[list[Positive], Unit(ANY)]
    off: Annotated[float | None, Unit(ANY)] = None
    times: str | None = None


def _tuned_kind(value: Any) -> str | None:
    ends = value.get("log", [0, 0]) if isinstance(value, dict) else value
    if not (isinstance(ends, list) and len(ends) == 2):
        return None
    return "ends" if ends is value else "log" if "log" in value else "range"


TunedAxis = Annotated[
    Annotated[list[AnyReal], Tag("ends")]
    | Annotated[LogRange, Tag("log")]
    | Annotated[DrawnRange, Tag("range")],
    one_of(_tuned_kind, "[low, high], {log: [low, high]} or {low: …, high: …, scale: …}"),
]
"""Between which values a number is tuned."""


class WorstRunSection(Section):
    """A bound for every run instead of the mean.

    Attributes
    ----------
    max
        No run may have more.
    min
        No run may have less.
    """

    max: Real | None = None
    min: Real | None = None


Bound = Annotated[
    Annotated[Real, Tag("scalar")] | Annotated[WorstRunSection, Tag("each")],
    one_of(
        lambda value: "each" if isinstance(value, dict) else rank(value),
        "a number (of the mean over runs) or {max: …} (of the worst run)",
    ),
]
"""Bounds of a metric."""


class ConfirmSection(Section):
    """The runs on which winners are judged; none of them takes part in the search.

    Attributes
    ----------
    runs
        How many.
    seed
        Root of their random streams, none of a training sample; default: the first one after them.
    """

    runs: Count = 500
    seed: int | None = Field(default=None, ge=0, lt=2**63)


class ProofSection(Section):
    """What the proofs of `objective: certified_rate` and `push_bound` are about.

    Attributes
    ----------
    velocity
        The proof is for all references with each |V_d,i| at most this: one number, or one for each
        axis. Default: the box around the velocity of this reference.
    push
        The size of the wrench of `push_bound`, N m.
    step
        `subject_to: {step_torque: …}` bounds the torque at a turn of the pose by up to this angle.
    """

    velocity: Annotated[Real | list[Real], Unit(VELOCITY)] | None = None
    push: Annotated[Real, Unit("N m"), Field(ge=0)] = 0.0
    step: Annotated[Angle, Field(gt=0, le=np.pi)] = np.pi / 2


class SearchSection(Section):
    """What a search varies.

    Attributes
    ----------
    over
        Keys to vary, and their ranges.
    set
        Keys that follow from names in `over`, by formulas: `{gains.kp: 'w**2'}`.
    """

    over: Annotated[dict[str, TunedAxis], Field(min_length=1)]
    set: dict[str, Any] = Field(default={})


class TuneSection(SearchSection):
    """What `eqt tune` chooses for each law, by what, and for how long it searches.

    Attributes
    ----------
    over
        Keys to tune, in `gains` and `controllers`, and their ranges: `[low, high]`,
        `{log: [low, high], off: 0, times: kp}`, or a range as of designs. `off` is a law without
        this number, `times` another one whose multiples the ends are. Keys of an entry of
        `controllers` are that law's own; keys of `gains` are tuned for every law that reads them. A
        law without a key is compared as it is. A name, such as `w`, is for the formulas of `set`.
    set
        Keys of `gains` and `controllers` that follow from names in `over`, by formulas, as in a
        sweep: `{gains.kp: 'w**2'}`.
    objective
        The metric to be made best, in the mean over runs; or a bound that is proved without runs:
        `certified_rate`, `push_bound`.
    objectives
        Instead of it two metrics, of which the Pareto front is found.
    equal
        Metrics of which every law gets the same, in the mean over runs and cases:
        `{effort: 50}`. A law that is best with less says so.
    subject_to
        Bounds of metrics: a number bounds the mean over runs from the side that is worse, `{max:
        …}` or `{min: …}` the worst run; `failed` bounds the share of failed runs (default: 0). Of a
        proof: `step_torque`, `bandwidth`, `delay_margin`, `damping`.
    samples
        Training samples: for each, a law is tuned on other runs, from other first points. Sample k
        has the seed `ensemble.seed` + k − 1. With fewer than 3, no law is called better.
    budget
        Largest number of points for each law and sample, each with `ensemble.runs` runs, before the
        samples exchange their best ones. Default: 100; of a front 1280 for each law and seed.
    cases
        By their names, what cases change of the task, as the design `cases` of a sweep: actuators,
        delays, the inertia, …; a point is run in all of them.
    over_cases
        The objective over cases: their mean (default), or the worst of them. Bounds hold in each.
    confirm
        The held-out runs on which the winners and the starting gains are compared.
    proof
        What a proof is about, if the objective is one: `certified_rate`, or `push_bound`. It needs
        no runs: `budget` and `samples` are not used.
    population
        Of a front: points of a generation. Default: 32.
    seeds
        Of a front: searches for each law, with `seed` and the numbers after it. Default: 3.
    seed
        Of a front: of the first search. The first generation of one seed is the same for all laws.
    """

    objective: str | None = None
    objectives: list[str] | None = None
    equal: dict[str, Real] = Field(default_factory=dict)
    subject_to: dict[str, Bound] = Field(default_factory=dict)
    samples: Count = 5
    budget: Count | None = None
    cases: dict[str, dict[str, Any]] | None = None
    over_cases: Literal["mean", "worst"] | None = None
    confirm: ConfirmSection = Field(default_factory=ConfirmSection)
    proof: ProofSection = Field(default_factory=ProofSection)
    population: Annotated[int, Field(ge=5)] | None = None
    seeds: Count | None = None
    seed: CountOrNone | None = None


class ProfileSection(Section):
    """The runs of all laws along each key, through the worst points, which the figure shows.

    Attributes
    ----------
    points
        Values along each key, besides the found one. Default: 21, or fewer where they would take
        more runs than the search, but at least 5.
    runs
        How many of the runs are computed at each. Default: all, `ensemble.runs`.
    """

    points: Annotated[int, Field(ge=2)] | None = None
    runs: Count | None = None


class WorstSection(SearchSection):
    """Within which ranges `eqt worst` looks for the worst run of each law, and for how long.

    Attributes
    ----------
    over
        Keys to vary, and their ranges: `[low, high]`, `{log: [low, high]}`, or a range as of
        designs. Any key that holds a number and that a sweep may vary; keys of an entry of
        `controllers` are that law's own. Whole numbers, as `control.delay`, stay whole. A name,
        such as `w`, is for the formulas of `set`.
    set
        Keys that follow from names in `over`, by formulas, as in a sweep: `{gains.kp: 'w**2'}`.
    objective
        The metric whose worst value over all runs is looked for; a failed run is worse than any.
    budget
        Generations; each law has the same number.
    population
        Points of a generation, each with `ensemble.runs` runs.
    seeds
        Searches for each law, with `seed` and the numbers after it: their spread shows how far the
        outcome depends on the seed.
    seed
        Of the first search. The first generations of one seed are the same points for all laws.
    profile
        How many runs show each law along each key, through the points that were found.
    """

    objective: str
    budget: Count = 30
    population: Annotated[int, Field(ge=5)] = 32
    seeds: Count = 3
    seed: CountOrNone = 0
    profile: ProfileSection = Field(default_factory=ProfileSection)


class Keys(Section):
    """The keys of searches.

    Attributes
    ----------
    tune
        What `eqt tune` searches for; every other command leaves it aside.
    worst
        Where `eqt worst` searches for the worst run; every other command leaves it aside.
    """

    tune: Annotated[TuneSection | None, NotSwept("chooses its own points"), SEARCH] = None
    worst: Annotated[WorstSection | None, NotSwept("chooses its own points"), SEARCH] = None
