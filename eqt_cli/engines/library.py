"""The C source of an integrator, and the compiled library that Python calls."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.engines import compiler
from eqt_cli.engines.engine import HURRIED
from eqt_cli.numbers.c_code import FUNCTIONS_HEADER, LANES_HEADER, c_function
from eqt_cli.numbers.program import Constant, Input, Operation, Output, Program, fused

# The C source of a closed loop: emitted programs, and templates that integrate and evaluate them --
#
# It contains no text of a configuration but numbers; all names are eqt's.


_TEMPLATES = Path(__file__).parent / "c"


def integration_source(
    field: Program, lanes: int, at_samples: SampleProgram | None = None, walks: bool = False
) -> str:
    """Return the C source of ``eqt_advance``, for a program of ``derivative``.

    Parameters
    ----------
    lanes
        Number of runs side by side; it changes no bit of a result.
    at_samples
        Program that looks at each sample; without it, states are stored.
    walks
        Whether there is ``eqt_walk``, too.
    """
    program, comparisons = with_comparison_sides(field)
    lengths, memory = dict(program.inputs), 0
    states = seen = {*range(lengths["state"])}
    if at_samples is not None:
        memory = dict(at_samples.program.inputs)["memory"]
        inputs = [value for value in at_samples.program.values if isinstance(value, Input)]
        seen = {value.number for value in inputs if value.group == "state"}
    sizes = {
        "EQT_STATES": lengths["state"],
        "EQT_PARAMETERS": lengths["parameters"],
        "EQT_HELD": lengths["held"],
        "EQT_COMPARISONS": comparisons,
        "EQT_MEMORY": memory,
    }
    emitted = [
        _defined(sizes),
        _array("char eqt_all", [1 for _ in states]),
        _array("char eqt_seen", [int(place in seen) for place in states]),
        c_function(fused(program), "eqt_field", static=True),
    ]
    names = ["dop853.h", "advance.h", "store.h"]
    if walks:
        names += ["rows.h", "walk.h"]
    if at_samples is not None:
        emitted.append(_measuring(at_samples))
        names = ["rows.h", "dop853.h", "advance.h", "measure.h"]
    return "\n".join([_head(lanes), *emitted, *map(_text, names)])


class SampleProgram(NamedTuple):
    """A program that measures each sample of a run.

    Attributes
    ----------
    program
        Its outputs are ``memory`` and ``kept``, its inputs ``state`` followed by further rows,
        ``time``, ``parameters``, ``held``, ``columns`` and ``memory``.
    stretches
        The lengths of the inputs besides the state: rows, time, held numbers and columns.
    """

    program: Program
    stretches: tuple[int, ...]


def _measuring(at_samples: SampleProgram) -> str:
    lengths = dict(at_samples.program.inputs)
    behind_state = accumulate(lengths[name] for name in ("state", "time", "held"))
    places = dict(zip(("time", "held", "columns"), behind_state, strict=True))
    arguments = {"state": "(in)", "parameters": "(parameters)", "memory": "(memory)"}
    arguments |= {name: f"(in) + {place}" for name, place in places.items()}
    sizes = {
        "EQT_SOURCES": len(at_samples.stretches),
        "EQT_ROWS": sum(at_samples.stretches),
        "EQT_KEPT": len(at_samples.program.outputs[1].entries),
    }
    called = ", ".join(
        [*(arguments[name] for name, _ in at_samples.program.inputs), "(after)", "(kept)"]
    )
    return (
        f"{_defined(sizes)}{_array('int64_t eqt_lengths', at_samples.stretches)}"
        f"#define EQT_MEASURE(in, parameters, memory, after, kept) eqt_look_at({called})\n"
        f"{c_function(at_samples.program, 'eqt_look_at', static=True)}"
    )


def evaluation_source(program: Program, stretches: Sequence[int], lanes: int) -> str:
    """Return the C source of ``eqt_evaluate``, for a program.

    Parameters
    ----------
    stretches
        The lengths of the stretches into which its inputs are cut, in their order.
    """
    # The names of arrays are not always names in C.
    outputs = [array._replace(name=f"array{k}") for k, array in enumerate(program.outputs)]
    named = replace(program, outputs=tuple(outputs))
    lengths = [len(output.entries) for output in program.outputs]
    starts = [0, *accumulate(length for _, length in program.inputs)]
    places = [0, *accumulate(lengths)]
    arguments = [f"(in) + {start}" for start in starts[:-1]]
    arguments += [f"(out) + {place}" for place in places[:-1]]
    sizes: dict[str, int | str] = {
        "EQT_SOURCES": len(stretches),
        "EQT_INPUTS": starts[-1],
        "EQT_ARRAYS": len(lengths),
        "EQT_OUTPUTS": places[-1],
        "EQT_CALL(in, out)": f"eqt_program({', '.join(arguments)})",
    }
    arrays = _array("int64_t eqt_lengths", stretches) + _array("int64_t eqt_found_lengths", lengths)
    emitted = c_function(named, "eqt_program", static=True)
    texts = [_defined(sizes) + arrays, emitted, _text("rows.h"), _text("evaluate.h")]
    return "\n".join([_head(lanes), *texts])


def with_comparison_sides(program: Program) -> tuple[Program, int]:
    """Return the program with the sides of its comparisons as inputs, and their number.

    Every ``a < b`` is replaced by ``sides[j] < 0``. The outputs ``left`` and ``right`` are the a
    and b of each. Comparisons between forms of one smooth function are unchanged.
    """
    values: list[Input | Constant | Operation] = []
    places: list[int] = []
    compared: list[tuple[int, int]] = []
    zero = -1
    for value in program.values:
        if isinstance(value, Operation):
            value = value.moved(places)
            if value.name == "less":
                if zero < 0:
                    zero = len(values)
                    values.append(Constant(0.0))
                values.append(Input("sides", len(compared)))
                compared.append((value.operands[0], value.operands[1]))
                value = Operation("less", (len(values) - 1, zero))
        places.append(len(values))
        values.append(value)
    outputs = [output.moved(places) for output in program.outputs]
    for side, name in enumerate(("left", "right")):
        outputs.append(Output(name, (len(compared),), tuple(pair[side] for pair in compared)))
    inputs = (*program.inputs, ("sides", len(compared)))
    return Program(inputs, tuple(values), tuple(outputs)), len(compared)


def _defined(macros: Mapping[str, int | str]) -> str:
    return "".join(f"#define {name} {text}\n" for name, text in macros.items())


def _array(name: str, numbers: Sequence[int]) -> str:
    return f"static const {name}[] = {{{', '.join(map(str, numbers))}}};\n"


def _head(lanes: int) -> str:
    texts = [path.read_text(encoding="utf-8") for path in (LANES_HEADER, FUNCTIONS_HEADER)]
    return "\n".join([f"#define EQT_LANES {lanes}", *texts])


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


# Python's calls of compiled loops: arrays in, arrays out, through ctypes --------------------------
#
# A call releases the interpreter's lock, so that threads integrate side by side.


THROUGH, STEP_LIMIT, NOT_FINITE, STEP_TOO_SHORT, SWITCHING, STOPPED = range(6)
"""Outcomes of a run, as in advance.h."""


def _typed(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class _Source(ctypes.Structure):
    _fields_ = [("from", ctypes.c_void_p), *_typed(ctypes.c_int64, "to_next_run to_next_sample")]


class _Evaluations(ctypes.Structure):
    _fields_ = [
        *_typed(ctypes.c_int64, "runs samples count"),
        ("sources", ctypes.POINTER(_Source)),
        ("found", ctypes.POINTER(ctypes.c_void_p)),
    ]


class _Measuring(ctypes.Structure):
    _fields_ = [
        ("sources", ctypes.POINTER(_Source)),
        *_typed(ctypes.c_void_p, "starts memory kept"),
    ]


class _Span(ctypes.Structure):
    _fields_ = [
        *_typed(ctypes.c_int64, "runs later most_steps to_next_run row to_next_held"),
        *_typed(ctypes.c_double, "start stop first_inside last_inside rtol atol longest"),
        *_typed(ctypes.c_void_p, "grid held parameters states samples steps"),
        *_typed(ctypes.c_void_p, "counts ends times stopped periods"),
        ("measuring", ctypes.POINTER(_Measuring)),
    ]


def _set(structure: Any, members: Mapping[str, Any]) -> None:
    for name, value in members.items():
        setattr(structure, name, value.ctypes.data if isinstance(value, np.ndarray) else value)


@lru_cache(maxsize=32)
def _integrator(field: Program, at_samples: SampleProgram | None, walks: bool, quick: bool) -> Any:
    """Return the library of a field: ``eqt_advance``, and if it `walks`, ``eqt_walk``."""
    source = integration_source(field, compiler.compiler().lanes, at_samples, walks)
    return compiler.library(source, quick=quick)


def integration(
    field: Program, at_samples: SampleProgram | None = None, walks: bool = False
) -> Callable[..., None]:
    """Return ``eqt_advance`` of a field, which takes the members of ``eqt_span``.

    Arrays are C-contiguous. `measuring` returns the member of that name. With `walks`, the library
    is that of `Walk`, so that it is compiled once.
    """
    function = _integrator(field, at_samples, walks, HURRIED.get()).eqt_advance

    def advance(**members: Any) -> None:
        span = _Span(row=members["states"].shape[1])
        _set(span, members)
        function(ctypes.byref(span))

    return advance


class Rows:
    """Numbers that a program takes, and along which axes they vary.

    Attributes
    ----------
    values
        ``(n,)``, preceded by the axes, runs and samples, along which they vary.
    by_run, by_sample
        Whether they vary along this axis.
    length
        The length n of a row.
    """

    def __init__(self, values: Array, by_run: bool = False, by_sample: bool = False) -> None:
        self.values = np.ascontiguousarray(values, dtype=float)  # as C reads them
        self.by_run, self.by_sample = by_run, by_sample
        self.length = int(values.shape[-1])

    def of(self, runs: slice) -> Rows:
        """Return the rows of some runs."""
        return Rows(self.values[runs], True, self.by_sample) if self.by_run else self


def measuring(rows: Sequence[Rows], starts: Array, memory: Array, stored: Array) -> Any:
    """Return the data of a program that looks at runs sample by sample, as measure.h takes them.

    They are valid as long as the arrays live.

    Parameters
    ----------
    rows
        Its inputs besides the states, one stretch after the other.
    starts
        Its memory before the first sample.
    memory : (runs, memory)
        Its memory after the last sample, to be filled in.
    stored : (runs, samples, stored)
        Numbers that it keeps of each sample, to be filled in.
    """
    places = (array.ctypes.data for array in (starts, memory, stored))
    return ctypes.pointer(_Measuring(_sources(rows), *places))


def _sources(inputs: Sequence[Rows]) -> Any:
    """Return where the numbers of some rows lie in memory."""
    sources = (_Source * len(inputs))()
    for place, rows in enumerate(inputs):
        along = rows.length if rows.by_sample else 0
        per_run = rows.values[:1].size if rows.by_run else 0
        sources[place] = _Source(rows.values.ctypes.data, per_run, along)
    return sources


@lru_cache(maxsize=64)
def _evaluate(program: Program, stretches: tuple[int, ...], lanes: int, quick: bool) -> Any:
    """Return ``eqt_evaluate`` of a program."""
    text = evaluation_source(program, stretches, lanes or compiler.compiler().lanes)
    return compiler.library(text, quick=quick).eqt_evaluate


def _evaluations(
    program: Program, runs: int, samples: int, inputs: Sequence[Rows]
) -> tuple[_Evaluations, dict[str, Array]]:
    """Return what calls a program, and the arrays that it will fill in."""
    outputs = {output.name: np.empty((runs, samples, *output.shape)) for output in program.outputs}
    places = (ctypes.c_void_p * len(outputs))(*(x.ctypes.data for x in outputs.values()))
    return _Evaluations(runs, samples, len(inputs), _sources(inputs), places), outputs


def evaluated(
    program: Program, runs: int, samples: int, inputs: Sequence[Rows], lanes: int = 0
) -> dict[str, Array]:
    """Return the arrays of a program, ``(runs, samples, …)`` each, by name.

    Parameters
    ----------
    inputs
        Its inputs, one stretch after the other.
    lanes
        The number of runs side by side; by default as many as fill a vector.
    """
    batch, outputs = _evaluations(program, runs, samples, inputs)
    lengths = tuple(rows.length for rows in inputs)
    _evaluate(program, lengths, lanes, HURRIED.get())(ctypes.byref(batch))
    return outputs


# Walks through many spans by one call -------------------------------------------------------------


WALKED = np.dtype(
    _typed(float, "start stop first_inside last_inside longest")
    + _typed(np.int64, "first later sampled_start tick acts")
)
"""A span as in walk.h."""


class _Instant(ctypes.Structure):
    _fields_ = [
        ("evaluate", ctypes.c_void_p),
        ("evaluations", _Evaluations),
        ("moved", ctypes.POINTER(_Source)),
        ("at_start", ctypes.POINTER(_Source)),
        ("by_tick", ctypes.POINTER(ctypes.c_int64)),
    ]


class _Walks(ctypes.Structure):
    _fields_ = [
        ("span", _Span),
        *_typed(ctypes.c_int64, "place stop suspicious lost"),
        *_typed(ctypes.c_void_p, "list times held samples commanded before counted"),
        ("programs", _Instant * 2),
        ("parts", ctypes.c_int64),
        ("code", ctypes.c_void_p),
        *_typed(ctypes.c_int64, "begins memory_at memory_length"),
        ("period", ctypes.c_double),
        *_typed(ctypes.c_void_p, "measured options law_inputs memory torques"),
    ]


class Walk:
    """Walks some runs through the spans of a sampled loop by calls of ``eqt_walk``.

    Parameters
    ----------
    field
        Program of the vector field.
    spans : (spans,)
        `WALKED` of every span.
    arrays
        ``times`` of samples, ``held`` numbers of every span, and ``samples`` of the runs.
    span
        Other members of ``eqt_span``; all runs' ``states`` are whole.

    Attributes
    ----------
    counts : (runs,)
        The steps of each run before the last span.
    """

    def __init__(self, field: Program, spans: Array, arrays: Arrays, **span: Any) -> None:
        library = _integrator(field, at_samples=None, walks=True, quick=HURRIED.get())
        self._function = library.eqt_walk
        self._function.restype = ctypes.c_int64
        runs, row = span["states"].shape
        # A run whose span cannot be walked is put back to what it was before it: to its state, step
        # length and time in `before`, to its number of steps and its end in `counted`.
        buffers = {"before": np.empty((runs, row + 2)), "counted": np.zeros((runs, 2), np.int64)}
        self.counts = buffers["counted"][:, 0]
        self._c = _Walks(parts=0)
        _set(self._c.span, {**span, "runs": runs, "row": row})
        self._lives: list[Any] = [span]  # what C points to
        self.set(list=spans, **arrays, **buffers)

    def set(self, **members: Any) -> None:
        """Set members of ``eqt_walks``, of which arrays are given as such."""
        _set(self._c, members)
        self._lives.append(members)

    def evaluate(self, program: Program, inputs: Sequence[Rows], ticks: int = 0) -> Arrays:
        """Have a program evaluated at instants; return the arrays that it fills in.

        Parameters
        ----------
        inputs
            Samples are spans; the last `ticks` ones are those of `measure`.
        """
        lengths = tuple(row.length for row in inputs)
        runs, function = self._c.span.runs, _evaluate(program, lengths, 0, HURRIED.get())
        batch, outputs = _evaluations(program, runs, 1, inputs)
        moves = (ctypes.c_int64 * len(inputs))(*[0] * (len(inputs) - ticks), *[1] * ticks)
        address, at_start = ctypes.cast(function, ctypes.c_void_p), _sources(inputs)
        self._c.programs[self._c.parts] = _Instant(address, batch, batch.sources, at_start, moves)
        self._c.parts += 1
        self._lives.append((inputs, batch, outputs, at_start, moves))
        return outputs

    def measure(self, errors: Sequence[Array], first: int) -> None:
        """Have the first program read sensor errors, ``(ticks, runs, …)``, from tick `first` on."""
        program, parts = self._c.programs[0], [np.ascontiguousarray(part) for part in errors]
        self._errors = parts  # which must live
        for place, part in enumerate(parts, program.evaluations.count - len(parts)):
            along = part[0].size
            start = part.ctypes.data - first * along * part.itemsize
            program.at_start[place] = _Source(start, part[0, 0].size, along)

    def __call__(self, place: int, stop: int) -> int:
        """Walk through some spans; return the place of the one that was not walked, or `stop`."""
        self._c.place, self._c.stop = place, stop
        return int(self._function(ctypes.byref(self._c)))
