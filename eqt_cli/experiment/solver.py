"""The `solver` section: one engine is used, the keys of all engines are checked and kept."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from eqt_cli.config.components import option_names, options_into
from eqt_cli.config.problems import Problems
from eqt_cli.config.schema import DEFAULT_ENGINE, Judgement
from eqt_cli.config.translate import UNKNOWN_KEY, shown
from eqt_cli.core.errors import ComponentError, suggestion
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
    before = len(problems)
    name = section.get("engine", DEFAULT_ENGINE)
    owners: dict[str, type[Any]] = {entry.name: entry for entry in engines.all()}
    _note_unknown_keys(section, [Judgement, *owners.values()], problems)
    _note_engine(name, problems)
    built = {owner: _build(entry, section, problems) for owner, entry in owners.items()}
    judgement = _build(Judgement, section, problems)
    engine = built.pop(name, None) if isinstance(name, str) else None
    for option, message in engine.problems() if engine else ():
        problems.add(("solver", option), message)
    if engine is None or len(problems) > before:
        return None
    others = [entry for entry in built.values() if _can_check(entry)]
    keys = {**section, **asdict(engine), **asdict(judgement), "engine": name}
    given = {key: value for key, value in keys.items() if value is not None}
    resolved = {"engine": name} | given
    return Solver(engine, others[0] if others else None, judgement, resolved)


def _can_check(engine: Engine) -> bool:
    """Whether another engine is there, and can work with the keys that it shares."""
    return engine.unavailable() is None and not engine.problems()


def _note_unknown_keys(section: dict[str, Any], owners: list[type], problems: Problems) -> None:
    known = list(dict.fromkeys(["engine", *(key for own in owners for key in option_names(own))]))
    for key in section:
        if key not in known:
            hint = suggestion(key, known) or f"; known here: {', '.join(known)}"
            problems.add(("solver", key), UNKNOWN_KEY + hint)


def _note_engine(name: Any, problems: Problems) -> None:
    if not isinstance(name, str):
        problems.add(("solver", "engine"), f"expected the name of an engine, got {shown(name)}")
        return
    try:
        unavailable = engines.get(name).unavailable()
    except ComponentError as error:
        unavailable = str(error)
    if unavailable:
        problems.add(("solver", "engine"), unavailable)


def _build(owner: type[Any], section: dict[str, Any], problems: Problems) -> Any:
    options = {key: section[key] for key in option_names(owner) if key in section}
    return options_into(owner, options, ("solver",), problems)
