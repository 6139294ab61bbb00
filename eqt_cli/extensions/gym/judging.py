"""Whether a result judges a policy by the runs of its training."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.errors import printable
from eqt_cli.results.conclusion import Conclusion
from eqt_cli.results.result import Result


@dataclass(frozen=True)
class JudgedByTraining(Conclusion):
    """A result that judges a policy by the runs of its training: it is not compared.

    Attributes
    ----------
    label
        The law.
    seed
        That of its training.
    """

    label: str = ""
    seed: int = 0

    def compared(self, result: Result) -> list[str]:
        """Refuse."""
        raise result.error(
            f"'{printable(self.label)}' was trained on the runs of seed {self.seed}, which are of "
            "this result, so a comparison would flatter it; run the experiment with another "
            f"ensemble.seed, as --set ensemble.seed={self.seed + 1000}"
        )


def seeds_of(result: Result) -> set[int]:
    """Return the seeds of a result: of its configuration, and those that a sweep takes."""
    seeds = {int((result.config.get("ensemble") or {}).get("seed", 0))}
    for swept in result.swept_keys:
        if swept.key == "ensemble.seed":
            seeds |= {int(seed) for seed in swept.values}
    return seeds


@purposes.conclusion_of_a_result
def conclude(result: Result) -> Conclusion | None:
    """Return that comparisons are refused, if a network was trained on this seed."""
    stored = str(result.attributes.get("files", "{}"))
    if '\\"trained\\"' not in stored:  # which most results are spared from
        return None
    with suppress(ValueError, TypeError, AttributeError, KeyError, RecursionError):
        texts = json.loads(stored)
        for law in result.config["controllers"]:
            about = trained(texts, law) if isinstance(law, dict) else {}
            if common := seeds_of_training(about) & seeds_of(result):
                return JudgedByTraining(label=str(law.get("label", law["kind"])), seed=min(common))
    return None


def trained(texts: Mapping[str, str], law: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what the file of a law says of its training; empty if it is no trained network."""
    if law.get("kind") != "network" or law.get("file") not in texts:
        return {}
    about = json.loads(texts[law["file"]]).get("trained", {})
    return about if isinstance(about, dict) else {}


def seeds_of_training(about: Mapping[str, Any]) -> set[int]:
    """Return the seeds of all trainings that a file records; a training may go on by another."""
    words = f"{about.get('seeds', '')} {about.get('seed', '')}".replace(",", " ").split()
    return {int(word) for word in words if re.fullmatch("[0-9]{1,20}", word)}


@purposes.remarks_on_an_experiment
def remarks(experiment: Any, shown: object) -> Iterator[tuple[Any, str]]:
    """Yield a remark on a policy that is flown by the runs of its training, or at another rate."""
    config, texts = experiment.document.data, experiment.document.home.files
    for index, law in enumerate(config.get("controllers") or ()):
        if not isinstance(law, dict) or "trained" not in texts.get(law.get("file"), ""):
            continue
        about, key = trained(texts, law), ("controllers", index, "file")
        if (seed := experiment.config.ensemble.seed) in seeds_of_training(about):
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
