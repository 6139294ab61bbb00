"""Describes the loop of a configuration: as a signal path, as a sentence, and for a result."""

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import count_of
from eqt_cli.base.store_reader import ResultFile
from eqt_cli.base.stored import POINT
from eqt_cli.base.yaml_source import dump
from eqt_cli.components.estimators import estimators
from eqt_cli.config.document import document_of
from eqt_cli.config.study import config_at


def description(config: Mapping[str, Any], departures: str) -> dict[str, Any]:
    """Return what readers of a result show of its experiment, as `results.origin.Experiment`.

    Parameters
    ----------
    config
        The resolved configuration.
    departures
        Departures of its vehicle from the theorems.
    """
    (path, words), rtol = loop_in_words(config), config["solver"].get("rtol")
    rows = [entry["thrusters"] for entry in config.get("actuators") or () if "thrusters" in entry]
    forces = [x for key in ("model", "plant") for x in (config.get(key) or {}).get("forces") or ()]
    ups = [force.get("up") for force in forces if force["kind"] == "restoring"]
    # None is along the last axis.
    directions = [up for up in ups if isinstance(up, list) and {*map(type, up)} <= {int, float}]
    window = config.get("measure") or {}
    return {
        "window": (window.get("start") or 0.0, window.get("stop")),
        "down": any(up[-1] == -max(map(abs, up)) < 0 for up in directions),
        "kinds": {entry["label"]: entry["kind"] for entry in config.get("controllers") or ()},
        "inner": _inner(config),
        "rtol": rtol if isinstance(rtol, float) else None,
        "seed": config["ensemble"]["seed"],
        "signal_path": path,
        "loop": words,
        "departures": (departures or words) if words else "",
        "thrusters": [
            [[*map(_mean, thruster[key]), 0.0][:3] for key in ("at", "along")]
            for thruster in next(filter(None, rows), ())
        ],
    }


def _inner(config: Mapping[str, Any]) -> dict[str, str]:
    """Return the kinds of the blocks that laws have for themselves, by label."""
    laws = config.get("controllers") or ()
    blocks = {law["label"]: _kinds(law.get("inner")) for law in laws}
    return {label: ", ".join(kinds) for label, kinds in blocks.items() if kinds}


def _mean(number: Any) -> float:
    """Return a number, or the mean of the distribution that stands in its place."""
    if not isinstance(number, dict):
        return float(number)
    return float(sum(number["uniform"]) / 2 if "uniform" in number else number["normal"][0])


def attributes_at(results: ResultFile, point: int) -> dict[str, str]:
    """Return the attributes of one point of a result file that has only those of its sweep."""
    number = int(results[POINT][point]) if POINT in results.coordinates else point
    document = config_at(document_of(results), number)
    experiment = json.loads(str(results.attributes["experiment"]))
    # Values in other units, or an estimator that is not at hand.
    with suppress(KeyError, TypeError, AttributeError, ValueError, EqtError):
        experiment |= description(document.data, experiment["departures"])
    config = document.source.comment + dump(document.data)
    return {"config": config, "experiment": json.dumps(experiment, ensure_ascii=False)}


def loop_in_words(config: Mapping[str, Any]) -> tuple[str, str]:
    """Describe how a loop departs from the paper's, as a path and as a sentence; else "" each.

    ``reference → law → hold 0.1 s → limit → plant (drag) → velocity (noise every 0.2 s) → law``,
    where an estimate stands between sensors and law; and
    ``Loop: sampled every 0.1 s; actuators: limit; forces: drag; measured velocity (…).``
    """
    stages, departures = ["reference", "law"], list[str]()
    if control := config.get("control"):
        stages.append(f"hold {control['period']:g} s")
        departures.append(f"sampled every {control['period']:g} s")
        if delay := control.get("delay"):
            stages[-1] += f", delay {delay}"
            departures[-1] += f", {_late(delay)}"
    if inner := "; ".join(f"{label}: {kinds}" for label, kinds in _inner(config).items()):
        stages.append(f"inner blocks by law ({inner})")
        departures.append(stages[-1])
    if actuators := _kinds(config.get("actuators")):
        stages += actuators
        departures.append(f"actuators: {', '.join(actuators)}")
    plant = config.get("plant") or {}
    inside = forces = _kinds(plant.get("forces"))
    if plant.get("inertia") is not None:
        inside = ["true inertia", *forces]
        departures.append("inertia error")
    if forces:
        departures.append(f"forces: {', '.join(forces)}")
    stages.append(f"plant ({', '.join(inside)})" if inside else "plant")
    sensors = (config.get("sensors") or {}).items()
    measured = {name: f"{name} ({_measured(entries)})" for name, entries in sensors if entries}
    departures += [f"measured {words}" for words in measured.values()]
    filters = _kinds([config.get("estimator")])  # one or none
    inertial = any(getattr(estimators.get(x), "reads_specific_force", False) for x in filters)
    # What the law reads, and the estimator does not, stands beside the estimate.
    fields = ("magnetometer",) if inertial else ("magnetometer", "accelerometer")
    beside = [measured.pop(x) for x in fields if filters and x in measured]
    if measured:
        stages.append(", ".join(measured.values()))
    for kind in filters:
        stages.append(", ".join([f"estimate ({kind})", *beside]))
        departures.append(f"estimate: {kind}")
    if not departures:
        return "", ""
    return " → ".join([*stages, "law"]), f"Loop: {'; '.join(departures)}."


def _measured(entries: Any) -> str:
    """Describe sensors part by part, with the times of their measurements.

    ``translation: noise, bias every 1 s, 1 period late, 10 % lost; rotation: noise``
    """
    parts: dict[str, list[Any]] = {}
    for entry in entries:
        parts.setdefault("" if isinstance(entry, str) else entry.get("of") or "", []).append(entry)
    descriptions = []
    for part, sensors in parts.items():
        options = {k: x for one in sensors if not isinstance(one, str) for k, x in one.items()}
        when = []
        if period := options.get("period"):
            when.append(f"every {period:g} s")
        if delay := options.get("delay"):
            when.append(_late(delay))
        if lost := options.get("dropout"):
            when.append(f"{100 * lost:g} % lost")
        text = " ".join(filter(None, [", ".join(_kinds(sensors)), ", ".join(when)]))
        descriptions.append(f"{part}: {text}" if part else text)
    return "; ".join(descriptions)


def _late(delay: int | str) -> str:
    """Describe a delay of whole periods, or of a time."""
    return f"{delay if isinstance(delay, str) else count_of(delay, 'period')} late"


def _kinds(entries: Any) -> list[str]:
    present = (entry for entry in entries or () if entry is not None)
    return [entry if isinstance(entry, str) else str(entry["kind"]) for entry in present]
