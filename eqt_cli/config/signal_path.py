"""What a loop contains, as a path and as a sentence; it computes nothing and builds nothing."""

from collections.abc import Mapping
from typing import Any


def signal_path(config: Mapping[str, Any]) -> str:
    """The stages between reference and law of a resolved configuration; "" for the ideal loop.

    ``reference → law → hold 0.1 s → limit → plant (drag) → velocity (noise every 0.2 s) → law``
    """
    plant, control = config.get("plant") or {}, config.get("control")
    sensors = config.get("sensors") or {}
    stages = ["law"]
    if control:
        delay = f", delay {control['delay']}" if control.get("delay") else ""
        stages.append(f"hold {control['period']:g} s{delay}")
    stages += _kinds(config.get("actuators"))
    own = ["true inertia"] if plant.get("inertia") is not None else []
    inside = ", ".join([*own, *_kinds(plant.get("forces"))])
    stages.append(f"plant ({inside})" if inside else "plant")
    told = [f"{name} ({_measured(sensors[name])})" for name in sensors if sensors[name]]
    if len(stages) == 2 and not inside and not told:
        return ""
    return " → ".join(["reference", *stages, *([", ".join(told)] if told else []), "law"])


def loop_in_words(config: Mapping[str, Any]) -> str:
    """What a loop has that the paper's has not; "" for the ideal loop.

    ``Loop: sampled every 0.1 s; actuators: lag; measured pose: noise.``
    """
    plant, control = config.get("plant") or {}, config.get("control")
    sensors = config.get("sensors") or {}
    found = []
    if control:
        delay = control.get("delay", 0)
        late = f", {delay} period{'s' * (delay > 1)} late" if delay else ""
        found.append(f"sampled every {control['period']:g} s{late}")
    if kinds := _kinds(config.get("actuators")):
        found.append(f"actuators: {', '.join(kinds)}")
    if plant.get("inertia") is not None:
        found.append("inertia error")
    if kinds := _kinds(plant.get("forces")):
        found.append(f"forces: {', '.join(kinds)}")
    found += [
        f"measured {name} ({_measured(entries)})" for name, entries in sensors.items() if entries
    ]
    return f"Loop: {'; '.join(found)}." if found else ""


def _measured(entries: Any) -> str:
    """Sensors part by part, with when they measure.

    ``translation: noise, bias every 1 s, 1 period late, 10 % lost; rotation: noise``
    """
    parts: dict[str, list[Any]] = {}
    for entry in entries:
        parts.setdefault("" if isinstance(entry, str) else entry.get("of") or "", []).append(entry)
    found = []
    for part, own in parts.items():
        said: dict[str, Any] = {}
        for entry in own:
            said |= {} if isinstance(entry, str) else entry
        late, lost = said.get("delay") or 0, said.get("dropout") or 0
        when = [f"every {said['period']:g} s"] if said.get("period") else []
        when += [f"{late} period{'s' * (late > 1)} late"] if late else []
        when += [f"{100 * lost:g} % lost"] if lost else []
        kinds = ", ".join(_kinds(own))
        found.append(f"{part}: " * bool(part) + " ".join(filter(None, [kinds, ", ".join(when)])))
    return "; ".join(found)


def _kinds(entries: Any) -> list[str]:
    return [entry if isinstance(entry, str) else str(entry["kind"]) for entry in entries or ()]
