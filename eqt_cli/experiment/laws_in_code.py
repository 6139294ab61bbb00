"""Reads, compiles and tries out laws in user code before any run."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.config.code_files import code_text
from eqt_cli.config.source import ConfigSource
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves
from eqt_cli.core.problems import Problems
from eqt_cli.engines import Engine
from eqt_cli.engines.native.own_code import OwnCode, compiled
from eqt_cli.engines.native.trial import try_out
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle import Vehicle

TRIED = 8
"""Number of random states at which a function is tried out, besides rest and half turns."""

PERIOD = 0.01
"""Control period for trying out a function, s."""


@dataclass
class LawsInCode:
    """Compiles laws in code, and keeps their source texts.

    Attributes
    ----------
    source
        The configuration that names the files.
    trusted
        Whether code that is stored in a result may be executed.
    texts
        Source texts that were read, by their names in the configuration.
    """

    source: ConfigSource
    trusted: bool
    texts: dict[str, str] = field(default_factory=dict)

    def running(self, law: Controller, G: MatrixLieGroup, problems: Problems) -> Controller | None:
        """Return the law with compiled code, or a law without code itself; None after a problem."""
        needed = law.code
        if needed is None:
            return law
        if problems:
            return None
        with problems.catching("file"):
            text = code_text(self.source, needed.file, self.trusted)
        if problems:
            return None
        self.texts[needed.file] = text
        with problems.catching():
            own = OwnCode(text=text, entries=G.size**2, axes=G.dimension, **asdict(needed))
            function = compiled(own)
            if own not in _tried:
                try_out(function, leaves(law).get("values", np.empty(0)), PERIOD, first_inputs(G))
                _tried.add(own)
            return law.running(function, G)
        return None


_tried: set[OwnCode] = set()
"""Code that was already tried out successfully, whatever its numbers."""


def with_code(source: ConfigSource, file: Path, claimed: str | None) -> ConfigSource:
    """Return the configuration with a C file as its only controller.

    An existing entry of `controllers` for this file keeps its numbers.

    Parameters
    ----------
    claimed
        The law that the code claims to be; None to keep the statement of the entry, if any.
    """
    name = os.path.relpath(file, source.folder)
    entries = source.data.get("controllers")
    known = [
        entry
        for entry in (entries if isinstance(entries, list) else ())
        if isinstance(entry, dict) and os.path.normpath(str(entry.get("file"))) == name
    ]
    code = next(kind.name for kind in controllers.all() if kind.code is not Controller.code)
    entry = {**(known[0] if known else {"kind": code, "file": name, "label": file.stem})}
    if claimed is not None:
        entry["as"] = claimed
    given = source.overrides | {("controllers",): "--code"}
    return replace(source, data=source.data | {"controllers": [entry]}, overrides=given)


def first_inputs(G: MatrixLieGroup) -> Array:
    """Return inputs at random states, at rest without error, and at half turns about every axis."""
    random, m = np.random.default_rng(0), G.dimension
    poses = G.exp(random.standard_normal((2, TRIED, m)))
    rates = random.standard_normal((3, TRIED, m))
    rest, zero = G.exp(np.zeros((1, m))), np.zeros((1, m))
    turned = G.exp(np.pi * np.eye(m))
    still, none = np.broadcast_to(rest, turned.shape), np.zeros((m, m))
    return np.concatenate(
        [
            input_rows(0.5, poses[0], rates[0], poses[1], rates[1], rates[2]),
            input_rows(0.0, rest, zero, rest, zero, zero),
            input_rows(0.0, turned, none, still, none, none),
        ]
    )


def input_rows(t: Any, Q: Array, V: Array, Qd: Array, Vd: Array, Vd_dot: Array) -> Array:
    """Return the inputs of a function in code, one row per state."""
    runs = len(V)
    times = np.broadcast_to(np.asarray(t, dtype=float), (runs,))[:, None]
    flat = (Q.reshape(runs, -1), V, Qd.reshape(runs, -1), Vd, Vd_dot)
    return np.concatenate([times, *flat], axis=1)


def check_calls(law: Controller, vehicle: Vehicle, engine: Engine, problems: Problems) -> None:
    """Note code that the engine cannot call, or that needs a control period."""
    if law.code is None or vehicle.control is not None:
        return
    if law.code.memory:
        problems.at("memory").add(
            "goes on by a period at every call; set control.period, at which the code is called"
        )
    elif not engine.calls_laws:
        problems.add(
            f"engine {engine.name} compiles the law into the loop, and code is called; set "
            "control.period, at which it is called, or use engine solve_ivp"
        )
