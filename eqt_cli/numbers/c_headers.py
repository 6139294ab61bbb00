"""The definitions in C that an exported program needs, out of the headers of programs."""

import re
from collections.abc import Iterator
from pathlib import Path

from eqt_cli.numbers.c_code import FUNCTIONS_HEADER, LANES_HEADER

FLOAT_HEADER = Path(__file__).with_name("float_functions.h")
"""Header of the types and functions of programs in float."""

PRELUDE = """\
typedef __UINT32_TYPE__ eqt_uint32;
typedef __UINT64_TYPE__ eqt_uint64;

#define EQT_INLINE static inline
#define EQT_RARE static
"""
"""What stands before the definitions."""

_DEFINED = re.compile(
    r"^#define (\w+)|^(?:EQT_INLINE|EQT_RARE)[\w ]* \*?(\w+)\(|^static const \w+ (\w+)\["
    r"|^typedef [^;{]*?(\w+)(?: __attribute__.*)?;|^\} (\w+);",
    re.MULTILINE,
)
_NAME = re.compile(r"\b(?:eqt|EQT)_\w+")
_RULE = re.compile(r"/\* .* -{10,} \*/")
_GUARD = re.compile(r"#(?:ifndef|define) EQT_\w+_H")


def headers(real: str) -> str:
    """Return the types and functions of programs in ``double`` or ``float``, with one lane."""
    paths = [FLOAT_HEADER] if real == "float" else [LANES_HEADER, FUNCTIONS_HEADER]
    return "\n".join(map(_of_one_lane, [path.read_text(encoding="utf-8") for path in paths]))


def needed(text: str, header: str) -> str:
    """Return the definitions of a header that a text needs, in the order of the header.

    Names that the text defines itself are left out.
    """
    in_text = set(defined(text))
    units = [unit for unit in _units(header) if not in_text.intersection(defined(unit))]
    wanted = set(_NAME.findall(text))
    chosen: set[int] = set()
    for index in reversed(range(len(units))):  # definitions stand before their use
        if wanted.intersection(defined(units[index])):
            chosen.add(index)
            wanted.update(_NAME.findall(units[index]))
    return "\n".join(units[index] for index in sorted(chosen))


def defined(text: str) -> Iterator[str]:
    """Yield the names that a text defines."""
    return (name for names in _DEFINED.findall(text) for name in names if name)


def _units(header: str) -> Iterator[str]:
    """Yield the definitions of a header, each with the comment before it."""
    lines: list[str] = []
    depth = 0
    comment = False
    for line in header.splitlines():
        if _RULE.fullmatch(line) or (not line.strip() and not depth):
            lines = [] if not comment else lines
            continue
        lines.append(line)
        comment = ("/*" in line or comment) and "*/" not in line.rpartition("/*")[2]
        code = re.sub(r"/\*.*?\*/", "", line).rstrip()
        if comment:
            continue
        depth += code.count("{") - code.count("}")
        ends = code.endswith((";", "}")) or (code.startswith("#") and not code.endswith("\\"))
        if not depth and ends:
            yield "\n".join(lines) + "\n"
            lines = []


def _of_one_lane(header: str) -> str:
    """Return a header for one lane, without guard, includes and conditions.

    Of a condition, only what it brings for one lane stays; what depends on the compiler is in
    `PRELUDE` for all of them.
    """
    lines: list[str] = []
    holds: list[bool] = []  # of each condition around a line
    for line in header.splitlines():
        if line.startswith("#if"):
            holds.append(line == "#if EQT_LANES == 1" or _GUARD.fullmatch(line) is not None)
        elif line.startswith(("#elif", "#else")):
            holds[-1] = False  # no condition but of one lane has another branch that would hold
        elif line.startswith("#endif"):
            holds.pop()
        elif all(holds) and not line.startswith("#include") and not _GUARD.fullmatch(line):
            lines.append(line)
    return "\n".join(lines).replace("EQT_LANES", "1")
