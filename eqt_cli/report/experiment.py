"""The experiment in words: plant, reference, laws with their weights, and runs."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from eqt_cli.config.schema import DEFAULT_ENGINE, Judgement
from eqt_cli.config.source import source_of
from eqt_cli.controllers import controllers
from eqt_cli.controllers.family import Member
from eqt_cli.core.errors import ComponentError, EqtError
from eqt_cli.core.registry import summary
from eqt_cli.core.validation import option_names
from eqt_cli.engines import engines
from eqt_cli.experiment.build import OF_EVERY_LAW
from eqt_cli.results.result import Result


@dataclass(frozen=True)
class StatedValue:
    """A stated part of the configuration.

    Attributes
    ----------
    name, symbol
        Name, and symbol in the equations.
    words
        Value in words; empty for a matrix.
    matrix
        Rows of a matrix; empty for other values.
    """

    name: str
    symbol: str
    words: str
    matrix: list[list[str]]


@dataclass(frozen=True)
class Law:
    """A law of the experiment.

    Attributes
    ----------
    title, label, kind
        Name in figures, name in tables, and kind in the configuration.
    says
        First line of its documentation; empty for a law of a plugin.
    weights
        (g, c, n, q) for a member of the family; else empty.
    damping
        Frame of the damping, for a member of the family.
    own
        Gains and options of this law alone, as running text.
    """

    title: str
    label: str
    kind: str
    says: str
    weights: tuple[str, ...]
    damping: str
    own: str


MOST_VALUES = 12
"""Maximum length of a list that is written out; the lines of a search have hundreds."""


def laws(result: Result) -> list[Law]:
    """Return the laws in the order of the result."""
    entries = _stored(result).get("controllers") or []
    own = {entry.get("label"): _own(entry) for entry in entries if isinstance(entry, Mapping)}
    return [
        _law(label, title, result.kinds.get(label, label), own.get(label, ""))
        for label, title in result.titled.items()
    ]


def _own(entry: Mapping[str, Any]) -> str:
    """Return the gains and options that an entry of `controllers` sets: ``gains: kp 4``."""
    gains = told(entry.get("gains"))
    options = {key: value for key, value in entry.items() if key not in ("kind", *OF_EVERY_LAW)}
    return "; ".join(filter(None, [f"gains: {gains}" if gains else "", told(options)]))


def _law(label: str, title: str, kind: str, own: str) -> Law:
    says, damping = "", ""
    weights: tuple[str, ...] = ()
    with suppress(ComponentError):  # law of a plugin that is not loaded here
        law = controllers.get(kind)
        says = summary(law)
        # Members with body errors have another formula, given in their summary.
        if issubclass(law, Member) and law.frames[0] == "spatial":
            weights, damping = tuple(f"{weight:g}" for weight in law.weights), law.frames[1]
    return Law(title, label, kind, says, weights, damping, own)


def given(result: Result) -> list[StatedValue]:
    """Return the parts of the stored configuration, ordered as in a paper's section."""
    config = _stored(result)
    return list(_parts(config, result)) if config else []


def _stored(result: Result) -> Mapping[str, Any]:
    """Return the configuration in a result; empty for a file of the first versions."""
    try:
        return source_of(result).data
    except (EqtError, KeyError):
        return {}


def _parts(config: Mapping[str, Any], result: Result) -> Iterator[StatedValue]:
    group = result.group
    yield _words("Group", "", f"{result.group_name}: {summary(type(group))}" if group else "")
    yield _quantity("Inertia", "𝕀", config.get("inertia"))
    gains = config.get("gains") or {}
    yield _quantity("Weight of the navigation function", "K", gains.get("kp"))
    yield _quantity("Damping", "K_d", gains.get("kd"))
    yield _words("Reference", "Q_d", config.get("reference"))
    yield _words("Target", "", config.get("target"))
    for name in ("plant", "control", "actuators", "sensors", "estimator"):
        yield _words(name.capitalize(), "", config.get(name))
    initial = config.get("initial") or {}
    yield _words("Initial poses", "Q(0)", initial.get("pose"))
    yield _words("Initial velocities", "V(0)", initial.get("velocity"))
    yield _words("Initial states", "", initial.get("file"))
    runs = config.get("ensemble") or {}
    yield _words("Runs", "", f"{result.runs} of each law, from seed {runs.get('seed', 0)}")
    time = config.get("time") or {}
    yield _words("Time", "", f"{told(time.get('duration'))} s, {told(time.get('samples'))} samples")
    yield _words("Integration", "", _used(config.get("solver") or {}))
    yield _words("Sweep", "", config.get("sweep"))


def _used(solver: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the keys of `solver` that its engine uses; a result stores those of all engines."""
    try:
        engine = engines.get(solver.get("engine", DEFAULT_ENGINE))
    except ComponentError:  # engine of a plugin that is not loaded here
        return solver
    known = ("engine", *option_names(engine), *option_names(Judgement))
    return {key: value for key, value in solver.items() if key in known}


def _quantity(name: str, symbol: str, value: Any) -> StatedValue:
    """State a tensor: a number is a multiple of the identity, a list a diagonal."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return StatedValue(name, symbol, "", [[told(entry) for entry in row] for row in value])
    if isinstance(value, list):
        return StatedValue(name, symbol, f"diag{told(value)}", [])
    words = told(value)
    return StatedValue(name, symbol, f"{words} · I" if _is_number(value) else words, [])


def _words(name: str, symbol: str, value: Any) -> StatedValue:
    return StatedValue(name, symbol, told(value), [])


def told(value: Any) -> str:
    """Return a value of a configuration as running text; empty for None.

    ``{kind: normal, std: 1.0}`` becomes ``normal: std 1``, and ``[0.0, 1]`` becomes ``(0, 1)``.
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if _is_number(value):
        return f"{value:.6g}".replace("-", "−")
    if isinstance(value, list):
        parts = [told(entry) for entry in value]
        if len(parts) > MOST_VALUES:
            ends = [*parts[: MOST_VALUES // 2], "…", parts[-1]]
            return f"{len(parts)} values {_tuple(ends)}"
        return "; ".join(parts) if any(isinstance(e, dict) for e in value) else _tuple(parts)
    if isinstance(value, Mapping):
        named = {key: told(entry) for key, entry in value.items() if key != "kind"}
        options = ", ".join(
            f"{key.replace('_', ' ')} {said}".strip()
            for key, said in named.items()
            if said or value[key] == {}  # a case that changes nothing
        )
        return ": ".join(filter(None, [str(value.get("kind", "")), options]))
    return str(value)


def _tuple(parts: list[str]) -> str:
    return f"({', '.join(parts)})"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
