"""Exports laws as C: headers, sources, checks and the README."""

import math
import os
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Literal

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from eqt_cli.api.loading import Configuration, experiment_at
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, printable
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.base.files import check_targets, write_all
from eqt_cli.base.registry import meanings
from eqt_cli.base.version import __version__
from eqt_cli.components.laws import claims
from eqt_cli.config.remarks import remark_on
from eqt_cli.config.study import Study
from eqt_cli.extensions.export.export_laws import CHECK, TOLERANCE, ExportedLaw, exported
from eqt_cli.extensions.export.program_error import ARITHMETICS, DOUBLE, Arithmetic
from eqt_cli.loop.law_program import (
    INPUT,
    MEMORY,
    NUMBER,
    OUTPUT,
    PERIOD,
    TORQUE,
    Entry,
    name_of_number,
)
from eqt_cli.numbers.c_code import c_function
from eqt_cli.numbers.c_headers import PRELUDE, defined, headers, needed
from eqt_cli.numbers.program import Program
from eqt_cli.numbers.rounded import evaluated
from eqt_cli.runs.description import description, loop_in_words

# The files of an exported law: its header, its source, and the program that checks them -----------


WIDTH = 100


@cache
def _environment() -> Environment:
    """Return the environment of the templates, in which ``${…}`` is a value."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        undefined=StrictUndefined,
        variable_start_string="${",
        variable_end_string="}",
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    functions: list[Callable[..., str | list[str]]] = [
        *(above, apart_in_words, bounds_in_words, braced, comment, declared, default, emitted),
        *(indented, markdown, meaning, measurements, row, wrapped),
    ]
    environment.globals |= {function.__name__: function for function in functions}
    environment.globals |= {
        "version": __version__,
        "tolerance": TOLERANCE,
        "meanings": INPUT_MEANINGS,
    }
    return environment


def filled(template: str, **values: object) -> str:
    """Return a template with values for its names."""
    return _environment().get_template(template).render(values)


def of_law(template: str, law: ExportedLaw, **values: object) -> str:
    """Return a template about a law."""
    size = law.program.torque.size
    return filled(template, law=law, label=law.name, real=law.by.name, m=size, **values)


def number(value: float, by: Arithmetic) -> str:
    """Return the shortest text that a compiler reads as exactly this number."""
    if by.name == "double":
        return repr(float(value))
    text = str(np.float32(value))
    return f"{text if '.' in text or 'e' in text else text + '.0'}f"


def braced(values: Iterable[float], by: Arithmetic) -> str:
    """Return an array in C."""
    return f"{{{', '.join(number(value, by) for value in values)}}}"


def initialiser(values: Array, entry: Entry, by: Arithmetic) -> str:
    """Return the values of an entry in C: a number, or an array row by row."""
    flat = values.ravel()
    return braced(flat, by) if entry.shape else number(flat[0], by)


def wrapped(text: str, indent: str, first: str = "") -> str:
    """Return text broken into lines at spaces."""
    return textwrap.fill(
        text,
        WIDTH,
        initial_indent=first or indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def indented(text: str) -> str:
    """Return a text for a comment that has three spaces before it."""
    return wrapped(text, " " * 3).lstrip()


def comment(text: str) -> str:
    """Return a text for a comment, without marks that begin or end one."""
    return printable(text).replace("*/", "* /").replace("/*", "/ *").replace("\\", "\\ ")


def markdown(text: str) -> str:
    """Return a text for Markdown, without marks that format it, link or begin HTML."""
    return re.sub(r"[\\`*_\[\]<>&|~$#!]", r"\\\g<0>", printable(text))


def declared(fields: Sequence[tuple[str, str, str]]) -> str:
    """Return the fields of a structure, given by type, declaration and meaning."""
    lines = []
    width = max(len(f"{kind} {name};") for kind, name, _ in fields)
    for kind, name, meaning in fields:
        text = f"    {f'{kind} {name};':{width}} /* {comment(meaning)} */"
        lines.append(
            wrapped(text.strip(), " " * (8 + width), "    ") if len(text) > WIDTH else text
        )
    return "\n".join(lines)


def above(value: float) -> str:
    """Return a bound in two digits, rounded up."""
    if not value > 0 or not math.isfinite(value):
        return f"{value:g}"
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / scale) * scale:.2g}"


def row(values: Array) -> str:
    """Return doubles as an array in C on one line."""
    return braced(values, DOUBLE)


EXAMPLES = 32
"""Number of states in the program that checks a law, evenly spread."""

WORST = 4
"""Number of further states: the largest bounds away from singularities; and as many near them."""

INPUT_MEANINGS = {
    "t": "time",
    "pose": "Q, the pose as it was measured",
    "velocity": "V, the body velocity as it was measured",
    "desired_pose": "Q_d",
    "desired_velocity": "V_d",
    "desired_acceleration": "the rate of V_d",
    "position": "p_d and its first four derivatives, in space",
    "heading": "the heading and its first two derivatives",
    "flux": "B, the magnetic field in the body as it was measured",
    "specific_force": "the acceleration less gravity in body axes, as an accelerometer gives it",
}

NUMBER_MEANINGS = {
    "inertia": "the inertia tensor: momentum P = inertia V",
    "inertia_inverse": "its inverse: change both together",
    "kp": "gains.kp, the weight K of the navigation function",
    "kd": "gains.kd, the Rayleigh tensor: damping force per velocity",
}


def files(law: ExportedLaw) -> dict[str, str]:
    """Return the text of each file, by name."""
    return {
        f"{law.name}.h": header(law),
        f"{law.name}.c": source(law),
        f"{law.name}{CHECK}.c": check(law),
    }


def header(law: ExportedLaw) -> str:
    """Return the header: types and functions, with the bounds of the errors."""
    program = law.program
    states = [
        _field(law.by, entry, f"the state {entry.source} of the law") for entry in program.memory
    ]
    of_filter = {}
    if law.filter:
        options = meanings(type(law.filter.estimator))
        words = {
            "measured": [
                (x, "; ".join(filter(None, (x.unit, x.source)))) for x in law.filter.measured
            ],
            "options": [(x, options.get(x.name, "")) for x in law.filter.numbers],
            "states": [(x, x.name.replace("_", " ")) for x in law.filter.states],
        }
        of_filter = {
            structure: [(law.by.name, f"{x.name}[{x.size}]", said) for x, said in entries]
            for structure, entries in words.items()
        }
    return of_law(
        "law.h",
        law,
        input=[_field(law.by, entry, INPUT_MEANINGS[entry.source]) for entry in program.inputs],
        numbers=[_field(law.by, number, meaning(law, number)) for number in program.numbers],
        memory=states or [(law.by.name, "unused", "the law has no memory")],
        outputs=[
            _field(law.by, output, f"{output.source} of the law") for output in program.outputs
        ],
        **of_filter,
    )


def bounds_in_words(law: ExportedLaw) -> str:
    """Return the bound of each torque and its unit: ``x 1.2e-15, y …; N m``."""
    pairs = zip(law.loop.group.axis_names, law.torque_bound, strict=True)
    listed = ", ".join(f"{axis} {above(bound)}" for axis, bound in pairs)
    return f"{listed}; {law.program.torque.unit}"


def apart_in_words(law: ExportedLaw) -> str:
    """Return a sentence on the bounds near singularities."""
    count = int(np.count_nonzero(law.singular))
    if not count:
        return (
            "No state is near a singularity, such as a half turn, where a divisor or a choice "
            "loses more than ten bits."
        )
    worst = float(law.singular_bound.max())
    bound = f"the bound is up to {above(worst)}" if np.isfinite(worst) else "there is no bound"
    return (
        f"{count} of the states are counted apart: they are near a singularity, such as a half "
        f"turn, where a divisor or a choice loses more than ten bits; there {bound}."
    )


def meaning(law: ExportedLaw, entry: Entry) -> str:
    """Return the meaning of a number."""
    if entry.source == PERIOD:
        return "by which the memory advances" if law.program.memory else "not used: no memory"
    name = name_of_number(entry.source)
    last = name.rpartition(".")[2]
    said = NUMBER_MEANINGS.get(name) or meanings(type(law.owner(entry))).get(last, "")
    return f"fixed by the law; leave it. {said}".strip() if entry.name in law.fixed else said


def _field(by: Arithmetic, entry: Entry, said: str) -> tuple[str, str, str]:
    size = f"[{entry.size}]" if entry.shape else ""
    return by.name, f"{entry.name}{size}", "; ".join(part for part in (entry.unit, said) if part)


# The source ---------------------------------------------------------------------------------------


def source(law: ExportedLaw) -> str:
    """Return the source: the functions of the law."""
    program, name = law.program, law.name
    step, start = emitted(program.step, f"{name}_step"), ""
    starting = ["(void)numbers;", "(void)input;", "memory->unused = 0;"]
    stepping = [call(law, program.step, f"{name}_step", ["torque"]), "(void)memory;"]
    if program.start:
        start = f"\nstatic {emitted(program.start, f'{name}_initial')}"
        memory = [f"next.{entry.name}" for entry in program.memory]
        declare, keep = f"{name}_memory next;", "*memory = next;"
        starting = [declare, call(law, program.start, f"{name}_initial", memory), keep]
        stepping = [declare, call(law, program.step, f"{name}_step", ["torque", *memory]), keep]
    output, giving = "", ""
    if program.output:
        output = f"\nstatic {emitted(program.output, f'{name}_given')}"
        outputs = [f"outputs->{entry.name}" for entry in program.outputs]
        giving = call(law, program.output, f"{name}_given", outputs)
    reference = of_law("reference.c", law) if law.reference else ""
    if law.by.name == "float":
        reference = in_double(reference)
    texts = {"step": step, "start": start, "output": output, "giving": giving}
    texts["reference"] = reference
    body = partial(of_law, "law.c", law, starting=starting, stepping=stepping, **texts)
    functions = needed(PRELUDE + body(functions=""), headers(law.by.name))
    helpers = functions + reference
    prelude = PRELUDE if re.search(r"eqt_uint|EQT_INLINE|EQT_RARE", helpers) else ""
    if "eqt_uint" not in helpers:
        prelude = "\n".join(line for line in prelude.splitlines() if "typedef" not in line).lstrip()
    return body(functions=f"{prelude}\n{functions}".strip() + "\n")


def in_double(text: str) -> str:
    """Return functions in double for a file whose other functions are in float."""
    helpers = needed(PRELUDE + text, headers("double"))
    names = {*defined(helpers)}

    def renamed(match: re.Match[str]) -> str:
        name = match[0]
        return name.replace("_", "_double_", 1) if name in names else name

    return re.sub(r"\b(?:eqt|EQT)_\w+", renamed, f"\n{helpers}\n{text}") if text else ""


def emitted(program: Program, name: str) -> str:
    """Return a program in C, its parameters on several lines."""
    head, brace, body = c_function(program, name).partition("\n{")
    return wrapped(head, " " * 8).lstrip() + brace + body


def call(law: ExportedLaw, program: Program, name: str, outputs: Sequence[str]) -> str:
    """Return a C statement that calls a program with the arguments of the enclosing function."""
    p = law.program
    of = (INPUT, "input", p.inputs), (NUMBER, "numbers", p.numbers), (MEMORY, "memory", p.memory)
    entries = {
        prefix + entry.name: f"{'' if entry.shape else '&'}{where}->{entry.name}"
        for prefix, where, group in of
        for entry in group
    }
    arguments = [entries[group] for group, _ in program.inputs]
    return wrapped(f"{name}({', '.join([*arguments, *outputs])});", " " * 12).lstrip()


def default(law: ExportedLaw, entry: Entry) -> str:
    """Return the default of a number as an initialiser."""
    text = initialiser(law.numbers[entry.name], entry, law.by)
    return wrapped(f".{entry.name} = {text}", " " * 8, "    ")


def measurements(law: ExportedLaw) -> list[str]:
    """Return what the filter measures at each instant of its check, as initialisers."""
    assert law.filter is not None
    instants = zip(*(law.filter.flight[entry.name] for entry in law.filter.measured), strict=True)
    return [f"{{{', '.join(braced(part, law.by) for part in parts)}}}" for parts in instants]


# The check ----------------------------------------------------------------------------------------


def check(law: ExportedLaw) -> str:
    """Return the program that compares the source with exact numbers."""
    program, chosen = law.program, examples(law)
    states = law.states.at(chosen)
    bounds = law.bounded(program.step, states)
    memory = [MEMORY + entry.name for entry in program.memory]
    output_names = [OUTPUT + entry.name for entry in program.outputs]
    lines = []
    for k in range(len(chosen)):
        state = {name: values[k] for name, values in states.items()}
        exact = evaluated(program.step, {**state, **law.flat_numbers})
        after = [float(x) for name in memory for x in exact[name]]
        after_bound = [
            x for name in memory for x in _stored(bounds[name].errors[k], bounds[name].values[k])
        ]
        fields = [initialiser(state[INPUT + entry.name], entry, law.by) for entry in program.inputs]
        before = [braced(state[name], law.by) for name in memory]
        outputs, output_bound = _exact(law, program.output, state, output_names)
        parts = [
            f"{{{', '.join(fields)}}}",
            f"{{{', '.join(before) or '0'}}}",
            row(np.array([float(x) for x in exact[TORQUE]])),
            row(_stored(bounds[TORQUE].errors[k], bounds[TORQUE].values[k])),
            row(np.array([*after, 0.0])),
            row(np.array([*after_bound, 0.0])),
            row(np.array([*outputs, 0.0])),
            row(np.array([*_stored(output_bound, outputs), 0.0])),
            str(int(law.singular[chosen[k]])),
        ]
        lines.append(",\n".join(wrapped(part, " " * 9, " " * 8) for part in parts))
    first = {name: values[0] for name, values in states.items()}
    started, start_bound = _exact(law, program.start, first, memory)
    return of_law(
        "check.c",
        law,
        examples=lines,
        start=row(np.array([*started, 0.0])),
        start_bound=row(np.array([*_stored(start_bound, started), 0.0])),
    )


def examples(law: ExportedLaw) -> Array:
    """Return the indices of the states that the check uses, in order."""
    bounds = law.judged[TORQUE].errors.max(axis=1)
    finite = np.isfinite(bounds) & np.isfinite(law.judged[TORQUE].values).all(axis=1)
    far, near = np.flatnonzero(finite & ~law.singular), np.flatnonzero(finite & law.singular)
    worst = far[np.argsort(bounds[far], kind="stable")[-WORST:]]
    return np.unique([*_spread(far, EXAMPLES), *worst, *_spread(near, WORST)]).astype(int)


def _spread(places: Array, count: int) -> Array:
    """Return `count` places, or all if fewer, evenly spread from the first to the last."""
    if not len(places):
        return places
    return places[np.unique(np.linspace(0, len(places) - 1, count).round().astype(int))]


def _exact(
    law: ExportedLaw, program: Program | None, state: dict[str, Array], names: Sequence[str]
) -> tuple[Array, Array]:
    """Return outputs of a program in exact numbers, and the bounds of their errors."""
    if program is None:
        return np.empty(0), np.empty(0)
    bounds = law.bounded(program, state)
    exact = evaluated(program, {**state, **law.flat_numbers})
    return (
        np.array([float(x) for name in names for x in exact[name]]),
        np.concatenate([bounds[name].errors[0] for name in names]),
    )


def _stored(bounds: Array, values: Array) -> Array:
    """Return bounds that include the rounding of the exact numbers when stored as doubles."""
    return np.nextafter(bounds + DOUBLE.unit * np.abs(values), np.inf)


# The README of a folder with exported laws --------------------------------------------------------


NAME = "README.md"


def readme(laws: Sequence[ExportedLaw]) -> str:
    """Return the text of the README of the laws of an experiment."""
    experiment, tallies = laws[0].experiment, dict[str, str]()
    for identities_of in functions_for(purposes.identities_of_laws):  # their words by label
        tallies |= identities_of(experiment)
    return filled(
        NAME,
        experiment=experiment,
        laws=laws,
        first=laws[0].name,
        real=laws[0].by.name,
        loop=loop_in_words(experiment.resolved)[1],
        inner=description(experiment.resolved, "")["inner"],
        # Labels that are no names in C.
        spelled=[f'"{markdown(x.label)}" is `{x.name}`' for x in laws if x.label != x.name],
        claim=_claim,
        tallies=tallies,
    )


def _claim(law: ExportedLaw) -> str:
    """Say what the law claims of its L."""
    controller = law.loop.controller
    falls = claims(controller, law.loop.group, law.loop.gains)
    if falls is None:
        return "nothing is claimed"
    if not falls:
        return f"L = {controller.energy} is not claimed to fall"
    return (
        f"L = {controller.energy} falls along every motion of the ideal loop, in continuous time "
        f"({controller.theorem})"
    )


# Exports laws as C files into a folder ------------------------------------------------------------


@dataclass(frozen=True)
class ExportedFiles:
    """The files of an export.

    Attributes
    ----------
    folder
        Output folder.
    files
        Names of the files.
    laws
        A record for each law: ``label``, ``name``, ``real``, number of ``operations``, number of
        checked ``states``, error ``bound`` of each torque, number of ``singular`` states and the
        ``singular_bound`` of each torque there, and bytes of ``flash`` and ``stack`` on a
        Cortex-M4, which are None if no compiler was found.
    """

    folder: Path
    files: list[str]
    laws: list[dict[str, object]]


def export(
    target: Study | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    controllers: str | Sequence[str] = (),
    real: Literal["double", "float"] = "double",
    reference: bool = False,
    adapter: str | os.PathLike[str] | None = None,
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
) -> ExportedFiles:
    """Export control laws as C code for a vehicle: header, source, a test program and a README.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    out
        Output folder. Default: ``exported/NAME``.
    controllers
        Labels of the laws; all if empty.
    real
        Type of all numbers in C.
    reference
        Whether to export the reference too, which must be in closed form.
    adapter
        How the vehicle writes what the law reads and returns: a YAML file, as of `eqt
        verify`. Default: as eqt does.
    point
        Point of a sweep, counted from 0. Default: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.
    workers
        Number of cores for the runs that provide states for the checks.

    Returns
    -------
    ExportedFiles
        The written files, with operation counts and error bounds.

    Raises
    ------
    EqtError
        If a law cannot be written as C, or the folder is not writable.

    Examples
    --------
    >>> found = eqt_cli.export("configs/paper.yaml", "flight", controllers="eqt", real="float")
    >>> found.files
    ['eqt.h', 'eqt.c', 'eqt_check.c', 'README.md']
    """
    if real not in ARITHMETICS:
        raise EqtError(f"real: expected {' or '.join(ARITHMETICS)}, got {real!r}")
    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    remark_on(experiment, runs=False)
    folder = Path(out) if out is not None else Path("exported", experiment.name)
    check_targets([folder / NAME], folder)  # fails before the work, not after it
    labels = [controllers] if isinstance(controllers, str) else controllers
    by, how = ARITHMETICS[real], None
    if adapter:
        how = function_for(purposes.adapter_of_code)(Path(adapter), experiment.group)
    laws = exported(experiment, labels, by, reference=reference, adapter=how, workers=workers)
    texts: dict[str, str] = {}
    for law in laws:
        texts |= files(law)
    texts[NAME] = readme(laws)
    write_all({folder / name: text.encode() for name, text in texts.items()}, folder)
    return ExportedFiles(folder, list(texts), [_record(law) for law in laws])


def _record(law: ExportedLaw) -> dict[str, object]:
    return {
        "label": law.label,
        "name": law.name,
        "real": law.by.name,
        "operations": law.program.step.operations,
        "states": law.states.count,
        "bound": law.torque_bound.tolist(),
        "singular": int(np.count_nonzero(law.singular)),
        "singular_bound": law.singular_bound.tolist(),
    }
