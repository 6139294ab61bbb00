"""Names that are valid in C: ASCII letters, digits and underscores, and no keywords."""

import math
import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from eqt_cli.program.program import COMPARISONS, Constant, Input, Program

KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while asm bool catch class delete explicit export false friend "
    "mutable namespace new operator private protected public template this throw true try typeid "
    "typename using virtual real".split()
)
"""Keywords of C and C++, and the type of the exported numbers."""


def c_name(text: str) -> str:
    """Return a name in C for a text: the text itself if it is one."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") if not _is_name(text) else text
    if not name or name[0].isdigit():
        name = f"n_{name}".rstrip("_")
    return f"{name}_" if name in KEYWORDS else name


def distinct(
    texts: Iterable[str], taken: Collection[str] = (), endings: Collection[str] = ("",)
) -> list[str]:
    """Return names in C for texts, none of which is taken, also with these endings.

    They differ not only in case, so that files can have them on every system.
    """
    found, used = [], {each.lower() for each in taken}
    for text in texts:
        name, number = c_name(text), 1
        while used & (own := {f"{name}{ending}".lower() for ending in endings}):
            number += 1
            name = f"{c_name(text)}_{number}"
        found.append(name)
        used |= own
    return found


def _is_name(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text, re.ASCII) is not None


LANES_HEADER = Path(__file__).with_name("lanes.h")
"""Header of the number type, one or several numbers side by side; it precedes programs."""

FUNCTIONS_HEADER = Path(__file__).with_name("functions.h")
"""Header of the elementary functions of programs; it follows `LANES_HEADER`."""

_INFIX = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}


def c_function(program: Program, name: str) -> str:
    """Return the definition of a C function for a program.

    It takes a pointer ``in_GROUP`` for each group of inputs, then ``out_NAME`` for each output, in
    their order. Outputs must not overlap inputs. Elementary functions have the names of the
    program, prefixed with ``eqt_``.

    Raises
    ------
    ValueError
        If a name is no identifier of C.
    """
    groups = [group for group, _ in program.inputs]
    outputs = [output.name for output in program.outputs]
    for each in (name, *groups, *outputs):
        if not _is_name(each):
            raise ValueError(f"{each!r} is no identifier of C")
    taken = [f"const eqt_real *__restrict in_{group}" for group in groups]
    given = [f"eqt_real *__restrict out_{output}" for output in outputs]
    used = {value.group for value in program.values if isinstance(value, Input)}
    targets: dict[int, list[str]] = {}
    for output in program.outputs:
        for entry, place in enumerate(output.entries):
            targets.setdefault(place, []).append(f"out_{output.name}[{entry}] = v{place};")
    lines = [f"(void)in_{group};" for group in groups if group not in used]
    for place in range(len(program.values)):
        lines += [_definition(program, place), *targets.get(place, [])]
    body = "".join(f"    {line}\n" for line in lines)
    return f"void {name}({', '.join(taken + given)})\n{{\n{body}}}\n"


def _definition(program: Program, place: int) -> str:
    value, kind = program.values[place], "eqt_real"
    if isinstance(value, Input):
        formula = f"in_{value.group}[{value.number}]"
    elif isinstance(value, Constant):
        formula = f"eqt_constant({_literal(value.number)})"
    else:
        operands = [f"v{operand}" for operand in value.operands]
        if value.name in _INFIX:
            formula = f" {_INFIX[value.name]} ".join(operands)
        elif value.name == "negative":
            formula = f"-{operands[0]}"
        else:
            kind = "eqt_mask" if value.name in COMPARISONS else kind
            called = "less" if value.name in COMPARISONS else value.name
            formula = f"eqt_{called}({', '.join(operands)})"
    return f"const {kind} v{place} = {formula};"


def _literal(number: float) -> str:
    """Return a number in C: its shortest digits, which compilers read as the same double."""
    if math.isfinite(number):
        return repr(number)
    return "EQT_NAN" if math.isnan(number) else f"{'-' * (number < 0)}EQT_INFINITY"


FLOAT_HEADER = Path(__file__).with_name("float_functions.h")
"""Header of the types and functions of programs in float."""

_DEFINED = re.compile(
    r"^#define (\w+)|^(?:EQT_INLINE|EQT_RARE)[\w ]* \*?(\w+)\(|^static const \w+ (\w+)\["
    r"|^typedef [^;{]*?(\w+)(?: __attribute__.*)?;|^\} (\w+);",
    re.MULTILINE,
)
_NAME = re.compile(r"\b(?:eqt|EQT)_\w+")
_RULE = re.compile(r"/\* .* -{10,} \*/")
_GUARD = re.compile(r"#define EQT_\w+_H")
_CONDITION = re.compile(r"#(if|ifdef|ifndef|elif|else|endif)\b(.*)")


def headers(real: str) -> str:
    """Return the types and functions of programs in ``double`` or ``float``, with one lane."""
    paths = [FLOAT_HEADER] if real == "float" else [LANES_HEADER, FUNCTIONS_HEADER]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return "\n".join(map(_of_one_lane, texts))


def needed(text: str, header: str) -> str:
    """Return the definitions of a header that a text needs, in the order of the header.

    Names that the text defines itself are left out.
    """
    own = set(_defined(text))
    units = [unit for unit in _units(header) if not own.intersection(_defined(unit))]
    wanted = set(_NAME.findall(text))
    chosen: set[int] = set()
    for index in reversed(range(len(units))):  # definitions stand before their use
        if wanted.intersection(_defined(units[index])):
            chosen.add(index)
            wanted.update(_NAME.findall(units[index]))
    return "\n".join(units[index] for index in sorted(chosen))


def _defined(text: str) -> Iterator[str]:
    return (name for found in _DEFINED.findall(text) for name in found if name)


def _units(header: str) -> Iterator[str]:
    """Yield the definitions of a header, each with the comment before it."""
    lines: list[str] = []
    depth = conditions = 0
    comment = False
    for line in header.splitlines():
        if _RULE.fullmatch(line) or (not line.strip() and not depth and not conditions):
            lines = [] if not comment else lines
            continue
        lines.append(line)
        comment = ("/*" in line or comment) and "*/" not in line.rpartition("/*")[2]
        code = re.sub(r"/\*.*?\*/", "", line).rstrip()
        if comment:
            continue
        if found := _CONDITION.match(line):
            conditions += {"if": 1, "ifdef": 1, "ifndef": 1, "endif": -1}.get(found[1], 0)
        depth += code.count("{") - code.count("}")
        ends = code.endswith((";", "}")) or (code.startswith("#") and not code.endswith("\\"))
        if not depth and not conditions and ends:
            yield "\n".join(lines) + "\n"
            lines = []


def _of_one_lane(header: str) -> str:
    """Return a header for one lane, without guard, includes and conditions on the lanes."""
    branches: list[str] = []  # the fate of each condition around a line
    kept = [
        line
        for line in header.splitlines()
        if _stays(line, branches) and not line.startswith("#include") and not _GUARD.fullmatch(line)
    ]
    text = "\n".join(kept).replace("EQT_LANES", "1")
    return text.replace("static EQT_CONSTANT const", "static const")


def _stays(line: str, branches: list[str]) -> bool:
    """Return whether a line stays; a condition begins, changes or ends the last branch."""
    match = _CONDITION.match(line)
    skipped = "skipped" in branches
    if match is None:
        return not skipped
    if match[1] in ("if", "ifdef", "ifndef"):
        branches.append("skipped" if skipped else _branch(line))
        return branches[-1] == "kept"
    if match[1] == "endif":
        return branches.pop() == "kept" and "skipped" not in branches
    if branches[-1] == "taken":
        branches[-1] = "skipped"
    return not skipped and branches[-1] == "kept"


def _branch(line: str) -> str:
    if line == "#if EQT_LANES == 1" or re.fullmatch(r"#ifndef EQT_(\w+_H|DEVICE)", line):
        return "taken"
    return "skipped" if line == "#ifndef EQT_LANES" else "kept"
