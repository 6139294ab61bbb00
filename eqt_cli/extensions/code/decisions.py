"""Finds the decisions in a C text, and writes the text so that it keeps their outcomes.

A decision is a comparison, a condition, or a label of `switch`. The text comes from the
preprocessor. It is cut into tokens, not parsed: an operand ends at the next operator that binds
less. What is written otherwise than that does not compile, or computes other numbers, and whoever
uses it compares them.
"""

import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

WATCHING = Path(__file__).parent / "decisions.h"

_TOKEN = re.compile(
    r"(?P<marker>^[ \t]*#[^\n]*)|(?P<space>\s+)"
    r"|(?P<text>\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*')"
    r"|(?P<number>\.?\d(?:[eEpP][+-]|[\w.])*)|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>->|\+\+|--|<<=|>>=|[-+*/%&|^<>=!]=|<<|>>|&&|\|\||.)",
    re.MULTILINE | re.DOTALL,
)
_MARKER = re.compile(r"\s*#\s*(?:line\s+)?(\d+)\s+\"([^\"]*)\"(.*)")

_ORDER, _EQUAL = ("<", ">", "<=", ">="), ("==", "!=")
_SET = ("=", "+=", "-=", "*=", "/=", "%=", "&=", "|=", "^=", "<<=", ">>=")
_BEFORE = {"(", "[", "{", "}", ";", ",", "?", ":", "return", "case", "else", "do", *_SET}
_LOOSER = {*_BEFORE, ")", "]", "&&", "||", *_ORDER, *_EQUAL, "^", "|"}
_CONTROL = ("if", "while", "for", "switch")
_OPENED = {"(": ")", "[": "]", "{": "}"}


@dataclass(frozen=True)
class Decision:
    """A decision of a text.

    Attributes
    ----------
    file, line
        Where it stands.
    text
        The comparison or condition as it is written.
    function
        The number of the function that it stands in.
    is_label
        Whether it is a label or the start of a function, which is reached or not.
    is_function
        Whether it is the start of a function.
    """

    file: str
    line: int
    text: str
    function: int
    is_label: bool = False
    is_function: bool = False

    @property
    def place(self) -> str:
        """File and line."""
        return f"{self.file}, line {self.line}"


@dataclass
class _Token:
    text: str
    kind: str
    span: tuple[int, int]
    file: str
    line: int
    is_users: bool
    other: int = -1
    """The place of the other bracket of a pair."""


FIRST = -math.inf
"""Order of what is added before all else at a place."""


def watched(text: str, files: Collection[str]) -> tuple[str, tuple[Decision, ...]]:
    """Return a preprocessed text that keeps the outcomes of its decisions, and these.

    Parameters
    ----------
    files
        The user's files, by their names in the markers of lines.
    """
    return _Text(text, files).watched()


class _Text:
    def __init__(self, text: str, files: Collection[str]) -> None:
        self.text, self.tokens = text, list(_tokens(text, files))
        self.decisions: list[Decision] = []
        self.added: list[tuple[int, float, str]] = []
        opened: list[int] = []
        for place, token in enumerate(self.tokens):
            if token.text in _OPENED:
                opened.append(place)
            elif opened and token.text == _OPENED[self.tokens[opened[-1]].text]:
                token.other = opened.pop()
                self.tokens[token.other].other = place

    def watched(self) -> tuple[str, tuple[Decision, ...]]:
        for function, (place, name) in enumerate(self._called()):
            self._label(place, function, name, True)
            self._body(place + 1, self.tokens[place].other, function)
        parts, end = [WATCHING.read_text(encoding="utf-8")], 0
        for at, _, text in sorted(self.added):
            parts += [self.text[end:at], text]
            end = at
        return "".join([*parts, self.text[end:]]), tuple(self.decisions)

    def _called(self) -> list[tuple[int, str]]:
        """Return the user's functions that a call can reach: where the body begins, and the name.

        A header may have many that this law does not need.
        """
        bodies: dict[int, str] = {}
        others: set[str] = set()
        place = 0
        while place < len(self.tokens):
            token = self.tokens[place]
            if token.text == "{" and token.other > place:
                if token.is_users and self._text(place - 1) == ")":
                    name = self.tokens[place - 1].other - 1
                    while self._text(name) == "__attribute__":
                        name = self.tokens[name - 1].other - 1
                    bodies[place] = self._text(name)
                else:  # eqt's own calls, or a table of functions
                    others.update(self._words(place, token.other))
                place = token.other
            place += 1
        called: dict[int, str] = {}
        while more := [at for at in bodies.keys() - called if bodies[at] in others]:
            called.update((at, bodies[at]) for at in more)
            others.update(*(self._words(at, self.tokens[at].other) for at in more))
        return sorted(called.items())

    def _body(self, start: int, stop: int, function: int) -> None:
        constant = start
        for place in range(start, stop):
            token = self.tokens[place]
            if place < constant or not token.is_users:
                continue
            if token.text in ("static", "_Static_assert"):
                constant = self._first(place, ";")
            elif token.text in ("enum", "struct", "union"):
                constant = self._after_fields(place)
            elif token.text in ("case", "default"):
                constant = self._first(place, ":")
                self._label(constant, function, self._shown(place, constant - 1))
            elif token.text in (*_ORDER, *_EQUAL):
                self._comparison(place, function)
            elif token.text in ("if", "while") and self._text(place + 1) == "(":
                self._condition(place + 2, self.tokens[place + 1].other - 1, function)
            elif token.text == "for":
                first = self._first(place + 2, ";")
                self._condition(first + 1, self._first(first + 1, ";") - 1, function)
            elif token.text == "?":
                self._condition(self._begin(place - 1, _BEFORE), place - 1, function)

    def _comparison(self, place: int, function: int) -> None:
        sign = self.tokens[place].text
        begin, end = self._begin(place - 1, _LOOSER), self._end(place + 1)
        around = {self._text(begin - 1), self._text(end + 1)}
        chained = {*_ORDER, *_EQUAL} if sign in _EQUAL else {*_ORDER}
        if not begin < place < end or around & chained or "sizeof" in self._words(begin, end):
            return
        number = self._decision(begin, self._shown(begin, end), function)
        self._around(
            begin,
            end,
            "(__extension__({__auto_type eqt_l=(",
            f");eqt_decided({number},EQT_NUMBER(eqt_l)-EQT_NUMBER(eqt_r),eqt_l {sign} eqt_r);}}))",
        )
        start, stop = self.tokens[place].span
        self.added += [(start, 0, ");__auto_type eqt_r=(/*"), (stop, FIRST, "*/")]

    def _condition(self, begin: int, end: int, function: int) -> None:
        words = self._words(begin, end)
        compared = sum(word in (*_ORDER, *_EQUAL) for word in words)
        is_one = compared == 1 and not {"&&", "||", "?", "!"} & set(words)
        is_constant = all(self.tokens[k].kind == "number" for k in range(begin, end + 1))
        if is_one or is_constant or "sizeof" in words:
            return
        shown = self._shown(begin, end)
        number = self._decision(begin, shown, function)
        self._around(
            begin, end, f"eqt_decided({number},EQT_TESTED({shown.lstrip('! ')}),(", ")?1:0)"
        )

    def _label(self, place: int, function: int, text: str, is_function: bool = False) -> None:
        number = self._decision(place, text, function, True, is_function)
        call = f"(void)eqt_decided({number},0.0,1);"
        self.added.append((self.tokens[place].span[1], FIRST, call))

    def _decision(self, place: int, *about: Any) -> int:
        """Add a decision that begins at a place, and return its number."""
        token = self.tokens[place]
        self.decisions.append(Decision(token.file, token.line, *about))
        return len(self.decisions) - 1

    def _around(self, begin: int, end: int, before: str, after: str) -> None:
        start, stop = self.tokens[begin].span[0], self.tokens[end].span[1]
        # The longer one begins first and ends last.
        self.added += [(start, -stop, before), (stop, -start, after)]

    def _begin(self, place: int, stops: set[str]) -> int:
        """Return where the operand that ends at a place begins."""
        while place >= 0:
            token = self.tokens[place]
            if token.text in (")", "]") and token.other >= 0:
                if self._text(token.other - 1) in _CONTROL:
                    break
                place = token.other
            elif token.text in stops or (token.text == "&" and self._is_operand(place - 1)):
                break
            place -= 1
        return place + 1

    def _end(self, place: int) -> int:
        """Return where the operand that begins at a place ends."""
        first = place
        while place < len(self.tokens):
            token = self.tokens[place]
            if token.text in _OPENED and token.other > place:
                place = token.other
            elif token.text in _LOOSER or (token.text == "&" and place > first):
                break
            place += 1
        return place - 1

    def _is_operand(self, place: int) -> bool:
        token = self.tokens[place]
        is_word = token.kind in ("name", "number")
        return token.text in (")", "]") or (is_word and token.text not in _BEFORE)

    def _first(self, place: int, text: str) -> int:
        while place < len(self.tokens) - 1 and self.tokens[place].text != text:
            place = max(place, self.tokens[place].other) + 1
        return place

    def _text(self, place: int) -> str:
        return self.tokens[place].text if 0 <= place < len(self.tokens) else ""

    def _words(self, begin: int, end: int) -> list[str]:
        return [token.text for token in self.tokens[begin : end + 1]]

    def _shown(self, begin: int, end: int) -> str:
        text = self.text[self.tokens[begin].span[0] : self.tokens[end].span[1]]
        return " ".join(re.sub(r"^[ \t]*#.*$", "", text, flags=re.MULTILINE).split())

    def _after_fields(self, place: int) -> int:
        """Return the place behind the fields of a type, if they are given, which are constant."""
        while self.tokens[place + 1].kind == "name":
            place += 1
        opened = self.tokens[place + 1]
        return opened.other if opened.text == "{" else place


def _tokens(text: str, files: Collection[str]) -> Iterator[_Token]:
    file, line, is_users = "", 1, False
    for match in _TOKEN.finditer(text):
        kind, said = str(match.lastgroup), match[0]
        if kind == "marker":
            if marker := _MARKER.match(said):
                file, line = marker[2], int(marker[1]) - 1
                is_users = file in files and "3" not in marker[3].split()  # 3: a system's macro
        elif kind != "space":
            yield _Token(said, kind, match.span(), file, line, is_users)
        line += said.count("\n")
