"""The `solver` section: one engine is used, the keys of all engines are checked and kept."""

from dataclasses import asdict, dataclass
from itertools import repeat
from typing import Any

from eqt_cli.config.schema import DEFAULT_ENGINE, Judgement
from eqt_cli.core.errors import InputError
from eqt_cli.core.problems import Problems
from eqt_cli.core.registry import is_foreign
from eqt_cli.core.validation import option_names, shown, unknown_key, validated
from eqt_cli.engines import Engine, engines


@dataclass(frozen=True)
class Solver:
    """The engine, how its accuracy is judged, and the section as it is kept.

    Attributes
    ----------
    other
        Another engine of this machine with its own keys of the section, for the cross-check.
    """

    engine: Engine
    other: Engine | None
    judgement: Judgement
    resolved: dict[str, Any]

    @property
    def estimates_errors(self) -> bool:
        """Whether every run is solved a second time."""
        wanted = self.judgement.error_estimate
        return self.engine.estimates_errors if wanted is None else wanted


def solver_from(section: dict[str, Any], problems: Problems) -> Solver | None:
    """The solver that a section asks for, or None after noting what is wrong with it."""
    name = section.get("engine", DEFAULT_ENGINE)
    with problems.catching("engine"):
        _require_available(name)
    owners: list[type[Any]] = [Judgement, *engines.all()]
    known = ["engine", *dict.fromkeys(key for own in owners for key in option_names(own))]
    for key in section:
        if key not in known:
            problems.at(key).add(unknown_key(key, known))
    own = ({key: section[key] for key in option_names(kind) if key in section} for kind in owners)
    judgement, *built = map(validated, owners, own, repeat(problems))
    engine = next((entry for entry in built if entry and entry.name == name), None)
    if engine is not None:
        engine.check(problems)
    if engine is None or problems:
        return None
    keys = {**section, **asdict(engine), **asdict(judgement), "engine": name}
    given = {key: value for key, value in keys.items() if value is not None}
    others = [entry for entry in built if entry is not engine and _can_check(entry)]
    other = min(others, key=_cross_check_order, default=None)
    return Solver(engine, other, judgement, {"engine": name} | given)


def _require_available(name: Any) -> None:
    """Raise an `InputError` if there is no engine of this name, or none on this machine."""
    if not isinstance(name, str):
        raise InputError(f"expected the name of an engine, got {shown(name)}")
    unavailable = engines.get(name).unavailable()
    if unavailable:
        raise InputError(unavailable)


def _can_check(engine: Engine) -> bool:
    """Whether another engine is there, and can work with the keys that it shares."""
    found = Problems()
    engine.check(found)
    return engine.cross_check_rank is not None and engine.unavailable() is None and not found


def _cross_check_order(engine: Engine) -> tuple[bool, int]:
    """eqt's own engines come before others that are derived from them."""
    return is_foreign(type(engine).__module__), engine.cross_check_rank or 0
