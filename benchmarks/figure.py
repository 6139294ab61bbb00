"""Figures: the work-precision diagram, runs per second, the growth of time and memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.table import TITLES, Results
from benchmarks.whole_command import BEFORE, NOW
from eqt_cli.base.files import write_all
from eqt_cli.figures.labels import in_words
from eqt_cli.figures.layout import add_legend, freeze
from eqt_cli.figures.render import encode
from eqt_cli.figures.style import WIDTHS, house_style, ink, line_style

CASE = "paper"
"""The runs of which the figure of rates tells."""

SAME = {"eqt native": "eqt native", "eqt blocks (default)": "eqt solve_ivp"}
"""The contenders that the sampled loops call otherwise; no other of eqt's is in the figure."""


def write(results: Results, folder: Path) -> None:
    """The figures of what was measured, as PNG and SVG."""
    with house_style():
        drawings = {"work_precision": work_precision(results)} if results.measurements else {}
        if results.sampled and results.of(CASE):
            drawings["runs_per_second"] = runs_per_second(results)
        if results.growth:
            drawings["growth"] = growth(results)
        if results.commands:
            drawings["commands"] = commands(results)
        for drawing in drawings.values():
            freeze(drawing)
    for name, drawing in drawings.items():
        for format in ("png", "svg"):
            file = folder / f"{name}.{format}"
            write_all({file: encode(drawing, format, name)}, folder)


def work_precision(results: Results) -> Figure:
    """Error against time for every contender: largest (lines) and median (dots) over the runs."""
    cases = list(dict.fromkeys(each.case for each in results.measurements))
    names = list(results.headline)
    drawing = Figure(figsize=(WIDTHS["page"], 3.2), layout="constrained")
    panels = drawing.subplots(1, len(cases), squeeze=False, sharey=True)[0]
    for case, panel in zip(cases, panels, strict=True):
        for index, name in enumerate(names):
            rows = [each for each in results.of(case) if each.contender == name]
            if not rows:
                continue
            style: dict[str, Any] = line_style(index)
            times = [each.wall for each in rows]
            largest = [each.largest_error for each in rows]
            panel.plot(times, largest, label=name, marker="o", markersize=3, **style)
            panel.plot(
                times,
                [each.median_error for each in rows],
                color=style["color"],
                marker=".",
                markersize=3,
                linestyle="none",
            )
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.margins(0.06)
        panel.set_title(TITLES.get(case, case))
        panel.set_xlabel(in_words(f"time for {results.of(case)[0].runs} runs", "s"))
        better: dict[str, Any] = {"xycoords": "axes fraction", "fontsize": "small"}
        panel.annotate("better ↙", (0.03, 0.04), color=ink(0.6), **better)
    panels[0].set_ylabel("error: largest (lines), median (dots)")
    _name(max(panels, key=lambda panel: len(panel.lines)), drawing)
    return drawing


def _name(panel: Axes, drawing: Figure) -> None:
    """Name the curves in a legend."""
    lines = [line for line in panel.lines if not str(line.get_label()).startswith("_")]
    add_legend(drawing, lines, [str(line.get_label()) for line in lines])


def rates(results: Results) -> dict[str, dict[str, float]]:
    """Runs per second of CPU time: by kind of loop, then by program."""
    ideal = {
        SAME.get(each.contender, each.contender): each.runs / each.cpu
        for each in results.of(CASE)
        if each.tolerance == results.headline[each.contender]
        and (each.contender in SAME or not each.contender.startswith("eqt"))
    }
    found = {"continuous law": ideal}
    for each in results.sampled:
        kind = f"sampled at {1 / each.period:g} Hz"
        found.setdefault(kind, {})[each.way] = each.runs / each.cpu
    return found


def runs_per_second(results: Results) -> Figure:
    """A row for each program, the fastest at the top, and a dot for each kind of loop."""
    found = rates(results)
    programs = {name for own in found.values() for name in own}
    ordered = sorted(programs, key=lambda name: max(own.get(name, 0.0) for own in found.values()))
    drawing = Figure(figsize=(WIDTHS["page"], 0.5 + 0.42 * len(ordered)), layout="constrained")
    panel = drawing.subplots()
    for index, (kind, own) in enumerate(found.items()):
        color = line_style(index)["color"]
        heights = [ordered.index(name) + 0.25 * (1 - index) for name in own]
        panel.plot(
            list(own.values()), heights, "o^sD"[index], color=color, markersize=4, label=kind
        )
        top = max(heights)
        for rate, height in zip(own.values(), heights, strict=True):
            number = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
            panel.annotate(
                f"{number}  {kind}" if height == top else number,
                (rate, height),
                (5, 0),
                textcoords="offset points",
                va="center",
                color=color,
                fontsize="small",
            )
    panel.set_xscale("log")
    panel.margins(x=0.3)  # room for the names of the loops
    panel.set_ylim(-0.5, len(ordered) - 0.5)
    panel.set_yticks(range(len(ordered)), ordered)
    panel.set_xlabel("runs of 20 s per second of CPU time (better →)")
    return drawing


def growth(results: Results) -> Figure:
    """Time and peak memory against the number of runs."""
    drawing = Figure(figsize=(WIDTHS["page"], 2.4), layout="constrained")
    time, memory = drawing.subplots(1, 2)
    for index, engine in enumerate(dict.fromkeys(each.engine for each in results.growth)):
        rows = [each for each in results.growth if each.engine == engine]
        runs = [each.runs for each in rows]
        style = line_style(index)
        time.plot(
            runs, [each.wall for each in rows], label=engine, marker="o", markersize=3, **style
        )
        memory.plot(
            runs, [each.peak_memory / 1e6 for each in rows], marker="o", markersize=3, **style
        )
    for panel, label in ((time, "time / s"), (memory, "peak memory / MB")):
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlabel("runs")
        panel.set_ylabel(label)
        panel.margins(0.06)
    time.legend()
    return drawing


def commands(results: Results) -> Figure:
    """CPU time of whole commands over that of the imports, now and before."""
    few = [each for each in results.commands if "thrusters" not in each.name]
    rows = [each for each in few if "," not in each.name][::-1]  # no large numbers of runs
    drawing = Figure(figsize=(WIDTHS["page"], 0.6 + 0.24 * len(rows)), layout="constrained")
    panel = drawing.subplots()
    trees = [tree for tree in (BEFORE, NOW) if any(tree in each.spent for each in rows)]
    for index, tree in enumerate(trees):
        ratios = [each.spent[tree].cpu / each.floor if tree in each.spent else 0 for each in rows]
        places = np.arange(len(rows)) + 0.4 * (0.5 * (len(trees) - 1) - index)
        panel.barh(places, ratios, 0.36, label=tree, color=line_style(index)["color"])
    panel.set_yticks(range(len(rows)), [each.name for each in rows])
    panel.margins(x=0.1)
    panel.set_xlabel("CPU time / that of importing NumPy, h5py and PyYAML")
    if len(trees) > 1:
        panel.legend()
    return drawing
