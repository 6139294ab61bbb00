"""The bounds of `failed_when` in the block diagram, beside the plant, whose runs they end."""

from collections.abc import Iterator

from eqt_cli.base import purposes
from eqt_cli.config.experiment import Experiment
from eqt_cli.loop.bounds import bounds_of
from eqt_cli.results.quantity import Plain


@purposes.boxes_of_a_diagram
def boxes(experiment: Experiment) -> Iterator[tuple[str, str, list[str]]]:
    """Yield the stage, the title and the lines of the bounds at which runs end."""
    if not experiment.config.failed_when:
        return
    bounds = bounds_of(experiment.config.failed_when, next(iter(experiment.loops.values())))
    lines = []
    written = experiment.document.data["failed_when"]  # whose words and units are kept
    for (word, value), (name, most) in zip(written.items(), bounds.most.items(), strict=True):
        number = value if isinstance(value, str) else f"{most:g} {Plain().unit(bounds.units[name])}"
        number = number.rstrip().replace(" ", "\u00a0")
        lines.append(f"{word.replace('_', ' ')} beyond {number}")
    yield "plant", "a run ends as failed", lines
