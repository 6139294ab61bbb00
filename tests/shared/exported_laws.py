"""Exported laws, and the compilers that translate them."""

import functools
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from eqt_cli.base import yaml_source
from eqt_cli.components.laws import Designed, controllers
from eqt_cli.config.document import Document, Place
from eqt_cli.config.preflight import build
from eqt_cli.extend import Problems, group_named
from eqt_cli.extensions.export.export import files
from eqt_cli.extensions.export.export_laws import exported
from eqt_cli.extensions.export.program_error import ARITHMETICS

FLAGS = "-std=c99 -pedantic -Wall -Wextra -Werror -ffp-contract=off -fno-math-errno".split()
GROUPS = ("SO3", "SE3", "SE2")

KP = {"SO3": [1.0, 1.2, 0.8], "SE3": [1.0, 1.2, 0.8, 0.5], "SE2": [1.0, 1.2, 0.5]}
INERTIA = {"SO3": [1.0, 2.0, 2.5], "SE3": [1.0, 2.0, 2.5, 3.0, 3.0, 3.0], "SE2": [1.0, 2.0, 2.0]}


def made(group, laws, **more):
    """A small experiment with sampled laws, that no compiler is needed for."""
    m = len(INERTIA[group])
    task = {} if "stabilise" not in controllers.get(laws[0]).tasks else {"task": "stabilise"}
    reference = {"kind": "rates", "rates": ["0.3*cos(t)"] * m}
    config = {
        "name": "flight",
        "group": group,
        "inertia": INERTIA[group],
        "gains": {"kp": KP[group], "kd": 0.7},
        **({"target": {"pose": "identity"}} if task else {"reference": reference}),
        **task,
        "controllers": list(laws),
        "initial": {"pose": {"kind": "exp_normal", "std": 0.6}, "velocity": "normal"},
        "ensemble": {"runs": 2, "seed": 3},
        "time": {"duration": 0.6, "samples": 4},
        "control": {"period": 0.1},
        "solver": {"engine": "solve_ivp", "cross_check": 0},
        **more,
    }
    text = yaml_source.dump(config)
    source = yaml_source.load(text, "flight.yaml")
    return build(Document(source, source.data, Place(Path.cwd())))


@functools.cache
def law_of(group, law, real="double", **more):
    """One exported law."""
    [law] = exported(made(group, [law], **more), [], ARITHMETICS[real])
    return law


def fits(law, group):
    """Whether a law is for a group."""
    problems = Problems(str)
    controllers.get(law)().check(group_named(group), problems)
    return not problems


# Not those in C, nor those whose gains change at knots along this reference, as of lqr.
LAWS = [
    name
    for name in controllers.names()
    if controllers.get(name).tasks and not issubclass(controllers.get(name), Designed)
]
FEW = [("lee2010", "SE3"), ("logarithmic", "SE2"), ("goodarzi2013", "SO3"), ("sliding", "SE2")]
# A law is written once for all groups, so that more pairs tell no more.
ALL = [
    *((law, "SE3" if fits(law, "SE3") else "SO3") for law in LAWS),
    *(("eqt", group) for group in GROUPS if group != "SE3"),
    *(pair for pair in FEW if pair[1] != "SE3"),
]
"""Every law on SE(3) where it is for that, eqt and a few laws on the other groups."""
IN_TURN = [(*pair, ("float", "double")[k % 2]) for k, pair in enumerate(ALL)]
"""The same, each in one of the two types."""


def compilers():
    """Those of this machine, or else that of the package ziglang."""
    found = [[name] for name in ("gcc", "clang") if shutil.which(name)]
    return found or [zig()] * bool(find_spec("ziglang"))


def zig(*target):
    """The compiler of the package ziglang; a test is skipped without it."""
    if not find_spec("ziglang"):
        pytest.skip("ziglang is not installed")
    return [sys.executable, "-m", "ziglang", "cc", *target]


def written(law, folder):
    """The files of a law in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files(law).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def checked(law, folder, command, *start):
    """What the check of a law in a folder says, by a compiler, and its exit status."""
    program = folder / "check"
    sources = [str(folder / f"{law.name}{end}.c") for end in ("_check", "")]
    subprocess.run([*command, *FLAGS, *sources, "-o", str(program)], check=True)
    done = subprocess.run([*start, str(program)], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout


def library(law, folder, command):
    """A law as a shared library."""
    made = folder / "law.so"
    flags = [*FLAGS, "-O2", "-fPIC", "-shared"]
    source = str(folder / f"{law.name}.c")
    subprocess.run([*command, *flags, source, "-o", str(made)], check=True)
    return made
