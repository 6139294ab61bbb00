"""Describes the parts of a loop, as a signal path and as a sentence."""

from collections.abc import Mapping
from typing import Any


def signal_path(config: Mapping[str, Any]) -> str:
    """Return the signal path of a resolved configuration; "" for the ideal loop.

    ``reference → law → hold 0.1 s → limit → plant (drag) → velocity (noise every 0.2 s) → law``;
    an estimate, where there is one, stands between sensors and law.
    """
    control, actuators, inertia, forces, measured, estimators = _parts(config)
    stages = ["law"]
    if control:
        delay = f", delay {control['delay']}" if control.get("delay") else ""
        stages.append(f"hold {control['period']:g} s{delay}")
    inside = ", ".join([*["true inertia"] * inertia, *forces])
    stages += [*actuators, f"plant ({inside})" if inside else "plant"]
    if stages == ["law", "plant"] and not measured:
        return ""
    inputs = [", ".join(measured)] if measured else []
    inputs += [f"estimate ({kind})" for kind in estimators]
    return " → ".join(["reference", *stages, *inputs, "law"])


def loop_in_words(config: Mapping[str, Any]) -> str:
    """Describe how a loop departs from the paper's; "" for the ideal loop.

    ``Loop: sampled every 0.1 s; actuators: lag; measured pose: noise.``
    """
    control, actuators, inertia, forces, measured, estimators = _parts(config)
    departures = []
    if control:
        late = "".join(f", {words}" for words in _late(control.get("delay")))
        departures.append(f"sampled every {control['period']:g} s{late}")
    departures += [f"actuators: {', '.join(actuators)}"] * bool(actuators)
    departures += ["inertia error"] * inertia
    departures += [f"forces: {', '.join(forces)}"] * bool(forces)
    departures += [f"measured {words}" for words in measured]
    departures += [f"estimate: {kind}" for kind in estimators]
    return f"Loop: {'; '.join(departures)}." if departures else ""


def _parts(
    config: Mapping[str, Any],
) -> tuple[Any, list[str], bool, list[str], list[str], list[str]]:
    """Return clock, actuators, whether the inertia differs, forces, measurements and estimators."""
    plant, sensors = config.get("plant") or {}, config.get("sensors") or {}
    return (
        config.get("control"),
        _kinds(config.get("actuators")),
        plant.get("inertia") is not None,
        _kinds(plant.get("forces")),
        [f"{name} ({_measured(sensors[name])})" for name in sensors if sensors[name]],
        _kinds([config.get("estimator")]),
    )


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
