"""Settings and samples that every test shares."""

from __future__ import annotations

import ctypes
import gc
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache, partial
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import plugin_sources
import pytest
import tiers
import typer.main
from hypothesis import settings
from hypothesis import strategies as st
from made_up import Table, write
from measuring import Measuring
from small_experiment import FEW_RUNS, configuration

from eqt_cli.base.errors import EqtWarning, Problems
from eqt_cli.base.extensions import shipped
from eqt_cli.base.process import STOP_SIGNALS
from eqt_cli.base.reporting import Reporter, reporting
from eqt_cli.base.store_writer import Variable
from eqt_cli.cli import main
from eqt_cli.cli import output as progress
from eqt_cli.components.groups import MatrixLieGroup, group_named, groups
from eqt_cli.components.laws import Controller, controllers
from eqt_cli.config.document import read_config
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.study import study
from eqt_cli.engines import compiler as native_cache
from eqt_cli.engines import compiler as native_compiler
from eqt_cli.extend import Array, transpose
from eqt_cli.numbers.c_code import FUNCTIONS_HEADER, LANES_HEADER, c_function
from eqt_cli.numbers.program import NUMBERS, Program
from eqt_cli.results.result import open_result
from eqt_cli.runs import executors
from eqt_cli.runs.batches import batches
from eqt_cli.runs.run_study import Execution, execute

pytest_plugins = ["pytester"]

# Tables obey it, and workers of the tests have one of their own.
os.environ.pop("COLUMNS", None)

# What the tests compute is seldom worth compiling: solve_ivp solves a few runs in less time. Tests
# of the choice that eqt makes (config/test_engine_choice.py), and those that carry out the
# documentation, take this variable away.
os.environ["EQT_ENGINE"] = "solve_ivp"

# A deadline would time the machine, which runs tests side by side, and not the code. Samples are
# the same in every run, so that a change is judged by what it changes, and 15 of them are enough;
# the nightly run draws new ones, and more.
RANDOM = os.environ.get("EQT_SAMPLES") == "random"
settings.register_profile(
    "eqt", deadline=None, derandomize=not RANDOM, max_examples=100 if RANDOM else 15
)
settings.load_profile("eqt")


def pytest_configure(config: pytest.Config) -> None:
    if folder := os.environ.get("EQT_MEASURE"):
        config.pluginmanager.register(Measuring(Path(folder).absolute()))
    config.pluginmanager.register(tiers.Costs(strict="EQT_CI" in os.environ))


def pytest_report_header() -> str:
    share = os.environ.get("EQT_SHARE", "")
    return share and f"a share of cases, which `make test-all SHARE={share}` repeats"


EXTENSIONS = {extension.name for extension in shipped()}
"""None where `make test-core` tries the core alone."""

NEEDED = {
    "merging": {
        "reviewers_se3",
        "satellite_breaks",
        "satellite_estimated",
        "se3_bluerov2_navigation",
        "sweep_lqr",
    },
    "designed_laws": {"sweep_lqr", "quadrotor_speeds"},
    "navigation": {"quadrotor_gnss", "se3_bluerov2_navigation"},
    "search": {
        *"pointing satellite_breaks satellite_estimated se3_bluerov2_estimated".split(),
        *"tune_flies tune_paper tune_proved tune_so2".split(),
    },
    "spacecraft": {"cubesat", "cubesat_orbit", "cubesat_sun"},
    "thrusters": {
        *"crazyflie planar_vtol quadrotor_gnss quadrotor_recovery quadrotor_speeds".split(),
        *"se3_bluerov2_navigation se3_bluerov2_thrusters".split(),
    },
    "underactuated": {
        *"crazyflie planar_vtol quadrotor_gnss quadrotor_lee quadrotor_lee_upside_down".split(),
        *"quadrotor_recovery quadrotor_speeds".split(),
    },
}
"""Shipped configurations with components, or keys, of an extension."""

ROOMS = Path(__file__).parent / "extensions"
"""A folder of tests an extension, which stays where the extension is taken away."""

OF_ALL_COMMANDS = ["test_api.py", "test_benchmarks.py", "test_docs.py", "trust/test_folders.py"]

collect_ignore = [] if EXTENSIONS else ["extensions", "figures/test_path.py", *OF_ALL_COMMANDS]


@pytest.hookimpl(tryfirst=True)  # before -m reads the marks
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        for extension, names in NEEDED.items():
            if getattr(item, "callspec", None) and item.callspec.params.get("name") in names:
                item.add_marker(pytest.mark.needs(extension))
        for mark in item.iter_markers("needs"):
            if unknown := [name for name in mark.args if not (ROOMS / name).is_dir()]:
                raise pytest.UsageError(
                    f"no extension is named {', '.join(unknown)}: {item.nodeid}"
                )
            lacking = sorted({*mark.args} - EXTENSIONS)
            if lacking or not EXTENSIONS:
                item.add_marker(pytest.mark.skip(reason=f"needs {', '.join(lacking) or 'all'}"))
    silent = [
        item.nodeid
        for item in items
        for mark in item.iter_markers("ci")
        if len(mark.args) != 1 or not str(mark.args[0]).strip() or mark.kwargs
    ]
    if silent:
        raise pytest.UsageError(
            'expected a reason, @pytest.mark.ci("why it must be"), of ' + ", ".join(silent)
        )
    if os.environ.get("EQT_TIERS") != "off":
        tiers.mark(items)
    if share := os.environ.get("EQT_SHARE"):
        drawn = tiers.draw(items, share)
        config.hook.pytest_deselected(items=list({*items} - {*drawn}))
        items[:] = drawn


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """To look for garbage among ten thousand tests takes a fifth of the time to collect them."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(50_000, 20, 20)
        gc.enable()


# typer builds the tree of commands anew for every call, for 0.1 s; these tests make thousands.
typer.main.get_command = cache(typer.main.get_command)

# Under `nohup`, or behind `&` of a script, signals are ignored, and then by all that tests start.
for number in STOP_SIGNALS:
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.SIG_DFL)

# What is printed must not depend on how fast this machine is.
progress.SHOW_AFTER = threading.TIMEOUT_MAX

# No test needs its files after a power cut.
os.fsync = lambda file: None

# By the clock, a small experiment on a busy machine is worth processes of its own; here it is not.
executors.WORTH_STARTING = executors.WORTH_LEAVING_THREADS = math.inf

# The tests compile more laws than a user keeps, and what was forgotten is compiled in every run. So
# they have a cache of their own, from which no command of the user removes the oldest.
native_cache.MOST_FILES = 5000
if (
    native_cache.caches_of_user().name != "eqt-tests"
):  # as the workers of pytest-xdist have it already
    OWN_CACHE = native_cache.caches_of_user() / "eqt-tests"
    OWN_CACHE.mkdir(mode=0o700, parents=True, exist_ok=True)
    os.environ["XDG_CACHE_HOME"] = str(OWN_CACHE)

# No optimisation changes a bit (engines/test_native.py), and half of the time to compile is spent
# on it; most of these laws run a few steps. Zig checks what is not optimised, unless told not to.
native_compiler.QUICK = "-O0"
native_compiler.LIBRARY = (
    *("-O0" if flag == "-O2" else flag for flag in native_compiler.LIBRARY),
    "-fno-sanitize=undefined",
)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """A plugin that one test loads is unknown to the next."""
    plugin_sources.begin_as_a_stranger()


@pytest.fixture
def forget_plugins(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Once called, a plugin that this test has loaded is unknown to it, too."""
    return partial(plugin_sources.forget_plugins, monkeypatch)


# Near 0, around the switch from series to closed forms, and near π.
ANGLES = [0.0, 1e-12, 1e-9, 1e-6, 1.1e-3, 0.1, np.pi - 1e-3, np.pi - 1e-6, np.pi - 1e-9]


@dataclass(frozen=True)
class Samples:
    """Draws by Hypothesis from one group, its algebra and its dual, all with one batch shape."""

    G: MatrixLieGroup
    shape: tuple[int, ...]

    def numbers(self, data: st.DataObject, *shape: int, bound: float = 1.0) -> Array:
        """Numbers within ±bound, ``(batch…, *shape)``; a quarter are 0, at the bound or small.

        Those of the simplest draw, which Hypothesis tries first, are 0.
        """
        whole = (*self.shape, *shape)
        random = self._random(data)
        if random is None:
            return np.zeros(whole)
        small = random.choice([-bound, bound], whole) * 10 ** random.uniform(-12, 0, whole)
        odd = random.choice([0.0, -bound, bound, np.nan], whole)
        odd = np.where(np.isnan(odd), small, odd)
        return np.where(random.random(whole) < 0.25, odd, random.uniform(-bound, bound, whole))

    def vector(self, data: st.DataObject, bound: float = 1.0) -> Array:
        """Coordinates in g or g* with every entry within ±bound, ``(batch…, m)``."""
        return self.numbers(data, self.G.dimension, bound=bound)

    def vectors(self, data: st.DataObject, count: int) -> list[Array]:
        """Several of `vector`."""
        return [self.vector(data) for _ in range(count)]

    def coordinates(self, data: st.DataObject, angle: float | None = None) -> Array:
        """Coordinates whose rotations turn by `angle`, or by any angle that `log` can return.

        Each element of the batch has its own angle; `ANGLES` are as likely as all others.
        """
        V = self.vector(data, bound=2.0)
        for part in self.G.parts:
            if part.velocity_unit != "rad/s":
                continue
            turn = self._angles(data) if angle is None else np.full(self.shape, angle)
            V[..., part.axes] = turn[..., None] * _direction(V[..., part.axes])
        return V

    def pose(self, data: st.DataObject) -> Array:
        """An element of the group, ``(batch…, d, d)``."""
        return self.G.exp(self.coordinates(data))

    def poses(self, data: st.DataObject, count: int) -> list[Array]:
        """Several of `pose`."""
        return [self.pose(data) for _ in range(count)]

    def state(self, data: st.DataObject) -> tuple[Array, Array]:
        """An element (Q, P) of G ⋉ g*."""
        return self.pose(data), self.vector(data)

    def states(self, data: st.DataObject, count: int) -> list[tuple[Array, Array]]:
        """Several of `state`."""
        return [self.state(data) for _ in range(count)]

    def input(self, data: st.DataObject) -> tuple[Array, Array]:
        """An element (V, τ) of the algebra of G ⋉ g*."""
        return self.vector(data), self.vector(data)

    def inputs(self, data: st.DataObject, count: int) -> list[tuple[Array, Array]]:
        """Several of `input`."""
        return [self.input(data) for _ in range(count)]

    def symmetric(self, data: st.DataObject, n: int) -> Array:
        """A symmetric matrix, ``(batch…, n, n)``."""
        A = self._matrix(data, n)
        return (A + transpose(A)) / 2

    def positive_definite(self, data: st.DataObject, n: int) -> Array:
        """A symmetric matrix with eigenvalues of at least ½, ``(batch…, n, n)``."""
        A = self._matrix(data, n)
        return A @ transpose(A) + np.eye(n) / 2

    def _matrix(self, data: st.DataObject, n: int) -> Array:
        random = self._random(data) or np.random.default_rng(0)
        return random.uniform(-1.0, 1.0, (*self.shape, n, n))

    def _angles(self, data: st.DataObject) -> Array:
        """For each element of the batch one of `ANGLES`, or as likely any up to 3."""
        random = self._random(data)
        if random is None:
            return np.zeros(self.shape)
        special = random.choice(ANGLES, self.shape)
        return np.where(random.random(self.shape) < 0.5, special, random.uniform(0, 3, self.shape))

    def _random(self, data: st.DataObject) -> np.random.Generator | None:
        """A generator by a drawn seed, None for the simplest draw.

        To draw entries one by one takes Hypothesis longer than what is tested of them.
        """
        seed = data.draw(st.integers(0, 2**32 - 1))
        return np.random.default_rng(seed) if seed else None


def _direction(vectors: Array) -> Array:
    """Unit vectors; the first axis where a vector is too short to have a direction."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    first_axis = np.eye(vectors.shape[-1])[0]
    return np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), first_axis)


ALL_GROUPS = [group_named(name) for kind in groups.all() for name in kind.examples()]


def _marks_of_groups_like_others(G: MatrixLieGroup) -> list[pytest.MarkDecorator]:
    """What holds on R1 and SO(3) is tried on groups of the same kind, too, but not every time."""
    alike = G.name in ("R3", "SO2", "SO3*R3")
    return [pytest.mark.ci("its kind of group is tried fast")] * alike


@pytest.fixture(
    scope="session",
    params=[pytest.param(G, marks=_marks_of_groups_like_others(G)) for G in ALL_GROUPS],
    ids=lambda group: group.name,
)
def G(request: pytest.FixtureRequest) -> MatrixLieGroup:
    """Every registered group in turn."""
    group: MatrixLieGroup = request.param
    return group


def _laws_on_groups() -> Iterator[Any]:
    """Every law on a simple group and on a product with all that groups have, EqT on every group.

    A law is written once for all groups, and a group knows no law: more pairs tell no more. A law
    for neither of the two is tried on the first that it is for. On the product, all but EqT and GT
    only CI tries.
    """
    in_ci = pytest.mark.ci("the law is tried fast on another group")
    for name in controllers.names():
        if not controllers.get(name).tasks:  # code of a user's own is no formula
            continue
        law = controllers.get(name)()
        fitting = [G for G in ALL_GROUPS if not _problems(law, G)]
        chosen = [G for G in fitting if name == "eqt" or G.name in ("SO3", "SE3*SO2")]
        for G in chosen or fitting[:1]:
            again = len(chosen) > 1 and name not in ("eqt", "gt") and G.name != "SO3"
            marks = [in_ci] if again else _marks_of_groups_like_others(G)
            yield pytest.param((G, law), marks=marks)


def _problems(law: Controller, G: MatrixLieGroup) -> Problems:
    problems = Problems()
    law.check(G, problems)
    return problems


@pytest.fixture(
    scope="session", params=_laws_on_groups(), ids=lambda pair: f"{pair[0].name}-{pair[1].name}"
)
def law_on_group(request: pytest.FixtureRequest) -> tuple[MatrixLieGroup, Controller]:
    """Laws and groups in turn, as `_laws_on_groups` pairs them."""
    pair: tuple[MatrixLieGroup, Controller] = request.param
    return pair


@pytest.fixture(scope="module")
def shape() -> tuple[int, ...]:
    """The batch shape of `samples`; a module may override it."""
    return (2,)


@pytest.fixture(scope="module")
def samples(G: MatrixLieGroup, shape: tuple[int, ...]) -> Samples:
    """Samples of every registered group in turn."""
    return Samples(G, shape)


@pytest.fixture(scope="module")
def samples_and_law(
    law_on_group: tuple[MatrixLieGroup, Controller], shape: tuple[int, ...]
) -> tuple[Samples, str]:
    """Samples of a group and the name of a law, as `_laws_on_groups` pairs them."""
    G, law = law_on_group
    return Samples(G, shape), law.name


@pytest.fixture(scope="session")
def samples_of() -> Callable[[str], Samples]:
    """Single samples of a group by name, for what the paper states for that group only."""
    return lambda name: Samples(group_named(name), ())


@pytest.fixture(scope="session")
def derivative() -> Callable[[Callable[[float], Any]], Any]:
    """The derivative at 0 of a curve of arrays, or of tuples of arrays, by central differences.

    Five points at a spacing of h = 1e-3: exact for polynomials of degree 4, else the error is
    h⁴|f⁽⁵⁾|/30 ~ 3e-14 |f⁽⁵⁾|; rounding adds about 1.5 ε|f|/h ~ 3e-13 |f|. With the curves of the
    tests, whose velocities have entries within ±1, |f⁽⁵⁾| stays under 1e4 |f|.
    """

    def differentiate(curve: Callable[[float], Any], h: float = 1e-3) -> Any:
        a, b, c, d = (curve(k * h) for k in (-2, -1, 1, 2))
        if isinstance(a, tuple):
            return tuple(_stencil(*points, h) for points in zip(a, b, c, d, strict=True))
        return _stencil(a, b, c, d, h)

    return differentiate


def _stencil(a: Array, b: Array, c: Array, d: Array, h: float) -> Array:
    return (8 * (c - b) - (d - a)) / (12 * h)


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    code: int
    out: str
    err: str


@pytest.fixture
def eqt(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Done]:
    """Calls the command within this process."""

    def call(*arguments: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["eqt", *map(str, arguments)])
        # Click would call the program after the module that Python was started with.
        monkeypatch.setattr(sys.modules["__main__"], "__package__", None)
        with pytest.raises(SystemExit) as exit_:
            main()
        progress.be_quiet(False)  # or what a test prints itself would be left out
        return Done(int(exit_.value.code or 0), *capsys.readouterr())

    return call


@pytest.fixture
def refused(eqt: Callable[..., Done]) -> Callable[..., str]:
    """The error that a command ends with, which prints nothing else but warnings; exit code 2."""

    def said(*arguments: object) -> str:
        done = eqt(*arguments)
        assert (done.code, done.out) == (2, "")
        start = re.search(r"(?m)^(eqt: error: |(?=(more than )?\d+ errors?\b))", done.err)
        assert start, done.err
        return done.err[start.end() :]

    return said


@dataclass(frozen=True)
class Called:
    """What a command printed."""

    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def invoke() -> Callable[..., Called]:
    """Call the command line in this process; fails unless it exits with `code`."""

    def call(*arguments: object, code: int = 0) -> Called:
        out, err = StringIO(), StringIO()
        argv, sys.argv = sys.argv, ["eqt", *map(str, arguments)]
        exit_code = 0
        try:
            with redirect_stdout(out), redirect_stderr(err):
                main()
        except SystemExit as exit:
            exit_code = int(exit.code or 0)
        finally:
            sys.argv = argv
            progress.be_quiet(False)  # or what a test prints itself would be left out
        assert exit_code == code, err.getvalue() + out.getvalue()
        return Called(out.getvalue(), err.getvalue())

    return call


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def experiment(folder: Path) -> Callable[..., Experiment]:
    """Builds `c.yaml`: `LINES` with changes, and overrides as of ``--set``."""

    def built(*overrides: str, **changes: str | None) -> Experiment:
        Path("c.yaml").write_text(configuration(**changes), encoding="utf-8")
        return build(read_config(Path("c.yaml"), overrides))

    return built


@pytest.fixture
def run(folder: Path) -> Callable[..., Execution]:
    """Runs `c.yaml`, with changes and overrides, in the folder `out`."""

    def done(
        *overrides: str, out: str = "out", force: bool = False, **changes: str | None
    ) -> Execution:
        Path("c.yaml").write_text(configuration(**changes), encoding="utf-8")
        source = read_config(Path("c.yaml"), overrides)
        return execute(study(source), Path(out), force=force)

    return done


@pytest.fixture
def experiment_of(tmp_path):
    """The experiment of a configuration in text."""

    def build(text):
        path = tmp_path / "flight.yaml"
        path.write_text(text, encoding="utf-8")
        return study(read_config(path)).base

    return build


@pytest.fixture
def solved(tmp_path):
    """The problem and the solution of a controller's runs, of a configuration in text."""

    def solve(text, label="eqt", runs=None, workers=1):
        path = tmp_path / "flight.yaml"
        path.write_text(text, encoding="utf-8")
        found = study(read_config(path))
        entries = np.arange(found.plan.entries) if runs is None else np.asarray(runs)
        [batch] = batches(found, label, entries)
        return batch.problem, batch.engine.solve(batch.problem, workers)

    return solve


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """A folder of this name, which the first process that asks for it fills; to be read only."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # each has a folder of its own, in a common one
        root = root.parent

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = root / name, root / f"{name}.done"
        try:
            folder.mkdir()
        except FileExistsError:
            while not done.exists():
                time.sleep(0.05)
        else:
            try:
                make(folder)
                (folder / "made").touch()
            finally:
                done.touch()
        assert (folder / "made").exists(), f"{name} could not be made"
        return folder

    return made


@pytest.fixture(scope="session")
def changed(invoke, made_once):
    """The paper with 20 runs, with a stiffer law, with other starts, and some runs of two laws."""

    def make(folder):
        for name, change in {
            "soft": [],
            "stiff": ["--set", "gains.kp=2"],
            "other": ["--set", "ensemble.seed=3", "--set", "ensemble.runs=15"],
            "few": [
                *("--set", "controllers=[eqt, {kind: gt, label: mine}]"),
                *("--set", "ensemble.runs=4", "--set", "store.trajectories=none"),
            ],
        }.items():
            has_runs = any("ensemble.runs" in word for word in change)
            few = FEW_RUNS[:2] + FEW_RUNS[4:] if has_runs else FEW_RUNS
            invoke("run", "paper", *few, *change, "--out", folder / name)

    return made_once("changed", make)


@pytest.fixture(scope="session")
def default_result(made_once: Callable[..., Path]) -> Path:
    """The folder of a run of `LINES`."""

    def make(folder: Path) -> None:
        (folder / "c.yaml").write_text(configuration(), encoding="utf-8")
        execute(study(read_config(folder / "c.yaml", ())), folder / "out")

    return made_once("a run of the experiment", make) / "out"


PAPER = Path(__file__).parents[1] / "configs" / "paper.yaml"
ROUGH = ["--quiet", "--set=solver.rtol=1e-6", "--set=solver.cross_check=0"]


@pytest.fixture(scope="session")
def paper_result(invoke: Callable[..., Called], made_once: Callable[..., Path]) -> Path:
    """The folder of the paper's experiment with 60 runs per law."""
    few = ["--set=ensemble.runs=60", "--set=time.samples=201"]
    run = partial(invoke, "run", PAPER, *few, *ROUGH, "--out")
    return made_once("paper", lambda folder: run(folder / "result")) / "result"


@pytest.fixture(scope="session")
def swept_result(invoke: Callable[..., Called], made_once: Callable[..., Path]) -> Path:
    """The folder of a sweep: six points of the paper's experiment, shortened, 5 runs each."""
    few = ["--set=ensemble.runs=5", "--set=time.duration=4", "--set=time.samples=41"]
    grids = ["--grid", "gains.kp=0.5,1,2.5", "--grid", "gains.kd=0.5,1"]
    sweep = partial(invoke, "sweep", PAPER, *few, *ROUGH, *grids, "--out")
    return made_once("swept", lambda folder: sweep(folder / "result")) / "result"


def leave_unarranged(patch: pytest.MonkeyPatch) -> None:
    """Leave out the search for places of panels, which is most of the time that a figure takes."""
    patch.setattr(
        "eqt_cli.figures.figure.freeze", lambda drawing: drawing.set_layout_engine("none")
    )


@pytest.fixture
def unarranged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures whose panels have no places of their own.

    For tests of what is drawn, and not of where; figures/test_figures.py looks at all of them.
    """
    leave_unarranged(monkeypatch)


@pytest.fixture(scope="session")
def page_of(invoke: Callable[..., Called], made_once: Callable[..., Path]) -> Callable[..., Path]:
    """The page of one of the two results above, by `eqt report`; its figures are `unarranged`.

    They are all that the page has, or some.
    """

    def written(result: Path, *figures: str) -> Path:
        chosen = [f"--figure={name}" for name in figures]

        def write(folder: Path) -> None:
            with pytest.MonkeyPatch.context() as patched:
                leave_unarranged(patched)
                invoke("report", result, *chosen, "--out", folder / "report.html")

        return made_once(" ".join(["page of", result.parent.name, *figures]), write) / "report.html"

    return written


PER_RUN = ("controller", "run")
POSE = (*PER_RUN, "time", "row", "col")


class MakeResult:
    """Writes small results out of their parts and opens them."""

    times = np.linspace(0.0, 20.0, 41)

    def __init__(self, folder):
        self.folder, self.opened = folder, []

    def constant(self, *levels):
        """Signals that are constant over time: a list of runs per law."""
        return np.asarray(levels, float)[..., None] * np.ones(len(self.times))

    def __call__(
        self,
        labels,
        signals=None,
        metrics=None,
        status=None,
        kinds=None,
        units=None,
        stored=None,
        title="made up",
        more=None,
        points=None,
    ):
        signals, metrics, units = signals or {}, metrics or {}, units or {}
        runs = np.shape(next(iter([*metrics.values(), *signals.values()])))[2 if points else 1]
        leading = [points] if points else []
        status = np.zeros((*leading, len(labels), runs)) if status is None else status
        per_run = ("point", *PER_RUN) if points else PER_RUN
        entries = "".join(
            f"  - kind: {kind}\n    label: {json.dumps(label)}\n"
            for label, kind in zip(labels, kinds or labels, strict=True)
        )
        experiment = json.dumps({"kinds": dict(zip(labels, kinds or labels, strict=True))})
        dims = ("controller", "run" if stored is None else "stored_run", "time", "axis")
        table = Table(
            {
                name: Variable(dims[: np.ndim(values)], values, {"units": units.get(name, "1")})
                for name, values in signals.items()
            }
            | {
                name: Variable(per_run, np.asarray(values, float), {"units": units.get(name, "1")})
                for name, values in metrics.items()
            }
            | {name: Variable(POSE[-np.ndim(v) :], v) for name, v in (more or {}).items()}
            | {"status": Variable(per_run, np.asarray(status, dtype=np.int32))},
            {
                "controller": Variable(("controller",), np.array(labels, dtype=object)),
                "run": Variable(("run",), np.arange(runs)),
                "time": Variable(("time",), self.times, {"units": "s"}),
            }
            | (
                {}
                if stored is None
                else {"stored_run": Variable(("stored_run",), np.arange(stored))}
            ),
            {
                "title": title,
                "group": "SO3",
                "config": f"controllers:\n{entries}",
                "experiment": experiment,
            },
        )
        path = self.folder / f"results{len(self.opened)}.h5"
        write(path, table)
        self.opened.append(open_result(path))
        return self.opened[-1]


@pytest.fixture
def make_result(tmp_path):
    make = MakeResult(tmp_path)
    yield make
    for results in make.opened:
        results.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Headless Chromium without a network; skipped where it, its driver or selenium is missing."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium")
    driver = shutil.which("chromedriver")
    program = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)
    if driver is None or program is None:
        pytest.skip("needs Chromium and its driver (chromedriver)")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    folder = tmp_path_factory.mktemp("browser")
    for argument in (
        "--headless=new",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--window-size=1200,1000",
        "--host-resolver-rules=MAP * ~NOTFOUND",  # no name has an address
        f"--user-data-dir={folder / 'profile'}",
        *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []),
    ):
        options.add_argument(argument)
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    page = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    page.downloads = folder
    yield page
    page.quit()


AXE = Path(__file__).with_name("axe") / "axe.min.js"


@pytest.fixture
def violations(browser):
    """What axe-core finds wrong with a page at a width and in a scheme, a line for each rule."""

    def found(address, width, scheme):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        screen = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        browser.get(address)
        browser.execute_script(AXE.read_text(encoding="utf-8"))
        # Colours that are still changing have any contrast.
        judge = """
            const done = arguments[arguments.length - 1];
            document.head.append(Object.assign(document.createElement("style"),
              { textContent: "* { transition: none !important; animation: none !important; }" }));
            axe.run({ resultTypes: ["violations"] }).then((found) => done(found.violations));"""
        return [
            f"{rule['id']}: {', '.join(str(node['target']) for node in rule['nodes'])}"
            for rule in browser.execute_async_script(judge)
        ]

    yield found
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


@pytest.fixture
def noted() -> Callable[..., list[tuple[str, str]]]:
    """What a component notes of its options, as (option, message)."""

    def noted(component: Any, *group: MatrixLieGroup) -> list[tuple[str, str]]:
        problems = Problems()
        component.check(*group, problems)
        return [(problem.path, problem.message) for problem in problems]

    return noted


# Programs in C ------------------------------------------------------------------------------------

C_COMPILERS = {"cc": ["-std=c99"], "c++": ["-x", "c++", "-std=c++98", "-Wno-long-long"]}


@cache
def _compiled(program: Program, compiler: str) -> ctypes.CDLL | None:
    if not shutil.which(compiler):
        return None
    function = c_function(program, "function")
    if compiler == "c++":
        function = f'extern "C" {function}'
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "program.c"), Path(folder, "program.so")
        headers = [f'#include "{path}"' for path in (LANES_HEADER, FUNCTIONS_HEADER)]
        source.write_text("\n".join([*headers, function]))
        strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-function"]
        flags = [*C_COMPILERS[compiler], *strict, "-O0", "-ffp-contract=off", "-fPIC", "-shared"]
        command = [compiler, *flags, str(source), "-o", str(library), "-lm"]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(library))


@pytest.fixture
def in_c() -> Callable[..., dict[str, Array]]:
    """Run a program as C by one of `C_COMPILERS`, on arrays by the names of its groups."""

    def run(program: Program, compiler: str = "cc", **inputs: Any) -> dict[str, Array]:
        library = _compiled(program, compiler)
        if library is None:
            pytest.skip(f"no {compiler} on this machine")
        given = [np.ravel(np.asarray(inputs[group], dtype=float)) for group, _ in program.inputs]
        for k, (group, length) in enumerate(program.inputs):
            if group == NUMBERS and len(given[k]) + len(program.numbers) == length:
                given[k] = np.append(given[k], program.numbers)
        found = {output.name: np.empty(output.shape) for output in program.outputs}
        arrays = [*given, *found.values()]
        library.function(*(array.ctypes.data_as(ctypes.c_void_p) for array in arrays))
        return found

    return run


class Told(Reporter):
    """Remembers what it was told."""

    def __init__(self) -> None:
        self.steps: list[tuple[str, int]] = []
        self.done: list[list[float]] = []
        self.skipped: list[float] = []
        self.ended = 0
        self.notes: dict[str, str] = {}
        self.remarks: list[str] = []
        self.activities: list[str] = []

    def begin(self, what: str, count: int) -> None:
        self.steps.append((what, count))
        self.done.append([])

    def advance(self, amount: float) -> None:
        self.done[-1].append(amount)

    def skip(self, amount: float) -> None:
        self.skipped.append(amount)

    def end(self) -> None:
        self.ended += 1

    def note(self, about: str, words: str) -> None:
        self.notes[about] = words

    @contextmanager
    def busy(self, words: str) -> Iterator[None]:
        self.activities.append(words)
        yield

    def remark(self, warning: EqtWarning) -> None:
        self.remarks.append(str(warning))

    def total(self, what: str) -> float:
        """How much was done of the steps that counted this."""
        each = zip(self.steps, self.done, strict=True)
        return sum(sum(done) for (name, _), done in each if name == what)


@pytest.fixture
def told() -> Iterator[Told]:
    """What eqt tells in this test."""
    remembering = Told()
    with reporting(remembering):
        yield remembering
