"""The page: programs, numbers, sliders and what eqt found, in one file."""

from __future__ import annotations

import gzip
import shlex
import tempfile
import time
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from markupsafe import Markup

from eqt_cli.api.loading import open_at
from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import EqtError, EqtWarning, Problems
from eqt_cli.base.files import FILE_NAME
from eqt_cli.base.reporting import reporter
from eqt_cli.base.yaml_source import flow
from eqt_cli.components.groups import MatrixLieGroup, moving_parts, principal_moments
from eqt_cli.components.inertia import Inertia
from eqt_cli.config.document import Document, overridden
from eqt_cli.config.study import Study, study
from eqt_cli.engines.engine import Engine
from eqt_cli.engines.native import SMALLEST_RTOL, STEP_SHARE, Native
from eqt_cli.extensions.live import sliders, wasm
from eqt_cli.extensions.live.programs import DIVERGED, LiveLoop, numbers_of
from eqt_cli.extensions.live.sliders import Effect, Range, Slider
from eqt_cli.extensions.live.units import unit_of
from eqt_cli.extensions.report import summary
from eqt_cli.extensions.report.document import page
from eqt_cli.extensions.report.scenes import INERTIAL, motion, scene_of
from eqt_cli.figures.shapes import AZIMUTH, CORNERS, ELEVATION, FACES, discs
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import Result
from eqt_cli.results.summary import compared_first
from eqt_cli.runs.folder import blanks, described, new_result_file

Experiments: TypeAlias = Callable[[Mapping[str, Any]], Study]
"""Returns an experiment with other values of keys, by key."""

Moving: TypeAlias = Sequence[tuple[Slider, list[Effect]]]
"""Sliders with what follows each."""

TEMPLATES = Path(__file__).with_name("templates")

MOST_RUNS = 200
"""Most runs of a page."""

DRAWN_BYTES = 6 * 2**20
"""Most memory for what is drawn for sensors, which no packing makes smaller."""

MOST_DRAWN = 10
"""Most runs of a page with such draws."""

MOST_STEPS = 20_000
"""Most steps of a run in a page, unless the configured runs take a tenth of it."""

SIGNALS = "velocity_error", "lyapunov"
"""Signals that a page draws beside the errors of poses and torques, where all laws have them."""

MEANINGS = {
    "pose_error": "how far Q_E = Q Q_d⁻¹, the pose relative to its reference, is from the identity",
    "velocity_error": "how far the velocity is from the desired one",
    "torque_norm": "size of the torque",
    "lyapunov": "Lyapunov function: energy of the errors of pose and velocity",
    "mean_attitude_error": "angle between the attitude and its reference, mean over the horizon",
}
"""What curves and columns show, where the description in a result is shorter."""

LETTERS = {"||": "‖", "_F": "", "^2": "²", " - ": " − ", "tau": "τ", "pd": "p_d", "Vd": "V_d"}
"""Letters for what descriptions in results spell."""


def runs_of(study: Study) -> int:
    """Return how many runs of each law a page of an experiment has."""
    loops, runs = study.base.loops.values(), min(MOST_RUNS, study.plan.runs)
    for loop in loops:
        if loop.vehicle.measures:
            ticks = study.base.times[-1] / loop.period
            drawn = 16 * ticks * loop.group.dimension
            runs = min(runs, MOST_DRAWN, max(1, int(DRAWN_BYTES / drawn)))
    return runs


def experiments(document: Document) -> Experiments:
    """Return what gives the experiment of a configuration with other values of keys."""

    def changed(setting: Mapping[str, Any]) -> Study:
        return study(overridden(document, [f"{key}={flow(x)}" for key, x in setting.items()]))

    return changed


def for_a_page(load: Experiments, runs: int | None = None) -> Experiments:
    """Return what gives an experiment as a page runs it: so many runs, by the engine native."""
    alone = {"sweep": None}
    base = load(alone)
    settings = {**alone, "ensemble.runs": runs or runs_of(base), **native(base.base.engine)}
    return lambda setting: load({**settings, **setting})


def native(engine: Engine) -> dict[str, Any]:
    """Return the settings by which the engine native computes what another engine does."""
    if isinstance(engine, Native):
        return {}
    rtol, atol = max(engine.rtol, SMALLEST_RTOL), getattr(engine, "atol", 1e-12)
    return {"solver": {"engine": "native", "rtol": rtol, "atol": atol}}


@contextmanager
def blank_result(experiment: Study) -> Iterator[Result]:
    """Open the result of an experiment before it runs: everything but its numbers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / FILE_NAME
        with new_result_file(experiment, path) as file:
            for name, variable in blanks(experiment).items():
                none = "" if variable.dtype is None else 0
                shape = file.shape(name)
                file.put(name, np.full(shape, none, variable.dtype or object))
            file.describe(described(experiment, {}))
        with open_at(folder) as result:
            yield result


class LivePage:
    """The page of an experiment, made ready before anything runs.

    Parameters
    ----------
    load
        Returns the experiment with other values of keys, by key.
    form
        A result of the experiment; its numbers are not read.
    command
        The words of the command that runs the experiment in eqt.
    of_runs
        How many runs of each law the experiment has; a page may have the first of them.

    Raises
    ------
    EqtError
        If the experiment cannot run in a page; it says why.
    """

    def __init__(
        self, load: Experiments, form: Result, command: Sequence[str], of_runs: int
    ) -> None:
        self.load, self.of_runs = load, of_runs
        self.study = load({})
        if self.study.base.config.failed_when:
            raise EqtError(
                "failed_when: runs in a page do not end at a bound, so that they would differ from "
                "eqt run; leave it out by --set failed_when=null"
            )
        self.runs = min(runs_of(self.study), len(form["status"][0]))
        self.command = list(command)
        if self.runs < of_runs:
            key = "--set=ensemble.runs="
            self.command = [word for word in command if not word.startswith(key)]
            self.command.append(f"{key}{self.runs}")
        self.panels = _panels(form)
        self.settles = [name for name in ("settled", "settling_time") if form.has(name)][:1]
        # Constraints are judged between samples, too, of which the program of a page knows none.
        of_samples = (x for x in compared_first(form) if not form.quantity(x).constraint)
        self.shown = [*self.settles, *of_samples]
        with np.errstate(all="ignore"):
            self.loops = {
                label: LiveLoop(self.study, label, self.panels, self.shown)
                for label in self.study.base.loops
            }
            self.base = self.numbers({})
        self.rules = sliders.inverses(self.loops, self.base)
        self.of_keys: list[tuple[Slider, list[Effect]]] = []
        self.modules: list[dict[str, Any]] = []
        self.tables = dict[str, Array]()

    def numbers(self, setting: Mapping[str, Any]) -> dict[str, Array]:
        """Return all that the programs take of a setting, of 64 bits."""
        with np.errstate(all="ignore"):
            return numbers_of(self.load(setting), self.loops, self.runs)

    def made_ready(self, keys: Mapping[str, Range]) -> LivePage:
        """Find what sliders move, and compile the programs; return the page itself.

        Parameters
        ----------
        keys
            Ranges of the sliders by key; those of the configuration or the usual ones if empty.

        Raises
        ------
        EqtError
            If a key cannot be moved, or a program cannot be compiled; it says why.
        """
        with reporter().busy("finding what sliders move"):
            self.of_keys = self._moving(keys)
        self.modules, self.tables = _modules(self.loops, self.base, self.of_keys)
        return self

    def try_keys(self, keys: Mapping[str, Range], problems: Problems) -> None:
        """Note which keys no slider can move, and why, without the tables of a page."""
        pairs: list[tuple[Slider, list[Effect]]] = []
        for key, range_ in keys.items():
            try:
                pairs.append(self._moved(key, range_, pairs, few=True))
            except EqtError as error:
                problems.at(key).add(_without(key, error))
        if not problems:
            try:
                sliders.checked(pairs, self.rules, self.numbers, self.base)
            except EqtError as error:
                problems.add(str(error.args[0]))

    def _moved(
        self,
        key: str,
        range_: Range,
        others: Moving,
        *,
        few: bool = False,
        is_requested: bool = True,
    ) -> tuple[Slider, list[Effect]]:
        """Return the slider of a key with what follows it and none of the others."""
        slider = sliders.slider_of(self.study.document.data, key, range_)
        slider = slider.few if few else slider
        of_key = sliders.effects(
            slider, self.numbers, self.base, self.rules, is_requested=is_requested
        )
        sliders.disjoint(others, slider, of_key)
        return slider, of_key

    def _moving(self, keys: Mapping[str, Range]) -> list[tuple[Slider, list[Effect]]]:
        """Return the sliders with what follows them; of the usual keys those that can be moved."""
        data = self.study.document.data
        of_configuration = {} if keys else data.get("live") or {}
        keys = keys or of_configuration
        usual = [] if keys else list(sliders.usual_keys(data))
        pairs: list[tuple[Slider, list[Effect]]] = []
        begun = time.process_time()
        for place, key in enumerate(keys or usual):
            if usual and time.process_time() - begun > sliders.MOST_SECONDS_OF_ALL:
                why = "those before took long; ask for it by --key or `live`"
                reporter().remark(EqtWarning(f"no slider for {', '.join(usual[place:])}: {why}"))
                break
            try:
                pairs.append(self._moved(key, keys.get(key), pairs, is_requested=bool(keys)))
            except EqtError as error:
                if of_configuration:
                    problems = Problems(self.study.document.place)
                    problems.at("live", key).add(_without(key, error))
                    problems.raise_if_any()
                if keys:
                    raise
                reporter().remark(EqtWarning(f"no slider for {error}"))
            if len(pairs) == sliders.MOST_KEYS and not keys:
                break
        while pairs:
            try:
                sliders.checked(pairs, self.rules, self.numbers, self.base)
                break
            except EqtError as error:
                if keys:
                    raise
                reporter().remark(EqtWarning(f"no slider for {pairs.pop()[0].key}: {error}"))
        return pairs

    def whole(self, result: Result, title: str = "") -> str:
        """Return a page of its own with the numbers of a result."""
        return page(
            TEMPLATES / "live.html.j2",
            ["report.css", "live.css"],
            "live.js",
            title=title or summary.called(result),
            group=result.group_name,
            digest=self.study.digest[:12],
            terms=self._terms(result),
            paper=str(result.attributes.get("references", "")),
            configuration="",
            stated=summary.stated_values(result),
            **self._values(result),
        )

    def part(self, result: Result) -> dict[str, str]:
        """Return the part of a report, its `html` and `css`."""
        html = page(
            TEMPLATES / "part.html.j2",
            [],
            "live.js",
            configuration="#provenance",
            **self._values(result),
        )
        css = (TEMPLATES / "live.css").read_text(encoding="utf-8")
        return {"html": Markup(html), "css": Markup(css)}

    def _values(self, result: Result) -> dict[str, Any]:
        """Return what the template of the part takes."""
        shown, runs, engine = self.shown, self.runs, self.study.base.engine
        assert isinstance(engine, Native)
        tables = self.tables | self.base
        tables["expected"] = np.stack([result[name][:, :runs] for name in shown], axis=-1)
        tables["status"] = np.array(result["status"][:, :runs], float)
        steps = max(1, int(result["steps"][:, :runs].max()))
        packed, index = _packed(tables)
        data = {
            "modules": self.modules,
            "keys": [
                {"key": slider.key, "unit": slider.unit, "shown": self._unit(slider)}
                | {"values": slider.values, "base": slider.values.index(slider.base)}
                | {"effects": [asdict(effect) for effect in of_key]}
                for slider, of_key in self.of_keys
            ],
            "inverses": [asdict(rule) for rule in self.rules],
            "laws": summary.looks(result),
            "columns": [
                column | (_COUNTED if name in self.settles else {"counts": False})
                for name, column in zip(shown, summary.columns(result, shown), strict=True)
            ],
            "panels": summary.columns(result, self.panels),
            "numbers": packed,
            "index": index,
            "runs": runs,
            "of_runs": self.of_runs,
            "solver": {
                "rtol": engine.rtol * STEP_SHARE,
                "atol": engine.atol * STEP_SHARE,
                "most_steps": min(engine.max_steps, max(MOST_STEPS, 10 * steps)),
            },
            "engine": _other_engine(result),
            "times": result.times.tolist(),
            "command": shlex.join(self.command),
            "scene": _scene(result, self.study.base.group),
            "body": _body(self.study, [slider for slider, _ in self.of_keys]),
        }
        worker = (TEMPLATES / "compute.js").read_text(encoding="utf-8")
        laws = summary.laws(result)
        return {"data": data, "worker": worker, "tables": _expected(tables, data), "laws": laws}

    def _unit(self, slider: Slider) -> str:
        """Return the unit of a slider: as it is written, or that of its key."""
        return Plain().unit(slider.unit) or unit_of(self.study, slider.key)

    def _terms(self, result: Result) -> dict[str, str]:
        """Return what the heads of the table and of the curves mean, by head."""
        terms = {}
        for name in self.settles:
            threshold = summary.in_words(result.config.get("settling_threshold"))
            symbol = result.quantity(name).symbol.plain or "the error"
            terms["settled"] = f"{symbol} ends below the settling threshold, {threshold}"
        for column in summary.columns(result, [*self.panels, *self.shown[len(self.settles) :]]):
            name = column["metric"]
            meaning = result.quantity(name).long_name
            for spelt, letters in LETTERS.items():
                meaning = meaning.replace(spelt, letters)
            terms[column["name"]] = MEANINGS.get(name, meaning)
        return terms


def _without(key: str, error: EqtError) -> str:
    """Return what is wrong with a key, which stands before it."""
    return str(error.args[0]).removeprefix(f"{key}: ")


def _other_engine(result: Result) -> str:
    """Return the name of the engine of a result; empty for the page's own."""
    name = str(result.config["solver"]["engine"])
    return "" if name == Native.name else name


def _panels(result: Result) -> list[str]:
    names = []
    for name in ("pose_error", "torque_norm"):
        names += [name for name in result.in_parts(name) if result.has(name)]
    return names + [name for name in SIGNALS if result.has(name)]


def _modules(
    loops: Mapping[str, LiveLoop], base: Arrays, of_keys: Sequence[tuple[Slider, list[Effect]]]
) -> tuple[list[dict[str, Any]], dict[str, Array]]:
    """Return the programs of the page; laws share one where they differ in parameters only."""
    groups: dict[Any, list[LiveLoop]] = {}
    for label, live in loops.items():
        held = [base[f"{label}/{name}"].tobytes() for name in sorted(_HELD)]
        follow = [
            (name, effect.at, effect.by, effect.table)
            for name in sorted(_HELD)
            for _, of_key in of_keys
            for effect in of_key
            if effect.array == f"{label}/{name}"
        ]
        groups.setdefault((live.identity, *held, repr(follow)), []).append(live)
    modules: list[dict[str, Any]] = []
    tables: dict[str, Array] = {}
    for number, members in enumerate(groups.values()):
        live = members[0]
        source = live.source()
        contents = {kind: wasm.compiled(source, kind == "fused") for kind in ("fused", "plain")}
        modules.append(
            {
                "wasm": {kind: _base64(content) for kind, content in contents.items()},
                "sizes": live.sizes,
                "laws": [member.label for member in members],
                "metrics": live.metrics,
                "kept": live.places(),
            }
        )
        tables |= {
            f"module {number}/times": live.problem.times[:, None],
            f"module {number}/columns": live.looked.columns,
            f"module {number}/memory_before": live.looked.starts[:, None],
            f"module {number}/spans": live.spans,
        }
    return modules, tables


_COUNTED = {"counts": True, "name": "settled", "unit": "", "better": "higher"}
_HELD = ("held", "held_at_samples", "held_at_start")


def _packed(tables: Arrays) -> tuple[str, dict[str, tuple[int, int, int]]]:
    """Return all numbers in one text, and where each table begins, its rows and their length."""
    index, begin, pieces = {}, 0, []
    for name, array in tables.items():
        rows = len(array)
        width = array.size // rows if rows else 0
        index[name] = (begin, rows, width)
        pieces.append(np.ascontiguousarray(array, dtype="<f8").ravel())
        begin += array.size
    return _base64(np.concatenate(pieces).tobytes()), index


def _base64(content: bytes) -> str:
    return b64encode(gzip.compress(content, 9, mtime=0)).decode("ascii")


def _expected(tables: Arrays, data: Mapping[str, Any]) -> list[list[str]]:
    """Return the table of the configured runs as text, for readers without scripts."""
    rows = []
    for k, law in enumerate(data["laws"]):
        good = tables["status"][k] == 0
        numbers = tables["expected"][k][good]
        rows.append([law["title"]])
        for j, column in enumerate(data["columns"]):
            values = numbers[:, j]
            settled = np.isfinite(values) & (values != 0)
            counted = f"{settled.sum()}/{len(values)}"
            rows[-1].append(counted if column["counts"] else f"{values.mean():.4g}")
    return rows


def _body(study: Study, moved: Sequence[Slider]) -> dict[str, Any] | None:
    """Return the moments of a rigid body and the keys that move them; None where none does.

    So a page can say of moments that no body has them. Not of products, added mass, or a centre of
    mass elsewhere.
    """
    G, inertia = study.base.group, next(iter(study.base.loops.values())).inertia
    turning = [part for part in G.parts if part.turns]
    if study.base.config.rigid is False or len(principal_moments(G, np.eye(G.dimension))) != 1:
        return None
    if not isinstance(inertia, Inertia) or inertia.added is not None or inertia.change is not None:
        return None
    axes = np.arange(G.dimension)[turning[0].axes]
    others = np.setdiff1d(np.arange(G.dimension), axes)
    if inertia.matrix.ndim != 2 or inertia.matrix[np.ix_(axes, others)].any():
        return None
    names = {f"inertia{at}": k for k, i in enumerate(axes) for at in (f"[{i}]", f"[{i}][{i}]")}
    keys = {x.key: names[x.key] for x in moved if x.key in names and not x.unit}
    return {"matrix": inertia.matrix[np.ix_(axes, axes)].tolist(), "keys": keys} if keys else None


def _scene(result: Result, group: MatrixLieGroup) -> dict[str, Any] | None:
    """Return what the bodies are drawn with; None if there is no body to show."""
    try:
        scene = scene_of(motion(result, 0))
    except EqtError:
        return None
    turning, moving = moving_parts(group)
    places = np.arange(group.size**2).reshape(group.size, group.size)
    return {
        "rotation": [] if turning is None else places[turning.entries].tolist(),
        "position": [] if moving is None else places[moving.entries][:, 0].tolist()[:3],
        "frame": scene.motion.frame.tolist(),
        "length": scene.length,
        "centre": scene.centre.tolist(),
        "reach": scene.reach,
        "ground": np.round(scene.ground, 4).tolist(),
        "inertial": [*zip(INERTIAL, scene.motion.frame.T.tolist(), strict=True)],
        "view": [float(AZIMUTH), float(ELEVATION)],
        "corners": CORNERS.tolist(),
        "faces": [list(face) for face in FACES],
        "rotors": [polygon.round(4).tolist() for polygon in discs(scene.motion.rotors)],
        "diverged": DIVERGED,
    }
