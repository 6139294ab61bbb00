"""XML from elsewhere as plain data: elements that know their file and line.

Document types and entities, deep nesting and large files are refused, so that a file costs time in
proportion to its size; nothing in it is executed or fetched.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, Remedy
from eqt_cli.base.expressions import parse

MOST_BYTES = 20_000_000
MOST_DEPTH = 100
MOST_ELEMENTS = 100_000
"""Most elements of a file, of which each takes about 1 kB; the largest of PX4 has 4,000."""

MOST_FORMULAS = 2_000
MOST_IN_FORMULAS = 100_000
"""Most formulas of a template, and most characters of all; those of PX4 have up to 60."""

LARGEST = 1e30
"""Largest number of a file: products of several stay finite."""

TRUE = ("true", "1")


@dataclass(eq=False)
class Element:
    """An element of a file.

    Attributes
    ----------
    tag, attributes, children, text
        As in the file; `text` is that of the element alone.
    place
        File and line, as messages and comments name them.
    """

    tag: str
    attributes: dict[str, str]
    place: str
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> Iterator[Element]:
        """Yield the children of a tag."""
        return (child for child in self.children if child.tag == tag)

    def one(self, path: str) -> Element | None:
        """Return the first element at a path such as ``axis/xyz``."""
        here: Element | None = self
        for tag in path.split("/"):
            here = None if here is None else next(here.all(tag), None)
        return here

    def walk(self) -> Iterator[Element]:
        """Yield the element and all within it."""
        left = [self]
        while left:
            here = left.pop()
            yield here
            left += here.children[::-1]

    def words(self, path: str) -> str:
        """Return the text at a path without spaces around it; empty without the element."""
        here = self.one(path)
        return "" if here is None else here.text.strip()

    def holds(self, path: str) -> bool:
        """Whether the text at a path is true."""
        return self.words(path) in TRUE

    def number(self, path: str, default: float | None = None) -> float:
        """Return the number at a path.

        Raises
        ------
        EqtError
            Without the element and without a default, and for text that is no number.
        """
        here = self.one(path)
        if here is None:
            if default is None:
                raise EqtError(f"{self.place}: <{self.tag}> has no <{path}>; add it")
            return default
        return float(here.numbers(1)[0])

    def numbers(self, count: int, attribute: str = "", default: str | None = None) -> Array:
        """Return the numbers of the text, or of an attribute."""
        text = self.attributes.get(attribute, default) if attribute else self.text
        name = f"{attribute} of <{self.tag}>" if attribute else f"<{self.tag}>"
        words = (text or "").split()
        if len(words) == count:
            try:
                values = np.array([float(word.replace("_", "?")) for word in words])
            except ValueError:
                values = np.array([np.nan])
            if (np.abs(values) <= LARGEST).all():
                return values
        expected = "a number" if count == 1 else f"{count} numbers"
        got = "nothing" if text is None or not words else f"'{shortened(text)}'"
        hint = Remedy("write the number that its template fills in") if "{{" in (text or "") else ()
        remedies = (hint,) if isinstance(hint, Remedy) else ()
        raise EqtError(f"{self.place}: {name}: expected {expected}, got {got}", *remedies)


def shortened(text: str) -> str:
    """Return text from a file in one line of a message."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:59]}…"


def shown(path: Path) -> str:
    """Return the name of a file; with its folder where the name is that of many."""
    common = path.name.startswith("model.")
    return f"{path.parent.name}/{path.name}" if common and path.parent.name else path.name


def content(path: Path) -> bytes:
    """Return the bytes of a file that is small enough."""
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise EqtError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MOST_BYTES:
        raise EqtError(f"{path}: expected at most {MOST_BYTES // 10**6} MB; give the model alone")
    return data


def read(path: Path) -> Element:
    """Return the root element of a file, of a Jinja template with its constants filled in."""
    data = content(path)
    if path.suffix == ".jinja" or re.search(rb"{%|{{", data):
        data = filled_in(data.decode("utf-8", "replace"), path).encode()
    return parsed(data, path, lambda line: f"{shown(path)}:{line}")


def parsed(data: bytes, path: Path, place: Callable[[int], str]) -> Element:
    """Return the root element of a text.

    Raises
    ------
    EqtError
        With line and column, if the text is not well-formed or holds what is refused.
    """
    parser = expat.ParserCreate()
    open_elements: list[Element] = []
    roots: list[Element] = []

    def refuse(*_: object) -> None:
        line = place(parser.CurrentLineNumber)
        raise EqtError(f"{line}: document types and entities are not read; remove them")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, place(parser.CurrentLineNumber))
        if len(open_elements) == MOST_DEPTH:
            raise EqtError(f"{element.place}: nested more than {MOST_DEPTH} deep; flatten it")
        count[0] += 1
        if count[0] > MOST_ELEMENTS:
            raise EqtError(f"{element.place}: more than {MOST_ELEMENTS:,} elements; simplify it")
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)
        texts.append([])

    def end(_: str) -> None:
        open_elements.pop().text = "".join(texts.pop())

    def add(text: str) -> None:
        texts[-1].append(text)

    texts: list[list[str]] = []
    count = [0]
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = add
    try:
        parser.Parse(_COMMENT.sub(lambda comment: comment[0].replace(b"-", b" "), data), True)
    except expat.ExpatError as error:
        at = f"{place(error.lineno)}:{error.offset + 1}"
        raise EqtError(f"{at}: {expat.ErrorString(error.code)}; correct the XML") from None
    except (LookupError, ValueError) as error:
        raise EqtError(f"{path}: {error}; save it as UTF-8") from None
    return roots[0]


# Gazebo and MuJoCo read comments with "--" within, such as of command lines, which XML forbids.
_COMMENT = re.compile(rb"(?<=<!--)(?:(?!-->).)+", re.DOTALL)

# None reaches over the next of its kind, so that braces which never close cost no square of time.
_JINJA = re.compile(r"{#(?:(?!{#).)*?#}|{%-?((?:(?!{%).)*?)-?%}|{{-?((?:(?!{{).)*?)-?}}", re.DOTALL)
_SET = re.compile(r"\s*set\s+(\w+)\s*=(.*)", re.S)


def filled_in(text: str, path: Path) -> str:
    """Return a Jinja template with its constants filled in, line by line.

    ``{% set m = 0.05 %}`` and ``{{ m/12 }}`` are arithmetic, which eqt's own formulas compute. What
    else stands in braces stays, so that a number there is missed where it is needed.

    Raises
    ------
    EqtError
        For macros, loops and other statements.
    """
    constants: dict[str, float] = {}
    count = characters = 0

    def value(formula: str) -> float | None:
        nonlocal count, characters
        count, characters = count + 1, characters + len(formula)
        if count > MOST_FORMULAS or characters > MOST_IN_FORMULAS:
            raise EqtError(
                f"{shown(path)}: more than {MOST_FORMULAS:,} formulas, or "
                f"{MOST_IN_FORMULAS:,} characters in them; render the template first"
            )
        try:
            parsed_formula = parse(formula.strip().replace("np.pi", "pi"), tuple(constants))
            return float(parsed_formula.evaluate(constants))
        except (InputError, ArithmeticError, TypeError, ValueError):
            return None

    def filled(match: re.Match[str]) -> str:
        statement, expression = match.groups()
        lines = "\n" * match[0].count("\n")
        if statement is not None:
            assignment = _SET.fullmatch(statement)
            if assignment is None:
                line = text.count("\n", 0, match.start()) + 1
                raise EqtError(
                    f"{shown(path)}:{line}: {{% {shortened(statement)} %}}: of Jinja, constants "
                    "alone are read; render the template first"
                )
            number = value(assignment[2])
            if number is not None:
                constants[assignment[1]] = number
            return lines
        if expression is None:
            return lines
        number = value(expression)
        return match[0] if number is None else f"{number!r}{lines}"

    return _JINJA.sub(filled, text)
