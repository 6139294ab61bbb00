"""The experiment in words, its runs as tables, and stored runs in a few bytes; it knows no page."""

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from operator import attrgetter
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import shares
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import ComponentError
from eqt_cli.base.option_types import option_names
from eqt_cli.base.registry import summary
from eqt_cli.base.reporting import count_of, listed
from eqt_cli.base.stored import MIXED, SIGNALS
from eqt_cli.base.yaml_source import heading
from eqt_cli.components.groups import known_group
from eqt_cli.components.laws import Member, controllers
from eqt_cli.engines.engine import SolverChecks, engines
from eqt_cli.figures.shown import looks as looks_of
from eqt_cli.figures.style import house_style, line_style
from eqt_cli.results.metrics import QUANTITIES
from eqt_cli.results.quantity import FLOAT, ValuePer
from eqt_cli.results.result import Result, meaning_of
from eqt_cli.results.summary import key_in_words, unit_in_words
from eqt_cli.results.timing import timing_lines

MOST_ROWS = 8000
"""Maximum number of rows, controllers times runs; failed runs are kept before good ones."""

Document = dict[str, Any]


LEFT_OUT = "peak_attitude_error"
"""A number that the table of runs has no room for on a usual screen; files and requirements do."""


def run_table(result: Result) -> Document:
    """Return columns with names and units, and a row per law and run.

    Returns
    -------
    dict
        ``item``, what a row is about; ``columns`` with a value in any run; ``rows`` of controller,
        run, status and numbers, where null is a missing one; ``controllers``, as the page writes
        them, and their ``labels``, as a program reads them; ``total``, the number of all rows;
        ``messages`` of failed runs by row.
    """
    names = [name for name in column_names(result) if np.isfinite(result[name]).any()]
    names = [name for name in names if name != LEFT_OUT]
    status = result.status
    order = np.argwhere(np.ones_like(status))
    order = order[np.argsort(status[tuple(order.T)] == 0, kind="stable")][:MOST_ROWS]
    order = order[np.lexsort(order.T[::-1])]
    values = [result[name] * result.factor(name) for name in names]
    failed = order[status[tuple(order.T)] != 0]
    messages = result.messages(failed) if len(failed) and result.has("message") else []
    return {
        "item": "run",
        "columns": columns(result, names),
        "controllers": result.titles,
        "labels": result.labels,
        "rows": [
            [int(c), int(r), meaning_of(int(status[c, r])), *(plain(of[c, r]) for of in values)]
            for c, r in order
        ],
        "messages": {f"{c}-{r}": said for (c, r), said in zip(failed, messages, strict=False)},
        "total": int(status.size),
    }


def column_names(result: Result) -> list[str]:
    """Return the metrics that a page shows of a run, split into parts with units of their own.

    `eqt show --table metrics` also prints the diagnostics; a page is not wide enough for all.
    """
    return [
        part
        for row in QUANTITIES.values()
        if row.per is ValuePer.RUN and row.stored and row.dtype is FLOAT and row.rank >= 0
        if result.has(row.name)
        for part in result.in_parts(row.name)
    ]


def columns(result: Result, names: Sequence[str]) -> list[Document]:
    """Return the heads of columns: metric, description, and unit unless it is a pure number.

    ``better`` says which values are better; empty if neither are.
    """
    quantities = [result.quantity(name) for name in names]
    return [
        {
            "metric": name,
            "name": quantity.described,
            "unit": unit_in_words(result, name),
            "better": "" if quantity.better == "neither" else quantity.better,
        }
        for name, quantity in zip(names, quantities, strict=True)
    ]


def plain(value: float) -> float | None:
    """Round a number to six significant digits; None for NaN and infinity."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


SAMPLES = 101
"""Maximum number of samples of a run that are kept."""

LARGEST = 1_400_000
"""Maximum number of bytes of all curves in the page; further runs are omitted."""

POWER = 4
"""Root of the rounding scale: on 4th roots, small values keep their relative accuracy."""

LEVELS = 65534
"""Code of the largest value; the next code marks a missing value."""


def curves(result: Result) -> Document | None:
    """Return the data for drawing runs; None if the result holds no trajectories.

    Returns
    -------
    dict
        ``times``, ``runs``, ``stored`` (how many runs there are), ``controllers`` with their line
        styles, and ``panels``: name, unit, largest value, and codes of 16 bits, little endian, by
        controller, run and sample, in base 64.
    """
    stored, times = result.stored_runs, result.times
    if not stored.size:
        return None
    names = []
    for signal in sorted(SIGNALS.values(), key=attrgetter("rank")):
        if signal.rank and result.has(signal.name):
            parts = result.parts(signal.name) if result.units(signal.name) == MIXED else []
            names += [f"{signal.name}_{part}" for part in parts] or [signal.name]
    samples = np.unique(np.linspace(0, len(times) - 1, SAMPLES).round().astype(int))
    per_run = len(names) * len(result.labels) * len(samples) * 2 * 4 / 3
    runs = slice(0, min(len(stored), max(1, int(LARGEST / per_run))))
    chosen = {result.run_dimension: runs, "time": samples.tolist()}
    panels = []
    for head in columns(result, names):
        values = result.read(head["metric"], **chosen) * result.factor(head["metric"])
        if head["metric"] == "lyapunov":  # not of laws that do not claim that it falls
            values[[result.labels.index(label) for label in result.without_function]] = np.nan
        codes, largest = quantised(values)
        text = b64encode(codes.astype("<u2").tobytes()).decode("ascii")
        panels.append({**head, "largest": largest, "codes": text})
    return {
        "times": [round(float(t), 6) for t in times[samples]],
        "runs": stored[runs].tolist(),
        "stored": len(stored),
        "samples": len(times),
        "controllers": looks(result),
        "power": POWER,
        "levels": LEVELS,
        "panels": panels,
    }


def quantised(values: Array) -> tuple[Array, float]:
    """Return codes of nonnegative values, and the value of the largest code."""
    finite = np.isfinite(values)
    largest = float(np.max(values, initial=0.0, where=finite)) or 1.0
    scaled = np.where(finite, np.clip(values, 0, largest), 0) / largest
    codes: Array = np.where(finite, np.rint(LEVELS * scaled ** (1 / POWER)), LEVELS + 1)
    return codes, largest


def looks(result: Result) -> list[Document]:
    """Return label, title, colour and dashes of every controller, as in the figures."""
    with house_style():
        styles = [line_style(look) for look in looks_of([result], [range(len(result.labels))])]
    return [
        {
            "label": label,
            "title": title,
            "colour": style["color"],
            "dashes": [] if style["linestyle"] == "-" else list(style["linestyle"][1]),
        }
        for label, title, style in zip(result.labels, result.titles, styles, strict=True)
    ]


_FOLDERS = re.compile(
    r"(?<![^\s'\"=])(~[^\s/\\]*|[A-Za-z]:|\.\.)?[/\\]([^\s'\"/\\]+[/\\])*(?=[^\s/\\])"
)
"""What stands before the name of a file that is not below the folder of the command."""

_WHOLE = 1e9
"""Whole numbers below this are written with all their digits."""
MOST_VALUES = 12
"""Maximum length of a list that is written out; the lines of a search have hundreds."""

_ASIDE = re.compile(r"(, on every group)?[;:] .*| \(the paper.*|(, on every group)?\.$", re.DOTALL)
"""What follows in the first line on a law: where it holds, and where it stands in the paper."""

PARTS = ("target", "plant", "control", "actuators", "sensors", "estimator")
"""Sections of a configuration that are stated by their keys."""


def laws(result: Result) -> list[Document]:
    """Return the laws in the order of the result.

    Returns
    -------
    list of dict
        ``title`` in figures, ``label`` in tables, and ``kind`` in the configuration; ``says``, the
        first line of its documentation, empty for a law of a plugin, and ``short``, the part of it
        that says what the title stands for; of a member of the family the ``weights`` (g, c, n, q)
        and the frame of its ``damping``; ``settings``, gains and options of this law alone, as
        running text.
    """
    settings = {}
    for entry in result.config.get("controllers") or []:
        if isinstance(entry, Mapping):
            gains = in_words(entry.get("gains"))
            options = {k: x for k, x in entry.items() if k not in ("kind", "label", "gains")}
            words = [f"gains: {gains}" if gains else "", in_words(options)]
            settings[entry.get("label")] = "; ".join(filter(None, words))
    rows = []
    for label, title in result.title_of.items():
        kind = result.kinds[label]
        row: Document = {"title": title, "label": label, "kind": kind, "says": "", "short": ""}
        row |= {"weights": [], "damping": "", "settings": settings.get(label, "")}
        with suppress(ComponentError):  # law of a plugin that is not loaded here
            law = controllers.get(kind)
            row["says"] = summary(law)
            row["short"] = _ASIDE.sub("", row["says"])
            # Members with body errors have another formula, given in their summary.
            if issubclass(law, Member) and law.error == "spatial":
                weights = law.gyroscopic, law.transport, law.connection, law.quadratic
                row["weights"] = [f"{weight:g}" for weight in weights]
                row["damping"] = str(law.damping)
        rows.append(row)
    return rows


def stated_values(result: Result) -> list[tuple[str, str, str | list[list[str]]]]:
    """Return the sections of the stored configuration, ordered as in a paper's section.

    Each has a name, a symbol, and its value in words, or as the rows of a matrix.
    """
    config, group = result.config, known_group(result.group_name)
    if not config:
        return []
    gains, initial, runs, time = (
        config.get(key) or {} for key in ("gains", "initial", "ensemble", "time")
    )
    duration, samples = in_words(time.get("duration")), in_words(time.get("samples"))
    others = [
        ("Reference", "Q_d", config.get("reference")),
        *((key.capitalize(), "", config.get(key)) for key in PARTS),
        ("Initial poses", "Q(0)", initial.get("pose")),
        ("Initial velocities", "V(0)", initial.get("velocity")),
        ("Initial states", "", initial.get("file")),
        ("Runs", "", f"{result.runs} of each law, from seed {runs.get('seed', 0)}"),
        ("Time", "", f"{duration} s, {samples} samples"),
        ("Integration", "", _used(config.get("solver") or {})),
        ("Sweep", "", config.get("sweep")),
    ]
    return [
        ("Group", "", f"{_group(result)}: {summary(type(group))}" if group else ""),
        ("Inertia", "𝕀", _tensor(config.get("inertia"))),
        ("Weight of the navigation function", "K", _tensor(gains.get("kp"))),
        ("Damping", "K_d", _tensor(gains.get("kd"))),
        *((name, symbol, in_words(value)) for name, symbol, value in others),
    ]


def _used(solver: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the keys of `solver` that its engine uses; a result stores those of all engines."""
    try:
        engine = engines.get(solver["engine"])
    except (KeyError, ComponentError):  # engine of a plugin that is not loaded here
        return solver
    options = ("engine", *option_names(engine), *option_names(SolverChecks))
    return {key: value for key, value in solver.items() if key in options}


def _tensor(value: Any) -> str | list[list[str]]:
    """State a tensor: a number is a multiple of the identity, a list a diagonal."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [[in_words(entry) for entry in row] for row in value]
    if isinstance(value, list):
        return f"diag{in_words(value)}"
    return f"{in_words(value)} · I" if _is_number(value) else in_words(value)


def in_words(value: Any) -> str:
    """Return a value of a configuration as running text; empty for None.

    ``{kind: normal, std: 1.0}`` becomes ``normal: std 1``, and ``[0.0, 1]`` becomes ``(0, 1)``.
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if _is_number(value):
        number = f"{value:.6g}"
        if abs(value) < _WHOLE and value == int(value):
            number = str(int(value))
        return number.replace("3.14159", "π").replace("-", "−")
    if isinstance(value, list):
        parts = [in_words(entry) for entry in value]
        if len(parts) > MOST_VALUES:
            ends = [*parts[: MOST_VALUES // 2], "…", parts[-1]]
            return f"{len(parts)} values {_tuple(ends)}"
        return "; ".join(parts) if any(isinstance(e, dict) for e in value) else _tuple(parts)
    if isinstance(value, Mapping):
        named = {key: in_words(entry) for key, entry in value.items() if key != "kind"}
        options = ", ".join(
            f"{key.replace('_', ' ')} {said}".strip()
            for key, said in named.items()
            if said or value[key] == {}  # a case that changes nothing
        )
        return ": ".join(filter(None, [str(value.get("kind", "")), options]))
    return str(value)


def _tuple(parts: list[str]) -> str:
    return f"({', '.join(parts)})"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def point_table(result: Result) -> Document:
    """Return a table with a row per law and point: the swept values, and means over runs.

    Its layout is that of `run_table`. A point with failed runs has no means, and its row counts
    them. Times beyond the horizon in some run have no mean either: the share of settled runs
    replaces them.
    """
    keys = result.swept_keys
    names = [name for name in column_names(result) if not result.censored(name).any()]
    means = np.stack([result.means(name) for name in names], axis=-1)
    counts = [name for name in names if result.quantity(name).counts]
    ends = [shares(result.metric(name))[..., 1:] for name in counts]
    means = np.concatenate([means, *ends], axis=-1)
    failed = np.count_nonzero(result.status, axis=-1)
    points, controllers = failed.shape
    order = [(c, p) for p in range(points) for c in range(controllers)]
    order = sorted(order, key=lambda row: failed[row[1], row[0]] == 0)[:MOST_ROWS]
    return {
        "item": "point",
        "columns": [
            *(_head("", *key_in_words(result, key)) | {"given": True} for key in keys),
            *columns(result, names),
            *(
                _head(
                    f"{name}_{end}", f"{result.quantity(name).described}, {end} end of its interval"
                )
                for name in counts
                for end in ("low", "high")
            ),
        ],
        "controllers": result.titles,
        "labels": result.labels,
        "rows": [
            [
                c,
                p,
                f"{failed[p, c]} of {result.runs} failed" if failed[p, c] else "ok",
                *(key.named(p) for key in keys),
                *map(plain, means[p, c]),
            ]
            for c, p in sorted(order)
        ],
        "messages": {},
        "total": points * controllers,
    }


def _head(metric: str, name: str, unit: str = "") -> Document:
    """Return the head of a column without a better direction."""
    return {"metric": metric, "name": name, "unit": unit, "better": ""}


def facts(result: Result, author: str = "", date: str = "") -> list[str]:
    """Return what the line below the title says of an experiment, piece by piece."""
    keys = listed([swept_key.key for swept_key in result.swept_keys] or ["nothing"])
    lasting = f" of {result.horizon:g} s" if result.horizon else ""
    solver, version = _used(result.config.get("solver") or {}), result.provenance.get("eqt")
    failed = len(result.failures)
    pieces = [
        author,
        _group(result),
        count_of(len(result.labels), "law"),
        f"{result.points} points over {keys}" if result.is_sweep else "",
        f"{count_of(result.runs, 'run')}{lasting}{' each' if len(result.labels) > 1 else ''}",
        f"{count_of(failed, 'run')} failed" if failed else "",
        " ".join(str(solver[key]) for key in ("engine", "method") if key in solver),
        date or day(result),
        f"eqt {version}" if version else "",
    ]
    return [piece for piece in pieces if piece]


def _group(result: Result) -> str:
    """Return the group as it is written in a paper: ``SO(3)`` for SO3."""
    name = result.group_name.replace("SE23", "SE₂(3)")
    return re.sub(r"\b(S[OE])(\d)\b", r"\1(\2)", name) or "a group"


def called(result: Result) -> str:
    """Return the sentence that opens the configuration, or else ``paper: EqT and GT on SO(3)``."""
    if sentence := heading(str(result.attributes.get("config", ""))):
        return sentence
    many = len(result.titles) > MOST_VALUES // 2
    named = f"{len(result.titles)} laws" if many else listed(result.titles)
    return f"{result.title}: {named} on {_group(result)}"


def day(result: Result) -> str:
    """Return the day of the run, such as ``2026-11-22``; empty if unknown."""
    with suppress(ValueError):
        return datetime.fromisoformat(result.provenance.get("started", "")).date().isoformat()
    return ""


def accuracy(result: Result) -> Iterator[str]:
    """Yield sentences on the accuracy of the numbers."""
    yield from _energy(result)
    values = result.metric("error_estimate") if "error_estimate" in result.metrics else np.array([])
    estimates = values[np.isfinite(values)]
    if estimates.size:
        yield (
            "Global error, estimated run by run from a tighter solve: largest "
            f"{estimates.max():.2g}, median {np.median(estimates):.2g}."
        )
    if result.cross_check is not None:
        yield f"C{result.cross_check.described[1:]}."
    yield from (f"{line}." for line in timing_lines(result))


def _energy(result: Result) -> Iterator[str]:
    """Yield the residual of the energy balance, for the laws that claim one."""
    if "energy_residual" not in result.metrics:
        return
    residuals = {
        title: result.metric("energy_residual", c)[result.good[..., c, :]]
        for c, title in enumerate(result.titles)
    }
    valid = {title: values[np.isfinite(values)] for title, values in residuals.items()}
    balanced = [title for title, values in valid.items() if values.size]
    if not balanced:
        return
    largest = max(valid[title].max() for title in balanced)
    others = [title for title, values in residuals.items() if values.size and not valid[title].size]
    whose = f" of {listed(balanced)}; no balance is claimed for {listed(others)}" if others else ""
    yield (
        f"Energy balance: |L(t) + ∫dissipation − L(0)| stays below {largest:.1g} of L(0) "
        f"in every run{whose}."
    )


def provenance(result: Result) -> list[tuple[str, str]]:
    """Return the provenance as names and values."""
    attributes, origin = result.attributes, result.provenance
    rows = [(str(name), _words(value, origin)) for name, value in origin.items() if value]
    for name, key in (("digest", "digest"), ("theory", "references")):
        rows.append((name, str(attributes.get(key, ""))))
    return [(name, words) for name, words in rows if words]


def _words(value: Any, origin: dict[str, Any]) -> str:
    """Return a value in words without folders of the author; of other sessions, what differs."""
    if not isinstance(value, list):
        return _FOLDERS.sub("", str(value))
    sessions = [session.items() for session in value if isinstance(session, dict)]
    return "; ".join(
        ", ".join(f"{name} {version}" for name, version in session if origin.get(name) != version)
        for session in sessions
    )
