"""Where to find today what plugins of earlier versions import; it knows no other use of it.

A result holds the source of its plugins, so that source must run for as long as the result is
read. Plugins of today import from `eqt_cli.extend`, whose names stay.
"""

import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

_DRAWING = {
    "boxes": "plots.drawing.box_plots",
    "by_controller": "plots.drawing.layout",
    "callouts": "plots.drawing.point_labels",
    "disc": "plots.drawing.sphere_projection",
    "ensembles": "plots.shown.controllers",
    "first_runs": "plots.base plots.drawing.curves",
    "good_metrics": "plots.shown.metrics",
    "good_runs": "plots.shown.trajectories",
    "look": "plots.drawing.style",
    "metric_names": "plots.drawing.labels",
    "numbers": "plots.curve_data",
    "sheets": "plots.drawing.style_sheets",
    "figure_data": " ".join(
        f"plots.shown.{name}"
        for name in "controllers trajectories metrics sweep certificates reference fronts".split()
    ),
    "swept": "plots.shown.sweep results.result",
    "verified": "plots.shown.certificates",
    **{name: f"plots.drawing.{name}" for name in "curves labels latex layout scales style".split()},
}
_FIGURES = "paper runs torque distributions phase sphere certificates sweep pareto"

MOVED = {
    "eqt_cli.core.blame": "eqt_cli.core.error_origin",
    "eqt_cli.core.marks": "eqt_cli.core.own_files",
    "eqt_cli.core.numbers": "eqt_cli.core.option_types",
    "eqt_cli.engines.switching": "eqt_cli.engines.taylor.switching",
    "eqt_cli.store.assembly": "eqt_cli.store.piecewise_writer",
    "eqt_cli.store.layout": "eqt_cli.store.reserved_names",
    "eqt_cli.store.variables": "eqt_cli.store.table",
    "eqt_cli.ensemble.executors": "eqt_cli.execution.executors",
    "eqt_cli.analysis.bounded": "eqt_cli.analysis.evidence.running_error",
    "eqt_cli.analysis.certificates.runs": "eqt_cli.analysis.evidence.runs",
    "eqt_cli.analysis.certificates.sample": "eqt_cli.analysis.evidence.sample",
    "eqt_cli.analysis.certificates.setting": "eqt_cli.analysis.evidence.runs",
    "eqt_cli.analysis.comparison.measures": "eqt_cli.results.metrics eqt_cli.results.time_windows",
    "eqt_cli.analysis.comparison.windows": "eqt_cli.results.time_windows",
    "eqt_cli.analysis.metrics": "eqt_cli.results.metrics",
    **{
        f"eqt_cli.plots.{old}": " ".join(f"eqt_cli.{place}" for place in new.split())
        for old, new in _DRAWING.items()
    },
    **{f"eqt_cli.plots.{name}": f"eqt_cli.plots.figures.{name}" for name in _FIGURES.split()},
}
"""Modules by their old names; a package stands for all that is in it, and what one module held
may be in several."""

_OF_EXPRESSIONS = {
    "tree": "Number Variable Negation Binary Call Node fold",
    "piecewise": "Piecewise PIECEWISE",
    "evaluation": "combine power",
    "parser": "MAX_LENGTH MAX_NESTING",
    "expression": "MOST_QUOTED",
}

RENAMED = {
    "eqt_cli.core.expressions": {
        name: f"eqt_cli.core.expressions.{module}"
        for module, names in _OF_EXPRESSIONS.items()
        for name in names.split()
    },
    "eqt_cli.ensemble.axes": {
        "LISTED": "eqt_cli.ensemble.designs.base",
        "listed": "eqt_cli.ensemble.designs.base",
    },
    "eqt_cli.execution.executors": {"Ways": "eqt_cli.execution.executors.base:TaskContext"},
    "eqt_cli.execution.executors.base": {"Ways": "eqt_cli.execution.executors.base:TaskContext"},
    "eqt_cli.plots.shown.certificates": {
        "Verified": "eqt_cli.plots.shown.certificates:ShownCertificates"
    },
    "eqt_cli.plots.shown.metrics": {"GoodMetrics": "eqt_cli.plots.shown.metrics:ShownMetrics"},
    "eqt_cli.plots.shown.sweep": {"Swept": "eqt_cli.plots.shown.sweep:ShownSweep"},
    "eqt_cli.plots.shown.trajectories": {"GoodRuns": "eqt_cli.plots.shown.trajectories:ShownRuns"},
    "eqt_cli.results.result": {"SweptKey": "eqt_cli.results.swept_key"},
    "eqt_cli.store.reader": {"Results": "eqt_cli.store.reader:ResultFile"},
    "eqt_cli.plots": {"Figure": "eqt_cli.plots.base", "OfCertificates": "eqt_cli.plots.base"},
}
"""Names that modules which are still there have lost, and the modules that have them now, as
``module:name`` where the name is another."""


def find_moved() -> None:
    """Let imports find what has moved, from now on; called before a plugin is executed."""
    if any(isinstance(finder, _Finder) for finder in sys.meta_path):
        return
    # First: a package that has moved must not be searched as a folder by its old name.
    sys.meta_path.insert(0, _Finder())
    reached_by_old_names = " ".join(MOVED.values()).split()
    for name in RENAMED:
        if name not in reached_by_old_names:
            _with_lost_names(name)


class _Finder(MetaPathFinder, Loader):
    """Imports a module by its old name: as the module of today itself, not as a copy of it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if _today(fullname) else None

    def exec_module(self, module: ModuleType) -> None:
        name = module.__name__
        found = [_with_lost_names(new) for new in _today(name)]
        if len(found) == 1:
            sys.modules[name] = found[0]
        else:
            vars(module)["__getattr__"] = partial(_from_one_of, name, found)


def _today(name: str) -> list[str]:
    """The modules that hold what was in a module; none if it has not moved."""
    old, rest = name, ""
    while old and old not in MOVED:
        old, _, last = old.rpartition(".")
        rest = f".{last}{rest}"
    return [new + rest for new in MOVED[old].split()] if old else []


def _with_lost_names(name: str) -> ModuleType:
    module = import_module(name)
    if name in RENAMED:
        vars(module)["__getattr__"] = partial(_renamed, name, RENAMED[name])
    return module


def _from_one_of(module: str, places: Sequence[ModuleType], name: str) -> object:
    for place in places:
        if hasattr(place, name):
            return getattr(place, name)
    raise AttributeError(f"module {module!r} has no attribute {name!r}")


def _renamed(module: str, lost: dict[str, str], name: str) -> object:
    if name not in lost:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    place, _, today = lost[name].partition(":")
    return getattr(import_module(place), today or name)
