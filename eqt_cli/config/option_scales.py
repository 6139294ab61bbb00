"""The scale of a configuration's key on an axis, from the annotation of its option."""

from typing import Any, get_type_hints

from eqt_cli.config.schema import Config, OwnGainsSection
from eqt_cli.controllers import controllers
from eqt_cli.core.component import option_of_field
from eqt_cli.core.option_types import Scale
from eqt_cli.core.problems import parse_key
from eqt_cli.core.registry import Registry
from eqt_cli.core.validation import owners
from eqt_cli.engines import engines
from eqt_cli.ensemble.poses import pose_distributions
from eqt_cli.ensemble.velocities import velocity_distributions
from eqt_cli.references import references
from eqt_cli.vehicle.actuators import actuators
from eqt_cli.vehicle.estimators import estimators
from eqt_cli.vehicle.forces import forces
from eqt_cli.vehicle.sensors import sensors

COMPONENTS: dict[str, Registry[Any]] = {
    "controllers": controllers,
    "plant.forces": forces,
    "actuators": actuators,
    "sensors.pose": sensors,
    "sensors.velocity": sensors,
    "estimator": estimators,
    "reference": references,
    "initial.pose": pose_distributions,
    "initial.velocity": velocity_distributions,
    "solver": engines,
}
"""The registry of each place where a configuration names components, or lists of them."""


def scale_of(config: Any, key: str) -> Scale | None:
    """Return the scale of a key in a configuration with every default; None where it has none.

    An option of a plugin that is not loaded has none.
    """
    *steps, option = parse_key(key)
    kind: Any = Config
    place = ""
    for step in steps:
        config = _within(config, step)
        if isinstance(step, str):
            place = f"{place}.{step}".lstrip(".")
            kind = OwnGainsSection if step == "gains" else _hints(kind).get(step)
        if (registry := COMPONENTS.get(place)) and isinstance(config, dict):
            named = config.get("engine" if place == "solver" else "kind")
            kind = next((each for each in registry.all() if each.name == named), None)
    metadata = getattr(_hints(kind).get(option), "__metadata__", ())
    return next((each for each in metadata if isinstance(each, Scale)), None)


def _within(config: Any, step: str | int) -> Any:
    try:
        return config[step]
    except (KeyError, IndexError, TypeError):
        return None


def _hints(kind: Any) -> dict[Any, Any]:
    """Return the types of the options of all classes in a type, by name."""
    return {
        option_of_field(name): hint
        for owner in owners(kind)
        for name, hint in get_type_hints(owner, include_extras=True).items()
    }
