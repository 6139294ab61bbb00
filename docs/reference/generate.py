"""Writes into the pages of the documentation what the program knows: nothing is typed twice.

    python docs/reference/generate.py            write the pages (make reference)
    python docs/reference/generate.py --check    exit 1 where a page is not current (make docs)

What is written stands between `<!-- generated: NAME [ARGUMENTS] -->` and `<!-- end -->`. It is
committed, so that the pages can be read without a build.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

DOCS = Path(__file__).parents[1]
PART = re.compile(r"(<!-- generated: (\w+)((?: \w+)*) -->\n).*?(<!-- end -->)", re.S)
PARTS: dict[str, Callable[..., Iterable[str]]] = {}


def part(function: Callable[..., Iterable[str]]) -> Callable[..., Iterable[str]]:
    """A function that writes what stands in a page under its name."""
    PARTS[function.__name__] = function
    return function


def written(page: str) -> str:
    """A page with its generated parts as they should be."""
    return PART.sub(lambda found: f"{found[1]}{_text(found[2], found[3])}{found[4]}", page)


def _text(name: str, arguments: str) -> str:
    lines = "\n".join(PARTS[name](*arguments.split()))
    return re.sub(r"\n{3,}", "\n\n", f"\n{lines.strip()}\n\n")


def main(check: bool) -> int:
    """Write or check all pages."""
    stale = []
    for path in sorted(DOCS.glob("**/*.md")):
        page = path.read_text(encoding="utf-8")
        if (current := written(page)) == page:
            continue
        stale.append(path.relative_to(DOCS.parent).as_posix())
        if not check:
            path.write_text(current, encoding="utf-8")
    for name in stale:
        print(f"{name}: {'not current; run: make reference' if check else 'written'}")
    return int(check and bool(stale))


def table(header: list[str], rows: list[list[str]]) -> Iterator[str]:
    """A Markdown table."""
    yield ""
    yield f"| {' | '.join(header)} |"
    yield f"|{'---|' * len(header)}"
    for row in rows:
        cells = [" ".join(cell.split()).replace("|", "\\|") for cell in row]
        yield f"| {' | '.join(cells)} |"
    yield ""


def code(text: Any) -> str:
    """Text as code."""
    return f"`{text}`"


def escaped(text: str) -> str:
    """Running text from the program: formulas such as Ad*_V and L*_Q are no emphasis."""
    parts = re.split(r"(`[^`]*`)", re.sub(r"``([^`]*)``", r"`\1`", text))
    parts[::2] = [re.sub(r"([*_<$])", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


# Topics -------------------------------------------------------------------------------------------


@part
def topics() -> Iterator[str]:
    """What people have and want, with the command and the page."""
    from eqt_cli.extensions.topics.topics import topics as all_topics

    groups = dict[str, list[list[str]]]()
    for topic in all_topics():
        title = re.search("^# (.*)", (DOCS / topic.page.partition("#")[0]).read_text(), re.M)
        assert title
        link = f"[{title[1]}](../{topic.page})".replace("(../howto/", "(")
        row = [topic.have, topic.want, code(topic.command), link]
        groups.setdefault(topic.group, []).append(row)
    for group, rows in groups.items():
        yield from [f"## {group}", ""]
        yield from table(["I have", "and want", "command", "page"], rows)


# What laws read -----------------------------------------------------------------------------------


@part
def tracking() -> Iterator[str]:
    """The members of `Tracking`: its fields, then what follows from them."""
    from functools import cached_property

    from eqt_cli.components.mechanics import Tracking

    attributes = inspect.cleandoc(Tracking.__doc__ or "").partition("----------\n")[2]
    rows = []
    for names, meaning in re.findall(r"^(\S.*)\n((?:    .*\n?)+)", attributes, re.M):
        words, _, shape = names.partition(" : ")
        rows.append(
            [", ".join(map(code, words.split(", "))), code(shape) if shape else "", meaning]
        )
    for name, member in vars(Tracking).items():
        if isinstance(member, cached_property) and not name.startswith("_"):
            first = inspect.cleandoc(member.__doc__ or "").partition("\n\n")[0]
            rows.append([code(name), "", first])
    yield from table(["`s.` …", "shape", "is"], [[*row[:2], escaped(row[2])] for row in rows])


# Commands -----------------------------------------------------------------------------------------


@part
def commands() -> Iterator[str]:
    """Every command of `eqt` with its arguments and options; what many share, once."""
    import typer

    from eqt_cli.cli.app import app

    found = dict(_commands("eqt", typer.main.get_command(app)))
    counts = Counter(row for command in found.values() for row in _options_of(command))
    shared = [row for row, count in counts.items() if count >= MANY]
    yield "Many commands have these options:"
    yield from table(["option", "meaning"], [list(row) for row in shared])
    for path, command in found.items():
        yield from _command(path, command, shared)


MANY = 10
"""An option of so many commands is described once."""


def _commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    for name, child in getattr(command, "commands", {}).items():
        if hasattr(child, "commands"):
            yield from _commands(f"{path} {name}", child)
        else:
            yield f"{path} {name}", child


def _options_of(command: Any) -> list[tuple[str, str]]:
    return [
        (code(_flags(entry)), _help(entry))
        for entry in command.params
        if entry.param_type_name == "option"
        if entry.name != "help" and not getattr(entry, "hidden", False)
    ]


def _command(path: str, command: Any, shared: list[tuple[str, str]]) -> Iterator[str]:
    arguments = [entry for entry in command.params if entry.param_type_name == "argument"]
    options = _options_of(command)
    shown = [_metavar(entry) for entry in arguments]
    yield f"## {path}"
    yield ""
    yield escaped(inspect.cleandoc(command.help or ""))
    yield ""
    yield "```text"
    yield " ".join([path, *shown, "[OPTIONS]"])
    yield "```"
    rows = [[code(_metavar(entry)), _help(entry)] for entry in arguments]
    rows += [list(row) for row in options if row not in shared]
    if rows:
        yield from table(["argument or option", "meaning"], rows)
    if also := ", ".join(flags for flags, _ in filter(shared.__contains__, options)):
        yield ""
        yield f"Also: {also}."
        yield ""


def _metavar(entry: Any) -> str:
    text = (entry.metavar or entry.name).upper().strip("[]")
    return text if entry.required else f"[{text}]"


def _flags(entry: Any) -> str:
    flags = ", ".join(entry.opts)
    return flags if entry.is_flag else f"{flags} {entry.metavar or entry.name.strip('_').upper()}"


def _help(entry: Any) -> str:
    text = escaped(entry.help or "")
    fixed = entry.default is not None and not callable(entry.default) and entry.default is not False
    default = entry.default if entry.param_type_name == "option" and fixed else None
    return f"{text} Default: `{default}`." if default not in (None, (), []) else text


# Configuration ------------------------------------------------------------------------------------


@part
def configuration() -> Iterator[str]:
    """Every key of a configuration, from its JSON schema."""
    from eqt_cli.config.json_schema import default_of, described, json_schema, value_of

    schema = json_schema()
    required, entries = schema["required"], dict(schema["properties"])
    for section, keys in SECTIONS.items():
        yield f"## {section}"
        yield ""
        for key in keys.split():
            entry = entries.pop(key)
            default = default_of(key, entry, required)
            words = f"default {default}" if default.startswith("`") else default
            yield f"### {key}"
            yield ""
            yield f"{value_of(entry, schema).capitalize()}; {words}."
            yield ""
            yield escaped(described(entry, schema))
            yield ""
            yield from _members(entry, schema)
            if page := COMPONENTS.get(key):
                title = page.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
                yield f"Kinds and their options: [{title}]({page.name})."
                yield ""
    if entries:
        raise KeyError(f"keys without a section: {', '.join(entries)}")


SECTIONS = {
    "System": "name extends task group inertia rigid gains",
    "Desired motion": "reference target",
    "Laws": "controllers model",
    "Vehicle": "plant draws actuators control sensors estimator",
    "Runs": "initial ensemble time solver store",
    "Sweeps, searches and sliders": "sweep tune worst live",
    "Metrics": "measure settling_threshold failed_when early_window closing_window metrics",
    "Requirements": "windows require",
    "Flights": "validation",
    "Plugins": "plugins",
}
"""The keys of a configuration in the order of its page; a new key needs a section."""

COMPONENTS = {
    key: Path(__file__).with_name(f"{page}.md")
    for key, page in {
        "group": "groups",
        "reference": "references",
        "controllers": "laws",
        "plant": "forces",
        "actuators": "actuators",
        "sensors": "sensors",
        "estimator": "estimators",
        "initial": "starts",
        "solver": "engines",
        "sweep": "designs",
    }.items()
}


TASKS = ("point",)
"""Kinds that are no components."""


def _members(entry: dict[str, Any], schema: dict[str, Any]) -> Iterator[str]:
    """The keys of a mapping, or of each mapping that an entry may be."""
    from eqt_cli.config.json_schema import choices, default_of, dereferenced, described, value_of

    for option in choices(entry, schema):
        if "properties" not in option:
            continue
        kind = option["properties"].get("kind", {}).get("const")
        if kind and kind not in TASKS:
            continue  # a component; its kind has a page
        if option is not dereferenced(entry, schema):
            yield escaped(option.get("description", "").partition("\n")[0])
        rows = [
            [
                code(name),
                value_of(inner, schema),
                default_of(name, inner, option.get("required", [])),
                escaped(described(inner, schema)),
            ]
            for name, inner in option["properties"].items()
        ]
        yield from table(["key", "value", "default", "meaning"], rows)


# Components ---------------------------------------------------------------------------------------


@part
def components(kind: str, level: str = "2") -> Iterator[str]:
    """The components of one kind with their options, or the properties of every group.

    Without options of its own, a component takes a line; else a heading of this level.
    """
    from eqt_cli.base.registry import registry, summary

    if kind == "groups":
        yield from _groups()
        return
    rows = {component: _options(component) for component in registry(kind).all()}
    counts = Counter(row for own in rows.values() for row in own)
    everywhere = [row for row, count in counts.items() if count == len(rows) > 1]
    shared = [row for row, count in counts.items() if SEVERAL <= count < len(rows)]
    plain = not any(set(options) - set(everywhere) for options in rows.values())
    for words, common in (("All", everywhere), ("Several", shared)):
        if common:
            yield f"{words} of them have:"
            yield ""
            yield from _listed(common)
    for component, all_options in rows.items():
        if plain:
            yield f"- **{escaped(component.name)}**: {escaped(summary(component))}"
            continue
        yield f"{'#' * int(level)} {component.name}"
        yield ""
        yield escaped(summary(component))
        yield ""
        if also := ", ".join(row[0] for row in all_options if row in shared):
            yield f"Also: {also}."
            yield ""
        yield from _listed([row for row in all_options if row not in (*everywhere, *shared)])


SEVERAL = 2
"""An option of so many components that is the same in all of them is described once."""

Option = tuple[str, str, str, str]


def _listed(options: list[Option]) -> Iterator[str]:
    """A line for each option; those that share a description, such as bounds, have one line."""
    names: dict[Option, list[str]] = {}
    for name, *rest in options:
        names.setdefault(("", *rest), []).append(name)
    for (_, value, default, meaning), several in names.items():
        yield f"- {_shown(several, value, default, meaning)}: {meaning}"
    yield ""


def _shown(names: list[str], value: str, default: str, meaning: str) -> str:
    """``slope: 0.5``, or name and value; without a value that default or meaning tell."""
    value = value.replace("``, ", "")
    told = all(word in meaning for word in re.findall("`[^`]+`", value) or [value])
    if default.startswith("`") and default != "`''`":
        shown = ", ".join(f"{name[:-1]}: {default[1:]}" for name in names)
        told |= value in ("number", "whole number", "true or false", "mapping")
        return shown if told else f"{shown}, {value}"
    required = " (required)" if default == "required" else ""
    return ", ".join([*names, *([] if told else [value])]) + required


VALUES = {
    "number, mapping or list of numbers or mappings": "numbers",
    "number, mapping, list of numbers or mappings or list of lists of numbers or mappings": (
        "matrix"
    ),
    "number or mapping": "number",
    "list of numbers or mappings": "list",
    "list of numbers, text or mappings": "list of expressions",
    "`true`, `false`": "true or false",
}
"""Words of values, each number of which may be drawn; configuration.md explains them."""


def _options(component: type) -> list[Option]:
    """Name, value, default and meaning of each option."""
    from eqt_cli.config.json_schema import keys_of_component

    return [
        (
            code(each.key),
            VALUES.get(each.value, each.value),
            re.sub(r"\b([a-z]+)_: ", r"\1: ", each.default),
            " ".join(escaped(each.meaning).split()),
        )
        for each in keys_of_component(component)
        if "." not in each.key
    ]


@part
def laws() -> Iterator[str]:
    """A row for each law, to choose one by."""
    from eqt_cli.components.groups import group_named, groups
    from eqt_cli.components.laws import controllers, fits

    kept = json.loads(Path(__file__).with_name("exported_laws.json").read_text(encoding="utf-8"))
    operations = {each["law"]: str(each["operations"]) for each in kept if each["group"] == "SO3"}
    known = [group_named(name) for kind in groups.all() for name in kind.examples()]
    rows = []
    for kind in controllers.all():
        words = UNUSUAL.get(kind.name, {})
        if not kind.tasks and not words:
            raise KeyError(f"law {kind.name} needs a line in UNUSUAL")
        law = kind(**words.get("options", {})) if "groups" not in words else None
        fitting = [G for G in known if law and fits(law, G)]
        names = [G.name for G in fitting if "*" not in G.name]
        rows.append(
            [
                f"[{code(kind.name)}](#{kind.name})",
                words.get("groups") or ("all" if len(fitting) == len(known) else ", ".join(names)),
                words.get("reads") or _read(law, fitting[0]),
                words.get("gains") or _gains(law),
                words.get("source") or _authors(kind.bibtex),
                "L falls" if law and law.claims_decrease else "–",
                operations.get(kind.title, "–"),
            ]
        )
    header = ["law", "groups", "reads", "gains", "source", "claim", "operations"]
    yield from table(header, rows)


UNUSUAL: dict[str, dict[str, Any]] = {
    "b_dot": {
        "groups": "SO3, SE3",
        "reads": "magnetic field",
        "gains": "own",
        "source": "Stickler, Alfriend 1976",
    },
    "pid_cascade": {
        "groups": "SE3",
        "reads": "state, position, heading",
        "gains": "own",
        "source": "crazyflie-firmware",
    },
    "velocity_cascade": {
        "groups": "SE3",
        "reads": "state, position and its first two derivatives, heading",
        "gains": "own",
        "source": "PX4",
    },
    "cascade": {
        "groups": "SE2, SE3",
        "reads": "state, flat output",
        "gains": "own",
        "source": "Lee, Leok, McClamroch 2010",
    },
    "code": {
        "groups": "all",
        "reads": "arguments of the code",
        "gains": "of its law",
        "source": "your own",
    },
    "eqr": {"source": "–"},
    "indi": {
        "groups": "all",
        "reads": "what `law` reads, V before, accelerometer",
        "gains": "of `law`",
        "source": "Smeur, Chu, de Croon 2016",
    },
    "l1": {
        "groups": "all",
        "reads": "what `law` reads",
        "gains": "of `law`",
        "source": "Wu and others 2023",
    },
    "lqr": {"source": "–"},
    "network": {"groups": "all", "reads": "`observes`", "gains": "–", "source": "your own"},
    "observer": {"groups": "all", "reads": "what `law` reads", "gains": "of `law`", "source": "–"},
    "rate": {
        "options": {"kp": 1.0},
        "reads": "pose, Q\\_d, V\\_d",
        "source": "Brescianini, Hehn, D'Andrea 2013",
    },
    "replay": {"groups": "all", "reads": "a recording", "gains": "–", "source": "your own"},
}
"""Of laws that need options or name no source; a law without tasks has to be described here."""


def _read(law: Any, G: Any) -> str:
    memory = [name for name, length in law.memory(G).items() if length]
    return ", ".join(["state", "reference" if "track" in law.tasks else "target", *memory])


def _gains(law: Any) -> str:
    if not law.reads_gains:
        return "own"
    return "matched" if law.matched else "not matched"


def _authors(bibtex: str) -> str:
    """``Lee, Leok, McClamroch 2010``; the paper where there is no entry."""
    author = re.search(r"author *= *\{(.*?)\},\n", bibtex, re.S)
    year = re.search(r"year *= *\{(\d+)", bibtex)
    if not author or not year:
        return "the paper"
    names = [name.partition(",")[0] for name in author[1].split(" and ")]
    return f"{', '.join(names)} {year[1]}"


def _groups() -> Iterator[str]:
    from eqt_cli.base.registry import summary
    from eqt_cli.components.groups import group_named, groups

    rows = []
    for kind in groups.all():
        for name in kind.examples():
            group = group_named(name)
            axes = ", ".join(
                f"{', '.join(group.axis_names[part.axes])} ({part.velocity_unit})"
                for part in group.parts
            )
            size = f"{group.dimension}, {group.size}×{group.size}"
            rows.append([code(name), size, axes, escaped(summary(kind))])
    header = ["group", "m, d×d", "coordinates of V and their units", "what it is"]
    yield from table(header, rows)


# Variables ----------------------------------------------------------------------------------------

FIRST = "SO3"

SMALLEST = """\
name: smallest
group: {group}
inertia: 1
gains: {{kp: 1, kd: 1}}
reference: {{kind: constant}}
controllers: [eqt]
time: {{duration: 1, samples: 2}}
"""


@part
def variables(group: str) -> Iterator[str]:
    """Every variable of a result file on a group, from a file that `eqt run` has written.

    Of other groups than SO3, those that SO3 has not.
    """
    known: set[str] = set()
    if group != FIRST:
        with smallest_result(FIRST) as first:
            known = set(first.names)
    with smallest_result(group) as results:
        rows = [
            [
                code(name),
                ", ".join(map(code, results.dims(name))),
                results.units(name),
                escaped(results.long_name(name)),
            ]
            for name in results.names
            if name not in known
        ]
    yield from table(["variable", "dimensions", "units", "meaning"], rows)


@part
def metrics() -> Iterator[str]:
    """What controllers are compared by, from the table of quantities."""
    from eqt_cli.base.registry import summary
    from eqt_cli.results.metrics import METRICS

    rows = []
    for quantity in METRICS:
        over = "any" if quantity.windowed else str(quantity.window)
        stored = "yes" if quantity.stored else ""
        meaning = escaped(summary(quantity.of))
        rows.append(
            [code(quantity.name), quantity.described, meaning, over, quantity.better, stored]
        )
    yield from table(["name", "is", "formula", "window", "better", "stored"], rows)


MEANINGS = {
    "title": "name of the experiment",
    "group": "group; of a sweep over groups, all of them",
    "config": "configuration with every default written out, YAML, below its first comment",
    "plugins": "source of every plugin by its path, YAML",
    "digest": "SHA-256 of all that the numbers depend on",
    "experiment": "the loop, its laws and their names, as readers show them, JSON",
    "provenance": "versions, machine and times, JSON",
    "references": "the paper",
    "cross_check_method": "method that repeated some of the runs, and in which part of time",
    "cross_check_runs": "how many runs of each law it repeated",
    "cross_check_difference": "largest difference that it found",
    "cross_check_bound": "bound for this difference",
    "cross_check_law": "the law that differs most, where it is more than the bound",
}
"""Of the attributes of a result file; one that is new has to be described here."""


@part
def attributes() -> Iterator[str]:
    """The attributes of a result file."""
    with smallest_result("SO3") as results:
        unknown = set(results.attributes) - set(MEANINGS)
    if unknown:
        raise KeyError(f"attributes without a meaning: {', '.join(sorted(unknown))}")
    yield from table(["attribute", "meaning"], [[code(k), v] for k, v in MEANINGS.items()])


@cache
def _smallest(group: str, folder: str) -> Path:
    import eqt_cli

    return Path(eqt_cli.run(yaml.safe_load(SMALLEST.format(group=group)), Path(folder) / group))


FOLDER = tempfile.TemporaryDirectory()


@contextmanager
def smallest_result(group: str) -> Iterator[Any]:
    """The result of the smallest experiment on a group."""
    from eqt_cli.base.store_reader import open_results

    with open_results(_smallest(group, FOLDER.name)) as results:
        yield results


@part
def shipped_configurations() -> Iterator[str]:
    """The shipped configurations with their groups, laws and commands."""
    from eqt_cli.config import shipped
    from eqt_cli.config.document import read_config

    rows = []
    for name in shipped.names():
        data = read_config(shipped.folder() / f"{name}.yaml").data
        laws = [x if isinstance(x, str) else x.get("label", x["kind"]) for x in data["controllers"]]
        more = f", {len(laws) - 4} more" if len(laws) > 4 else ""
        command = next((x for x in ("tune", "worst", "sweep") if data.get(x)), "run")
        rows.append(
            [
                code(name),
                shipped.summary(name),
                str(data.get("group", "SO3")),
                ", ".join(map(code, laws[:4])) + more,
                code(f"eqt {command} {name}"),
            ]
        )
    yield from table(["configuration", "what it is", "group", "laws", "command"], rows)


@part
def statuses() -> Iterator[str]:
    """How a run can end."""
    from eqt_cli.base.stored import Status

    rows = [
        [str(status.value), status.name.lower().replace("_", " ")]
        for status in Status
        if status >= 0
    ]
    yield from table(["status", "meaning"], rows)


@part
def functions() -> Iterator[str]:
    """The functions of the expression grammar."""
    from eqt_cli.base.arrays import FUNCTIONS
    from eqt_cli.base.expressions import PIECEWISE

    yield ", ".join(map(code, [*FUNCTIONS, *(x for x in PIECEWISE if PIECEWISE[x].count == 1)]))
    yield ""
    yield "of one argument, and"
    yield ""
    for name, function in PIECEWISE.items():
        if function.count != 1:
            yield f"- {code(name)}: {function.takes.replace(chr(39), chr(96))}"


# The paper's equations ----------------------------------------------------------------------------


@part
def equations() -> Iterator[str]:
    """The table paper → program → test, from `equations.yaml`."""
    path = DOCS / "explanation" / "equations.yaml"
    entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    rows = [
        [
            escaped(entry["paper"]),
            escaped(entry["what"]),
            " ".join(f"{{py:obj}}`{_short(name)} <{name}>`" for name in entry["code"]),
            " ".join(code(test.rpartition("::")[2]) for test in entry["tests"]),
        ]
        for entry in entries
    ]
    yield from table(["paper", "what", "in eqt", "test"], rows)


@part
def proofs() -> Iterator[str]:
    """What `eqt verify --exact` proves of every shipped configuration."""
    from eqt_cli.config import shipped
    from eqt_cli.config.document import read_config
    from eqt_cli.config.study import study, without_sweep
    from eqt_cli.extensions.proofs.certificates import Verdict
    from eqt_cli.extensions.proofs.verification import identities_of

    lines: list[list[str]] = []
    known: dict[tuple[str, str], list[Any]] = {}
    for path in sorted(shipped.folder().glob("*.yaml")):
        experiment = study(without_sweep(read_config(path, []))).base
        first = next(iter(experiment.loops.values()))
        place = f"{experiment.group.name} {type(first.inertia)} {first.vehicle.is_ideal}"
        # The states of a proof are free, so that equal laws on one group have equal proofs.
        laws = {label: (place, repr(loop.controller)) for label, loop in experiment.loops.items()}
        of_none = place, repr(first.reference)
        new = [label for label, key in laws.items() if key not in known]
        if new or of_none not in known:
            loops = {label: experiment.loops[label] for label in new or laws}
            found = identities_of(replace(experiment, loops=loops), exact=True)
            for label, key in {"": of_none, **{label: laws[label] for label in loops}}.items():
                known[key] = [row for row in found if row.controller == label]
        rows = [row for key in (of_none, *laws.values()) for row in known[key]]
        proved = [row for row in rows if row.verdict is Verdict.PROVED]
        others = [row.name for row in rows if row.not_proved]
        degrees = [row.degree for row in proved]
        lines.append(
            [
                code(path.stem),
                str(len(proved)),
                f"{min(degrees)} to {max(degrees)}",
                f"{max(row.probability for row in proved):.0e}",
                str(len(others)),
            ]
        )
    yield from table(["configuration", "proved", "degree", "largest p", "not proved"], lines)


@part
def exported_laws() -> Iterator[str]:
    """What exported laws cost, as `measure_laws.py` has measured it."""
    kept = Path(__file__).with_name("exported_laws.json")
    rows = []
    for each in json.loads(kept.read_text(encoding="utf-8")):
        cells = [each["law"], each["group"], str(each["operations"])]
        for real in ("float", "double"):
            flash, stack, bound = (each[real][name] for name in ("flash", "stack", "bound"))
            cells += [str(flash), str(stack), f"{bound:.1e}"]
        rows.append(cells)
    header = ["law", "group", "operations"]
    for real in ("float", "double"):
        header += [f"flash, {real}", f"stack, {real}", f"bound, {real}"]
    yield from table(header, rows)


@part
def purposes() -> Iterator[str]:
    """Purposes of extensions: the function, and what it is for."""
    from eqt_cli.base import purposes as stated
    from eqt_cli.base.extensions import Every, Purpose

    rows = []
    for name, purpose in vars(stated).items():
        if isinstance(purpose, Purpose):
            signature = inspect.signature(purpose.signature)
            arguments = ", ".join(x for x in signature.parameters)
            returns, _, used = str(purpose.signature.__doc__).partition("; ")
            many = "any number" if isinstance(purpose, Every) else "one"
            rows.append([f"`{name}({arguments})`", returns.rstrip("."), used.rstrip("."), many])
    yield from table(["purpose", "the function", "used by", "extensions"], rows)


@part
def extend() -> Iterator[str]:
    """The names of `eqt_cli.extend`, in the groups in which its modules define them."""
    import eqt_cli.extend
    from eqt_cli.base.extensions import places

    names: dict[str, list[str]] = {}
    for name, module in sorted(places(eqt_cli.extend.__name__).items()):
        names.setdefault(module, []).append(name)
    rows = [
        [" ".join(map(code, found)), escaped(_first_sentence(import_module(module)))]
        for module, found in sorted(names.items())
    ]
    yield from table(["names", "what they are about"], rows)


@part
def stable() -> Iterator[str]:
    """The functions of `eqt_cli` that stay, with the page that describes each."""
    import eqt_cli

    rows, folder = [], DOCS / "reference" / "api"
    for name, module in eqt_cli.STABLE.items():
        value = getattr(eqt_cli, name)
        if inspect.isfunction(value):
            of = re.compile(rf"{module}\.{name}$|{module}\n   :members:.*\b{name}\b", re.M)
            (page,) = [path for path in folder.glob("*.md") if of.search(path.read_text("utf-8"))]
            rows.append([f"[{code(name)}]({page.name})", _summary(value)])
    yield from table(["function", "what it does"], rows)


@part
def summaries(page: str) -> Iterator[str]:
    """The names of a page of the Python API, which a forge can show: with arguments and meaning."""
    text = (DOCS / "reference" / "api" / f"{page}.md").read_text(encoding="utf-8")
    rows = []
    for kind, path, options in re.findall(DIRECTIVE, text, re.M):
        module, _, function = path.rpartition(".") if kind == "function" else (path, "", "")
        found = import_module(module)
        members = re.search(r":members: *(\S.*)", options)
        names = members[1].split(", ") if members else [function] if function else _public(found)
        rows += [
            [code(f"{name}{_arguments(getattr(found, name))}"), _summary(getattr(found, name))]
            for name in names
        ]
    yield from table(["name", "what it is"], rows)


DIRECTIVE = r"^\.\. auto(module|function):: (\S+)\n((?: +:.*\n)*)"


def _public(module: Any) -> list[str]:
    """The functions and classes that a module defines, in their order."""
    return [
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "") == module.__name__
        if inspect.isfunction(value) or inspect.isclass(value)
    ]


def _arguments(value: Any) -> str:
    """The names of the arguments of a function; of a class, nothing."""
    if inspect.isclass(value):
        return ""
    return f"({', '.join(inspect.signature(value).parameters)})"


def _summary(value: Any) -> str:
    return escaped((inspect.getdoc(value) or "").partition("\n")[0])


def _first_sentence(module: Any) -> str:
    return re.split(r"[;.]", (module.__doc__ or "").strip())[0]


def _short(name: str) -> str:
    """``Semidirect.Ad`` for a method, ``gradient`` for a function."""
    *_, owner, last = name.split(".")
    return f"{owner}.{last}" if owner[0].isupper() else last


if __name__ == "__main__":
    sys.exit(main(check="--check" in sys.argv))
