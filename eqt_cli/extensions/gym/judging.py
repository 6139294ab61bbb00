"""Whether runs judge a policy that was trained on them: by recorded seeds, and by the starts."""

from __future__ import annotations

import json
import re
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, printable
from eqt_cli.base.stored import POINT
from eqt_cli.results.conclusion import Conclusion
from eqt_cli.results.result import Result

# What tells starts apart ------------------------------------------------------------------------

MOST_MARKS = 1024
"""Starts of a training that its file records, and of runs that judge that are looked at."""

ALL_MARKS = 2000
"""Starts of all trainings that a file records."""

SIZE, DIGITS = 5, 6
"""Bytes of a mark, and digits behind the point of the numbers that it is of: two of 10⁶ pairs of
starts have one mark by chance, and other machines round otherwise."""

MOST_POINTS = 100
"""Points of a sweep with starts of their own that are looked at."""

SEED = "ensemble.seed"

Marks = dict[bytes, None]
"""Marks of starts, in the order of the runs."""


def marks_of(poses: Array, velocities: Array) -> Marks:
    """Return the marks of starts, ``(runs, …)`` both; none if all starts are one."""
    rows = np.concatenate([x.reshape(len(x), -1) for x in (poses, velocities)], axis=1)
    rounded = np.round(rows[:MOST_MARKS], DIGITS) + 0.0  # and -0 is 0
    marks = dict.fromkeys(blake2b(row.tobytes(), digest_size=SIZE).digest() for row in rounded)
    return marks if len(marks) > 1 else {}


def as_text(marks: Marks) -> str:
    """Return marks as a text for a file."""
    return b64encode(b"".join([*marks][:ALL_MARKS])).decode("ascii")


def from_text(text: Any) -> Marks:
    """Return the marks in a text; none where it is no such text."""
    with suppress(ValueError, TypeError):
        content = b64decode(text, validate=True)
        return dict.fromkeys(content[k : k + SIZE] for k in range(0, len(content), SIZE))
    return {}


def starts_of(experiment: Any, label: str, runs: int) -> Marks:
    """Return the marks of the first starts of a study."""
    from eqt_cli.runs.batches import batches_at

    which = np.arange(min(runs, MOST_MARKS))
    (batch,) = batches_at(experiment, label, np.zeros_like(which), which)
    return marks_of(batch.start["pose"], batch.start["velocity"])


# The guard: one question, of every set of runs that judges ----------------------------------------


def trained_on(about: Mapping[str, Any], seeds: set[int], starts: Callable[[], Marks]) -> str:
    """Return on which of some runs a policy was trained, in words; "" if on none."""
    if common := seeds_of_training(about) & seeds:
        return f"the runs of seed {min(common)}"
    marks = from_text(about.get("starts", ""))
    if marks and (shared := len(marks.keys() & starts().keys())):
        return f"{shared} of the starts"
    return ""


def flattered(label: str, runs: str, which: str) -> str:
    """Return the sentence on a policy that these runs would flatter."""
    return (
        f"'{printable(label)}' was trained on {runs}, which are {which}, so a comparison would "
        "flatter it"
    )


def trained(texts: Mapping[str, str], law: Any) -> Mapping[str, Any]:
    """Return what the file of a law, or of a part of it, says of its training; {} if nothing."""
    if not isinstance(law, dict):
        return {}
    with suppress(ValueError, TypeError, KeyError, RecursionError):
        if law.get("kind") == "network" and "trained" in (text := texts.get(law["file"], "")):
            about = json.loads(text)["trained"]
            return about if isinstance(about, dict) else {}
    return next(filter(None, (trained(texts, part) for part in law.values())), {})


def seeds_of_training(about: Mapping[str, Any]) -> set[int]:
    """Return the seeds of all trainings that a file records; a training may go on by another."""
    words = f"{about.get('seeds', '')} {about.get('seed', '')}".replace(",", " ").split()
    return {int(word) for word in words if re.fullmatch("[0-9]{1,20}", word)}


@purposes.laws_that_runs_flatter
def flattered_by(document: Any, which: str) -> Iterator[str]:
    """Yield a sentence on each law of a document that was trained on its runs."""
    from eqt_cli.config.study import study

    ensemble, texts = document.data.get("ensemble") or {}, document.home.files

    def starts() -> Marks:
        alone = {"controllers": [law], "sweep": None}
        (label,) = (one := study(replace(document, data=document.data | alone))).base.loops
        return starts_of(one, label, one.base.config.ensemble.runs)

    for law in document.data.get("controllers") or ():
        if runs := trained_on(trained(texts, law), {int(ensemble.get("seed", 0))}, starts):
            yield flattered(str(law.get("label", law["kind"])), runs, which)


# Results ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JudgedByTraining(Conclusion):
    """A result that judges a policy by the runs of its training: it is not compared.

    Attributes
    ----------
    said
        What is wrong.
    remedy
        What to do.
    """

    said: str = ""
    remedy: str = ""

    def compared(self, result: Result) -> list[str]:
        """Refuse."""
        raise result.error(f"{self.said}; {self.remedy}")


def seeds_of(result: Result) -> set[int]:
    """Return the seeds of a result: of its configuration, and those that a sweep takes."""
    seeds = [(result.config.get("ensemble") or {}).get("seed", 0)]
    if SEED in result.coordinates:
        seeds += np.ravel(result.coordinate(SEED)).tolist()
    return {int(seed) for seed in (*seeds, *_swept_seeds(result.config.get("sweep")))}


def _swept_seeds(part: Any) -> Iterator[Any]:
    """Yield the seeds in a sweep, also within its cases, which a result has by their names."""
    for key, value in part.items() if isinstance(part, dict) else enumerate(part or ()):
        if key == SEED and isinstance(value, int | list):
            yield from value if isinstance(value, list) else [value]
        elif isinstance(value, dict | list):
            yield from _swept_seeds(value)


@purposes.conclusion_of_a_result
def conclude(result: Result) -> Conclusion | None:
    """Return that comparisons are refused, if a network was trained on these runs."""
    stored = str(result.attributes.get("files", "{}"))
    if '\\"trained\\"' not in stored:  # which most results are spared from
        return None

    def starts() -> Marks:
        marks = Marks()
        if result.has("initial_pose") and result.has("initial_velocity"):
            several = result.is_sweep and POINT in result.dims("initial_pose")
            for point in range(min(MOST_POINTS, result.points) if several else 1):
                at = result.at(point) if result.is_sweep else result
                marks |= marks_of(at.read("initial_pose"), at.read("initial_velocity"))
        return marks

    with suppress(ValueError, TypeError, AttributeError, KeyError, RecursionError):
        texts, seeds = json.loads(stored), seeds_of(result)
        for law in result.config["controllers"]:
            if runs := trained_on(trained(texts, law), seeds, starts):
                other = max(seeds) + 1000
                remedy = (
                    f"run the experiment with another ensemble.seed, as --set ensemble.seed={other}"
                    if "seed" in runs
                    else "run the experiment from other starts"
                )
                said = flattered(str(law.get("label", law["kind"])), runs, "of this result")
                return JudgedByTraining(said=said, remedy=remedy)
    return None


@purposes.remarks_on_an_experiment
def remarks(experiment: Any, shown: object) -> Iterator[tuple[Any, str]]:
    """Yield a remark on a policy that is flown by the runs of its training, or at another rate."""
    config, texts = experiment.document.data, experiment.document.home.files
    for index, law in enumerate(config.get("controllers") or ()):
        if not (about := trained(texts, law)):
            continue
        key, seed = ("controllers", index, "file"), experiment.config.ensemble.seed
        if seed in seeds_of_training(about):
            yield (
                key,
                f"was trained on the runs of seed {seed}, which is ensemble.seed; eqt "
                "compare refuses to judge it by them, so choose another one",
            )
        period = experiment.vehicle.control and experiment.vehicle.control.period
        if period and about.get("period", period) != period:
            yield (
                key,
                f"was trained at a period of {about['period']:g} s, and control.period is "
                f"{period:g} s",
            )


# What `make` asks ---------------------------------------------------------------------------------


def seed_of_training(judges: Mapping[str, int], seed: int | None) -> int:
    """Return the seed of a training, by default the first one behind that of the experiment.

    Raises
    ------
    EqtError
        If runs of this seed judge.
    """
    if seed is None:
        first = judges[SEED] + 1
        return next(k for k in range(first, first + len(judges) + 1) if k not in judges.values())
    for key, judging in judges.items():
        if seed == judging:
            raise EqtError(
                f"seed: {seed} is {key}, by whose runs the experiment judges; train by another "
                "one, or leave it out"
            )
    return seed
