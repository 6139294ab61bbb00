"""Plugins whose laws have options of any type, and commands with options of any value, by seed."""

from __future__ import annotations

import random
from pathlib import Path

_ATOMS = """float int str bool Real Positive Count Array np.ndarray Path Decimal Mode date Fraction
complex bytes Any object None Missing Inner Pair Keyed range slice type Callable[[float],float]
Literal['a',2] Matrix Numbers""".split()
_WRAPPED = (
    "{} | None",
    "list[{}]",
    "dict[str, {}]",
    "dict[{}, float]",
    "tuple[{}, ...]",
    "tuple[{}, float]",
    "set[{}]",
    "Annotated[{}, Unit('s')]",
    "Annotated[{}, Scale('width', 's')]",
    "{} | str",
    "Optional[{}]",
    "Sequence[{}]",
    "Final[{}]",
)
_DEFAULTS = """0.5 1 'a' True None np.eye(3) Path('a') Decimal('0.1') Mode.ONE date(2020,1,1)
Fraction(1,3) 1j b'x' [1.0,2.0] (1.0,) float('nan') Inner() Pair(1.0,2.0) range(3) float
field(default_factory=list) field(default_factory=dict) field(default=0.5,metadata={'a':1})
10**30""".split()
_VALUES = """0.5 1 a true null [1,2] [[1,0,0],[0,1,0],[0,0,1]] {a:1} 0.1 2020-01-01 1/3 -pi/2 .nan
.inf "" [] {} [null] 1e400""".split()

_PLUGIN = '''{future}from dataclasses import dataclass, field
from collections.abc import Callable, Sequence
from datetime import date
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Optional, TypedDict

import numpy as np

from eqt_cli.extend import *


class Mode(Enum):
    ONE = 1
    TWO = "two"


@dataclass(frozen=True)
class Inner:
    x: float = 1.0


class Pair(NamedTuple):
    x: float
    y: float


class Keyed(TypedDict):
    x: float


@dataclass(frozen=True)
class Strange(EqT):
    """EqT with options."""

    name: ClassVar[str] = "strange"
    title: ClassVar[str] = "strange"
{fields}
'''

_CONFIG = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {{kp: 1, kd: 1}}
reference: {{torque: [0, 0, 0]}}
controllers: [eqt, {{kind: strange{values}}}]
ensemble: {{runs: 1, seed: 1}}
time: {{duration: 1, samples: 3}}
plugins: [strange.py]
{more}"""

COMMANDS = (["config", "check"], ["config", "check"], ["run", "--force", "--out", "out", "--quiet"])


def plugin(seed: int, folder: Path) -> list[str]:
    """Write a plugin and a configuration, and return a command."""
    random_ = random.Random(seed)

    def kind(depth: int = 2) -> str:
        if depth == 0 or random_.random() < 0.4:
            return random_.choice(_ATOMS)
        return random_.choice(_WRAPPED).format(kind(depth - 1))

    fields, values = "", ""
    for name in ("one", "two")[: random_.choice((1, 1, 2))]:
        default = f" = {random_.choice(_DEFAULTS)}" if random_.random() < 0.6 else ""
        fields += f"    {name}: {kind()}{default}\n"
        if random_.random() < 0.7:
            values += f", {name}: {random_.choice(_VALUES)}"
    future = random_.choice(("", "from __future__ import annotations\n"))
    more = random_.choice(("", "sweep: {'controllers[1].one': [1, 2]}\n"))
    (folder / "strange.py").write_text(_PLUGIN.format(future=future, fields=fields), "utf-8")
    path = folder / "case.yaml"
    path.write_text(_CONFIG.format(values=values, more=more), "utf-8")
    return [*random_.choice(COMMANDS), str(path)]
