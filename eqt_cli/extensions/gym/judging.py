"""Whether a result judges a policy by the runs of its training."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

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
    """

    label: str = ""

    def compared(self, result: Result) -> list[str]:
        """Refuse."""
        seed = seed_of(result.config)
        raise result.error(
            f"'{printable(self.label)}' was trained on the runs of seed {seed}, which are those of "
            "this result, so a comparison would flatter it; run the experiment with another "
            f"ensemble.seed, as --set ensemble.seed={seed + 1000}"
        )


def seed_of(config: Mapping[str, Any]) -> int:
    """Return the seed of a configuration."""
    return int((config.get("ensemble") or {}).get("seed", 0))


def conclude(result: Result) -> Conclusion | None:
    """Return that comparisons are refused, if a network was trained on this seed."""
    stored = str(result.attributes.get("files", "{}"))
    if '\\"trained\\"' not in stored:  # which most results are spared from
        return None
    with suppress(ValueError, TypeError, AttributeError, KeyError, RecursionError):
        texts, config = json.loads(stored), result.config
        for law in config["controllers"]:
            about = trained(texts, law) if isinstance(law, dict) else {}
            if about.get("seed") == seed_of(config):
                return JudgedByTraining(label=str(law.get("label", law["kind"])))
    return None


def trained(texts: Mapping[str, str], law: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what the file of a law says of its training; empty if it is no trained network."""
    if law.get("kind") != "network" or law.get("file") not in texts:
        return {}
    about = json.loads(texts[law["file"]]).get("trained", {})
    return about if isinstance(about, dict) else {}


def remarks(experiment: Any, shown: object) -> Iterator[tuple[Any, str]]:
    """Yield a remark on a policy that is flown by the runs of its training, or at another rate."""
    config, texts = experiment.document.data, experiment.document.home.files
    for index, law in enumerate(config.get("controllers") or ()):
        if not isinstance(law, dict) or "trained" not in texts.get(law.get("file"), ""):
            continue
        about, key = trained(texts, law), ("controllers", index, "file")
        if about.get("seed") == experiment.config.ensemble.seed:
            yield (
                key,
                f"was trained on the runs of seed {about['seed']}, which is ensemble.seed; eqt "
                "compare refuses to judge it by them, so choose another one",
            )
        period = experiment.vehicle.control and experiment.vehicle.control.period
        if period and about.get("period", period) != period:
            yield (
                key,
                f"was trained at a period of {about['period']:g} s, and control.period is "
                f"{period:g} s",
            )
