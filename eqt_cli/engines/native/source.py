"""The C source of a closed loop: emitted programs, and templates that integrate and evaluate them.

It contains no text of a configuration but numbers; all names are eqt's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from eqt_cli.program import Constant, Input, Operation, Output, Program
from eqt_cli.program.c_code import FUNCTIONS_HEADER, LANES_HEADER, c_function
from eqt_cli.program.rewriting import fused

ADVANCE, STORE, MEASURE, EVALUATE = "advance.h", "store.h", "measure.h", "evaluate.h"
METHOD, ROWS = "dop853.h", "rows.h"
DEVICE, KERNEL = "opencl.h", "kernel.h"
_TEMPLATES = Path(__file__).parent


def integration(field: Program, lanes: int, at_samples: SampleProgram | None = None) -> str:
    """Return the C source of ``eqt_advance``, for a program of ``derivative``.

    Parameters
    ----------
    lanes
        Number of runs side by side; it changes no bit of a result.
    at_samples
        Program that looks at each sample; without it, states are stored.
    """
    kept, comparisons = with_kept_comparisons(field)
    lengths = dict(kept.inputs)
    sizes = {
        "EQT_STATES": lengths["state"],
        "EQT_PARAMETERS": lengths["parameters"],
        "EQT_HELD": lengths["held"],
        "EQT_COMPARISONS": comparisons,
        "EQT_MEMORY": 0 if at_samples is None else at_samples.memory,
    }
    every = set(range(lengths["state"]))
    emitted = [
        _defined(sizes),
        _flags("eqt_all", every, lengths["state"]),
        _flags("eqt_seen", every if at_samples is None else at_samples.states, lengths["state"]),
        f"static {c_function(fused(kept), 'eqt_field')}",
    ]
    names = [METHOD, ADVANCE, STORE]
    if at_samples is not None:
        emitted.append(_measuring(at_samples))
        names = [ROWS, METHOD, ADVANCE, MEASURE]
    return "\n".join([_head(lanes), *emitted, *map(_text, names)])


def kernel(field: Program, at_samples: SampleProgram | None = None) -> str:
    """Return the OpenCL C source of ``eqt_runs``, which integrates one run a work item."""
    return "\n".join([_text(DEVICE), integration(field, 1, at_samples), _text(KERNEL)])


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

    @property
    def memory(self) -> int:
        """The number of entries that it keeps from sample to sample."""
        return dict(self.program.inputs)["memory"]

    @property
    def states(self) -> set[int]:
        """The places in ``state`` that it reads."""
        inputs = (value for value in self.program.values if isinstance(value, Input))
        return {value.number for value in inputs if value.group == "state"}

    @property
    def kept(self) -> int:
        """The number of entries that it keeps of each sample."""
        return len(self.program.outputs[1].entries)


def _measuring(at_samples: SampleProgram) -> str:
    lengths = dict(at_samples.program.inputs)
    behind_state = accumulate(lengths[name] for name in ("state", "time", "held"))
    places = dict(zip(("time", "held", "columns"), behind_state, strict=True))
    given = {"state": "(in)", "parameters": "(parameters)", "memory": "(memory)"}
    given |= {name: f"(in) + {place}" for name, place in places.items()}
    sizes = {
        "EQT_SOURCES": len(at_samples.stretches),
        "EQT_ROWS": sum(at_samples.stretches),
        "EQT_KEPT": at_samples.kept,
    }
    called = ", ".join(
        [*(given[name] for name, _ in at_samples.program.inputs), "(after)", "(kept)"]
    )
    stretches = ", ".join(map(str, at_samples.stretches))
    return (
        f"{_defined(sizes)}"
        f"static EQT_CONSTANT const int64_t eqt_lengths[] = {{{stretches}}};\n"
        f"#define EQT_MEASURE(in, parameters, memory, after, kept) eqt_look_at({called})\n"
        f"static {c_function(at_samples.program, 'eqt_look_at')}"
    )


def evaluation(program: Program, stretches: Sequence[int], lanes: int) -> str:
    """Return the C source of ``eqt_evaluate``, for a program.

    Parameters
    ----------
    stretches
        The lengths of the stretches into which its inputs are cut, in their order.
    """
    # The names of arrays are not always names in C.
    outputs = [each._replace(name=f"array{k}") for k, each in enumerate(program.outputs)]
    named = replace(program, outputs=tuple(outputs))
    found = [len(output.entries) for output in program.outputs]
    starts = [0, *accumulate(length for _, length in program.inputs)]
    places = [0, *accumulate(found)]
    given = [f"(in) + {start}" for start in starts[:-1]]
    given += [f"(out) + {place}" for place in places[:-1]]
    defined = (
        f"#define EQT_SOURCES {len(stretches)}\n#define EQT_INPUTS {starts[-1]}\n"
        f"#define EQT_ARRAYS {len(found)}\n#define EQT_OUTPUTS {places[-1]}\n"
        f"static const int64_t eqt_lengths[] = {{{', '.join(map(str, stretches))}}};\n"
        f"static const int64_t eqt_found_lengths[] = {{{', '.join(map(str, found))}}};\n"
        f"#define EQT_CALL(in, out) eqt_program({', '.join(given)})\n"
    )
    emitted = f"static {c_function(named, 'eqt_program')}"
    return "\n".join([_head(lanes), defined, emitted, _text(ROWS), _text(EVALUATE)])


def with_kept_comparisons(program: Program) -> tuple[Program, int]:
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
    outputs = [each.moved(places) for each in program.outputs]
    for side, name in enumerate(("left", "right")):
        outputs.append(Output(name, (len(compared),), tuple(pair[side] for pair in compared)))
    inputs = (*program.inputs, ("sides", len(compared)))
    return Program(inputs, tuple(values), tuple(outputs)), len(compared)


def _defined(sizes: Mapping[str, int]) -> str:
    return "".join(f"#define {name} {size}\n" for name, size in sizes.items())


def _flags(name: str, chosen: Set[int], length: int) -> str:
    flags = ", ".join(str(int(place in chosen)) for place in range(length))
    return f"static EQT_CONSTANT const char {name}[] = {{{flags}}};\n"


def _head(lanes: int) -> str:
    texts = [path.read_text(encoding="utf-8") for path in (LANES_HEADER, FUNCTIONS_HEADER)]
    return "\n".join([f"#define EQT_LANES {lanes}", *texts])


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")
