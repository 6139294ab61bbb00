"""What every metric must be, whoever wrote it."""

from eqt_cli.base.registry import summary
from eqt_cli.numbers.running import goes_by_samples


def test_it_says_what_it_is_and_which_values_are_better(metric_class):
    assert summary(metric_class).endswith(".")
    assert metric_class.better in ("lower", "higher", "neither")
    assert metric_class.signals
    assert isinstance(metric_class.units, str)


def test_it_goes_from_sample_to_sample(metric_class):
    def measured(over, signals):
        return metric_class().of(over, *signals.values())

    assert goes_by_samples(measured, dict.fromkeys(metric_class.signals, ()))
