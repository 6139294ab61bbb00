"""The law that a policy becomes: what it observes and commands, and its file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError, KeyPath
from eqt_cli.base.files import refusals, replace_file, text_of
from eqt_cli.config.document import Document, with_value
from eqt_cli.config.study import study
from eqt_cli.extensions.network.network import observable_on

KIND, LABEL = "network", "policy"
"""The kind of the law, and its label where nothing names it."""

ERRORS = "position_error", "rotation_error", "velocity_error", "rates_error"
"""What a policy observes where nothing says it, as far as the group has it."""

TIMES_KP = 4.0
"""The largest command as a multiple of kp, where nothing limits the torque."""

Written = str | os.PathLike[str] | Mapping[str, Any]


def with_law(document: Document, place: KeyPath, law: Written | None) -> Document:
    """Return a configuration with a network in the place of a law."""
    written = usual(document) if law is None else _read(law)
    entry = {"kind": KIND, "label": LABEL, **written}
    return replace(document, data=with_value(document.data, place, entry))


def _read(law: Written) -> dict[str, Any]:
    if isinstance(law, Mapping):
        return dict(law)
    if not isinstance(law, str | os.PathLike):
        raise EqtError(
            "law: expected the YAML file of a network, or a mapping, {observes: […], commands: "
            f"{{…}}}}, got {law!r}"
        )
    text = text_of(Path(law), "it says what a network observes and commands")
    return dict(yaml_source.load(text.encode(), str(law)).data)


def usual(document: Document) -> dict[str, Any]:
    """Return a law that observes errors and commands a wrench within the limits of a task."""
    data, group = document.data, study(document).base.group
    observes: list[Any] = [name for name in ERRORS if name in observable_on(group)]
    if delay := (data.get("control") or {}).get("delay"):
        observes.append({"signal": "last_command", "steps": delay})
    limits = [part["limit"] for part in data.get("actuators") or () if part["kind"] == "limit"]
    usual_limit = float(TIMES_KP * np.max((data.get("gains") or {}).get("kp", 1.0)))
    scale = limits[0] if limits else usual_limit
    return {"observes": observes, "commands": {"as": "wrench", "scale": scale}}


def write(path: Path, file: str, entry: Mapping[str, Any]) -> None:
    """Write a law as `eqt suite` takes it: its file, what it observes and commands."""
    law = {"file": file} | {k: x for k, x in entry.items() if k not in ("kind", "label", "file")}
    with refusals(path, "written"):
        replace_file(path, yaml_source.dump(law).encode())
