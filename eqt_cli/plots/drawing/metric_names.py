"""How figures call metrics, in few words and the paper's symbols; it knows no figure."""

from __future__ import annotations

from eqt_cli.plots.drawing.labels import SYMBOLS, free_text, in_words, quantity
from eqt_cli.store.reader import Results

_SYMBOLIC = {
    "early_torque": ("mean {}, first 5 s", SYMBOLS["torque_norm"]),
    "peak_torque": ("largest {}", SYMBOLS["torque_norm"]),
    "mean_pose_error": ("mean {}", SYMBOLS["pose_error"]),
    "final_pose_error": ("final {}", SYMBOLS["pose_error"]),
    "final_velocity_error": ("final {}", SYMBOLS["velocity_error"]),
}
"""Short names of metrics, each with a symbol where its braces are."""

_WORDS = {"effort": "effort", "settling_time": "settling time"}
"""Short names without a symbol; what has neither is called by its long name."""


def metric_label(results: Results, metric: str, characters: int) -> str:
    """The name of a metric with its unit, in lines of at most so many characters."""
    unit = results.units(metric)
    if metric in _SYMBOLIC:
        words, symbol = _SYMBOLIC[metric]
        return words.format(quantity(symbol, unit))
    if metric in _WORDS:
        return in_words(_WORDS[metric], unit)
    return in_words(free_text(results.long_name(metric), characters), unit)
