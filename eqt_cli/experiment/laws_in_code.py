"""Reads, compiles and tries out laws in user code before any run."""

import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from eqt_cli.config.named_files import code_text
from eqt_cli.config.source import ConfigSource
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import leaves
from eqt_cli.engines import Engine
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import rigid_motions
from eqt_cli.mechanics.flatness import ORDER
from eqt_cli.mechanics.law_input import LawInput
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
        # With all of native, which other laws do without.
        from eqt_cli.engines.native.own_code import OwnCode, compiled, try_out

        self.texts[needed.file] = text
        with problems.catching():
            space = G.space if rigid_motions(G) else 0
            own = OwnCode(
                text=text, entries=G.size**2, axes=G.dimension, space=space, **asdict(needed)
            )
            function = compiled(own)
            if own not in _tried:
                numbers = leaves(law).get("values", np.empty(0))
                try_out(function, numbers, PERIOD, first_inputs(G).rows(own.inputs))
                _tried.add(own)
            return law.running(function, G)
        return None


_tried: set[object] = set()
"""Code that was already tried out successfully, whatever its numbers."""


def with_code(source: ConfigSource, file: Path, claimed: str | None) -> ConfigSource:
    """Return the configuration with a C file as its only controller.

    An existing entry of `controllers` for this file keeps its numbers.

    Parameters
    ----------
    claimed
        The law that the code claims to be: a kind, or the label of an entry, with its options and
        gains; None to keep the statement of the entry, if any.
    """
    name = os.path.relpath(file, source.folder)
    listed = source.data.get("controllers")
    entries = [e for e in listed if isinstance(e, dict)] if isinstance(listed, list) else []
    known = [e for e in entries if os.path.normpath(str(e.get("file"))) == name]
    code = next(kind.name for kind in controllers.all() if kind.code is not Controller.code)
    entry = {**(known[0] if known else {"kind": code, "file": name, "label": file.stem})}
    if claimed is not None:
        meant = next((e for e in entries if claimed in (e.get("label"), e.get("kind"))), {})
        own = {key: value for key, value in meant.items() if key not in ("label", "gains")}
        entry |= {"as": own or claimed} | {k: v for k, v in meant.items() if k == "gains"}
    given = source.overrides | {("controllers",): "--code"}
    return replace(source, data=source.data | {"controllers": [entry]}, overrides=given)


def first_inputs(G: MatrixLieGroup) -> LawInput:
    """Return inputs at random states, at rest without error, and at half turns about every axis."""
    random, m = np.random.default_rng(0), G.dimension
    n = G.space if rigid_motions(G) else 0

    def drawn(*shape: int) -> Array:
        rows = np.zeros((TRIED + 1 + m, *shape))
        rows[:TRIED] = random.standard_normal((TRIED, *shape))
        return rows

    x, xd, V, Vd, Vd_dot, psi = map(drawn, (m, m, m, m, m, 3))
    x[TRIED + 1 :] = np.pi * np.eye(m)
    t = np.repeat([0.5, 0.0], [TRIED, 1 + m])
    return LawInput(t, G.exp(x), V, G.exp(xd), Vd, Vd_dot, drawn(ORDER + 1, n), psi)


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
