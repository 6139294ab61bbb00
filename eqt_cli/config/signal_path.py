"""Describes the parts of a loop, as a signal path and as a sentence."""

from collections.abc import Mapping
from typing import Any


def signal_path(config: Mapping[str, Any]) -> str:
    """Return the signal path of a resolved configuration; "" for the ideal loop.

    ``reference → law → hold 0.1 s → limit → plant (drag) → velocity (noise every 0.2 s) → law``;
    an estimate, where there is one, stands between sensors and law.
    """
    plant, control = config.get("plant") or {}, config.get("control")
    sensors = config.get("sensors") or {}
    stages = ["law"]
    if control:
        delay = f", delay {control['delay']}" if control.get("delay") else ""
        stages.append(f"hold {control['period']:g} s{delay}")
    stages += _kinds(config.get("actuators"))
    inertia = ["true inertia"] if plant.get("inertia") is not None else []
    inside = ", ".join([*inertia, *_kinds(plant.get("forces"))])
    stages.append(f"plant ({inside})" if inside else "plant")
    measured = [f"{name} ({_measured(sensors[name])})" for name in sensors if sensors[name]]
    if len(stages) == 2 and not inside and not measured:
        return ""
    inputs = [", ".join(measured)] if measured else []
    inputs += [f"estimate ({kind})" for kind in _kinds([config.get("estimator")])]
    return " → ".join(["reference", *stages, *inputs, "law"])


def loop_in_words(config: Mapping[str, Any]) -> str:
    """Describe how a loop departs from the paper's; "" for the ideal loop.

    ``Loop: sampled every 0.1 s; actuators: lag; measured pose: noise.``
    """
    plant, control = config.get("plant") or {}, config.get("control")
    sensors = config.get("sensors") or {}
    departures = []
    if control:
        late = "".join(f", {words}" for words in _late(control.get("delay")))
        departures.append(f"sampled every {control['period']:g} s{late}")
    if kinds := _kinds(config.get("actuators")):
        departures.append(f"actuators: {', '.join(kinds)}")
    if plant.get("inertia") is not None:
        departures.append("inertia error")
    if kinds := _kinds(plant.get("forces")):
        departures.append(f"forces: {', '.join(kinds)}")
    departures += [
        f"measured {name} ({_measured(entries)})" for name, entries in sensors.items() if entries
    ]
    departures += [f"estimate: {kind}" for kind in _kinds([config.get("estimator")])]
    return f"Loop: {'; '.join(departures)}." if departures else ""


def _measured(entries: Any) -> str:
    """Describe sensors part by part, with the times of their measurements.

    ``translation: noise, bias every 1 s, 1 period late, 10 % lost; rotation: noise``
    """
    parts: dict[str, list[Any]] = {}
    for entry in entries:
        parts.setdefault("" if isinstance(entry, str) else entry.get("of") or "", []).append(entry)
    descriptions = []
    for part, sensors in parts.items():
        options: dict[str, Any] = {}
        for entry in sensors:
            options |= {} if isinstance(entry, str) else entry
        lost = options.get("dropout") or 0
        when = [f"every {options['period']:g} s"] if options.get("period") else []
        when += _late(options.get("delay"))
        when += [f"{100 * lost:g} % lost"] if lost else []
        text = " ".join(filter(None, [", ".join(_kinds(sensors)), ", ".join(when)]))
        descriptions.append(f"{part}: " * bool(part) + text)
    return "; ".join(descriptions)


def _late(delay: int | str | None) -> list[str]:
    """Describe a delay of whole periods, or of a time; nothing without one."""
    if not delay:
        return []
    time = delay if isinstance(delay, str) else f"{delay} period{'s' * (delay > 1)}"
    return [f"{time} late"]


def _kinds(entries: Any) -> list[str]:
    given = (entry for entry in entries or () if entry is not None)
    return [entry if isinstance(entry, str) else str(entry["kind"]) for entry in given]
