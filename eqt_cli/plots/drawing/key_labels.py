"""What keys of a configuration are called along a scale, with units; it knows no figure."""

import re

from eqt_cli.core.problems import parse_key
from eqt_cli.plots.drawing.labels import free_text, in_words, quantity
from eqt_cli.results.result import Result

_TORQUE, _DAMPING, _RATE = "torque", "torque s", "torque/s"
"""Units that are those of a torque on this group, with what else belongs to them."""

_SYMBOLS = {"gains.kp": ("k_p", _TORQUE), "gains.kd": ("k_d", _DAMPING)}

_WORDS = {
    "gyroscopic": ("gyroscopic weight g", ""),
    "transport": ("transport weight c", ""),
    "connection": ("connection weight n", ""),
    "quadratic": ("quadratic weight q", ""),
    "period": ("control period", "s"),
    "delay": ("delay in periods", ""),
    "duration": ("horizon", "s"),
    "limit": ("limit", _TORQUE),
    "rate": ("rate limit", _RATE),
    "time_constant": ("time constant", "s"),
    "relative": ("relative error of the inertia", ""),
    "seed": ("seed", ""),
    "rtol": ("relative tolerance", ""),
    "atol": ("absolute tolerance", ""),
}
"""By the last step of a key."""

_LONGEST = 36
"""Characters in a line of a label."""


def key_label(result: Result, key: str) -> str:
    """The name of a swept key, with its unit; the key itself where it has no name."""
    steps = [str(step) for step in parse_key(key) if isinstance(step, str)]
    of = _owner(result, key)
    symbol = _SYMBOLS.get(".".join(steps[-2:]))
    if symbol and isinstance(parse_key(key)[-1], str):
        return quantity(symbol[0], _unit(result, symbol[1])) + free_text(of, _LONGEST)
    if steps[-1] not in _WORDS or not isinstance(parse_key(key)[-1], str):
        return free_text(key, _LONGEST)
    words, unit = _WORDS[steps[-1]]
    return in_words(free_text(words + of, _LONGEST), _unit(result, unit))


def _owner(result: Result, key: str) -> str:
    """Whose it is, where it is one of several controllers'."""
    found = re.match(r"controllers\[(\d+)\]", key)
    if found is None or len(result.labels) < 2 or int(found[1]) >= len(result.titles):
        return ""
    return f" of {result.titles[int(found[1])]}"


def _unit(result: Result, unit: str) -> str:
    """A unit; nothing where it would be that of a torque of several kinds."""
    if not unit.startswith(_TORQUE):
        return unit
    torque = result.units("peak_torque") if result.has("peak_torque") else "mixed"
    if torque in ("mixed", "1", ""):
        return ""
    return torque + unit.removeprefix(_TORQUE)
