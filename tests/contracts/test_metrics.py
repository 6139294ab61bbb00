"""What every metric must be, whoever wrote it."""

from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Kind, option_names
from eqt_cli.base.registry import summary
from eqt_cli.loop.signals import metrics
from eqt_cli.numbers.running import goes_by_samples


def test_it_says_what_it_is_and_which_values_are_better(metric_class):
    assert summary(metric_class).endswith(".")
    assert metric_class.better in ("lower", "higher", "neither")
    assert metric_class.signals
    assert isinstance(metric_class.units, str)


OPTIONS = {"cones": [{"axis": [0, 0, 1], "at": ["cos(t)", 0, 1], "angle": 1.0}]}
SHAPES = {"pose": (3, 3)}


def test_it_goes_from_sample_to_sample(metric_class):
    options = {name: x for name, x in OPTIONS.items() if name in option_names(metric_class)}
    read = Kind(metrics).read({"kind": metric_class.name, **options}, Problems(str))
    metric = read if options else metric_class()

    def measured(over, signals):
        return metric.of(over, *signals.values())

    assert goes_by_samples(measured, {x: SHAPES.get(x, ()) for x in metric_class.signals})
