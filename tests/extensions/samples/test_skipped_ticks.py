"""What `eqt config check` says of a held command that samples skip."""

from small_experiment import mapping

from eqt_cli.api import load_experiment
from eqt_cli.extensions.samples.skipped_ticks import skipped_ticks


def lines(samples):
    time = {"duration": 2.0, "samples": samples}
    study = load_experiment(mapping(control={"period": 0.1}, time=time))
    return [*skipped_ticks(study.base, None)]


def test_samples_that_skip_values_of_a_held_command_are_told_with_those_that_do_not():
    """A command of 0.1 s over 2 s has 21 values; three samples skip nine after each."""
    [line] = lines(3)
    assert line.startswith("samples skip up to 9 of 10 values of the held command")
    assert line.endswith("exact: time.samples 21, store.decimate 10")
    assert lines(21) == []
