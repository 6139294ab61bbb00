"""The `solver` section: chooses one engine, and checks the keys of all engines."""

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
    """The engine and the judgement of its accuracy.

    Attributes
    ----------
    engine
        The engine that integrates the runs.
    other
        Another available engine with its keys of the section, for the cross-check.
    judgement
        Settings of error estimates and cross-checks.
    resolved
        The complete section.
    """

    engine: Engine
    other: Engine | None
    judgement: Judgement
    resolved: dict[str, Any]

    @property
    def estimates_errors(self) -> bool:
        """Whether every run is solved twice to estimate its error."""
        wanted = self.judgement.error_estimate
        return self.engine.estimates_errors if wanted is None else wanted


def solver_from(section: dict[str, Any], problems: Problems) -> Solver | None:
    """Return the solver of a section, or None after noting its problems."""
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
    """Raise an `InputError` if there is no engine of this name, or it is not available."""
    if not isinstance(name, str):
        raise InputError(f"expected the name of an engine, got {shown(name)}")
    unavailable = engines.get(name).unavailable()
    if unavailable:
        raise InputError(unavailable)


def _can_check(engine: Engine) -> bool:
    """Whether an engine is available for the cross-check and accepts its keys."""
    found = Problems()
    engine.check(found)
    return engine.cross_check_rank is not None and engine.unavailable() is None and not found


def _cross_check_order(engine: Engine) -> tuple[bool, int]:
    """Return the sort key of engines: eqt's engines come before those of plugins."""
    return is_foreign(type(engine).__module__), engine.cross_check_rank or 0
