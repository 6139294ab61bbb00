"""Picks from a header the definitions that a text in C needs, and what these need in turn."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from eqt_cli.program.c_code import FUNCTIONS_HEADER, LANES_HEADER

FLOAT_HEADER = Path(__file__).with_name("float_functions.h")
"""The types and functions of programs in float."""

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
    """The types and all functions of programs in ``double`` or ``float``, of one number each."""
    paths = [FLOAT_HEADER] if real == "float" else [LANES_HEADER, FUNCTIONS_HEADER]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return "\n".join(map(_of_one_lane, texts))


def needed(text: str, header: str) -> str:
    """The definitions of a header that a text needs, in the order of the header.

    What the text defines itself is not needed.
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
    """The definitions of a header, each with the comment before it; guards and includes are none."""
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
        if comment or (not code and not conditions):
            continue
        if found := _CONDITION.match(line):
            conditions += {"if": 1, "ifdef": 1, "ifndef": 1, "endif": -1}.get(found[1], 0)
        depth += code.count("{") - code.count("}")
        ends = code.endswith((";", "}")) or (code.startswith("#") and not code.endswith("\\"))
        if not depth and not conditions and ends:
            yield "\n".join(lines) + "\n"
            lines = []


def _of_one_lane(header: str) -> str:
    """A header with its choices between numbers of lanes made for one; without guard and includes."""
    found: list[str] = []
    stack: list[str] = []  # of each condition: kept as it is, dropped, taken or done
    for line in header.splitlines():
        match = _CONDITION.match(line)
        skipped = any(each in ("dropped", "done") for each in stack)
        if match and match[1] in ("if", "ifdef", "ifndef"):
            if skipped:
                stack.append("dropped")
            elif line.startswith("#ifndef EQT_"):
                stack.append("taken" if line.endswith("_H") else "dropped")
            elif line == "#if EQT_LANES == 1":
                stack.append("taken")
            else:
                stack.append("kept")
                found.append(line)
        elif match and match[1] in ("elif", "else"):
            if stack[-1] == "taken":
                stack[-1] = "done"
            elif not skipped:
                found.append(line)
        elif match:
            if stack.pop() == "kept":
                found.append(line)
        elif not skipped and not line.startswith("#include") and not _GUARD.fullmatch(line):
            found.append(line)
    return "\n".join(found).replace("EQT_LANES", "1")
