"""Values of a held command between two samples, which metrics do not see."""

from collections.abc import Iterator

from eqt_cli.base import purposes
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon
from eqt_cli.loop.signals import holds
from eqt_cli.numbers.running import changes_missed


@purposes.meaning_of_an_experiment
def skipped_ticks(experiment: Experiment, shown: Horizon) -> Iterator[str]:
    """Say which values of the command that the loop holds lie between two samples."""
    time, store = experiment.config.time, experiment.config.store
    for period in list(holds(experiment.loop.vehicle).values())[:1]:
        if missed := int(changes_missed(experiment.times, period).max(initial=0.0)):
            ticks = round(time.duration / period)
            decimate = store.decimate * ticks // max(time.samples - 1, 1)
            yield (
                f"samples skip up to {missed} of {missed + 1} values of the held command, so "
                "means, efforts and shares at limits are estimates; exact: time.samples "
                f"{ticks + 1}, store.decimate {decimate}"
            )
