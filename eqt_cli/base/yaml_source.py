"""Reads YAML text as plain data and records the place of every value; also writes YAML.

The dialect is YAML 1.2's core schema: ``on``, ``no``, ``12:30`` and ``1_000`` are text, ``1e-9`` is
a number. Features that a configuration does not need and that can surprise or harm are refused:
tags (``!!python`` and even ``!!str``), merge keys, duplicate keys, keys that are not text, integers
with a leading zero, numbers that overflow, several documents, anchors set twice, and excessive
sizes.
"""

import codecs
import json
import math
import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn, TypeAlias

import yaml

from eqt_cli.base.errors import MAX_PROBLEMS, ConfigError, EqtError, InputProblem, KeyPath, dotted

MAX_BYTES: Final = 4_000_000
"""Largest text, bytes of UTF-8."""

MAX_DEPTH: Final = 64
"""Deepest nesting of mappings and lists, aliases followed."""

MAX_VALUES: Final = 100_000
"""Largest number of keys and values in a document, aliases followed."""

LONGEST: Final = 120
"""Number of characters of a sentence above which `heading` ends it at a colon."""

_TOO_MANY: Final = f"expected at most {MAX_VALUES} keys and values, aliases followed, got more"
_Position: TypeAlias = tuple[int, int]  # line and column, from 1
_Scalar: TypeAlias = str | int | float | bool | None

# PyYAML is built without its C parser on some systems; the two differ in speed and wording only.
_PARSER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Source:
    """Data read from YAML, with the place of each part.

    Attributes
    ----------
    name : str
        The name of the file in places.
    data : dict
        Dicts with text keys, lists, str, int, float, bool and None; no two parts are shared.
    comment : str
        The comment at the top, with its `#` and line breaks; empty if there is none.
    located : bool
        Whether its user has the text; else, a key has its path for a place.
    """

    name: str
    data: dict[str, Any]
    _values: dict[KeyPath, _Position] = field(repr=False)
    _keys: dict[KeyPath, _Position] = field(repr=False)
    comment: str = field(default="", repr=False)
    located: bool = True

    @property
    def paths(self) -> Iterable[KeyPath]:
        """The paths of all parts."""
        return self._values

    def place(self, path: KeyPath) -> str:
        """Return ``name:line:column`` of the value at `path`, or of its nearest ancestor."""
        while path and path not in self._values:
            path = path[:-1]
        return _place(self.name, self._values.get(path, (1, 1)))

    def key_place(self, path: KeyPath) -> str:
        """Return ``name:line:column`` of the last key of `path`; without a key, as `place`."""
        if not self.located:
            return dotted(path)
        return _place(self.name, self._keys[path]) if path in self._keys else self.place(path)


def load(text: str | bytes, name: str, *, located: bool = True) -> Source:
    """Read one YAML document whose top level is a mapping; an empty document is an empty mapping.

    Raises
    ------
    ConfigError
        With every error of the content, or the first one of the syntax.
    """
    reader = _Reader(name, located=located)
    data = reader.read(text)
    if not reader.values:
        data = {}
    if not isinstance(data, dict):
        # The file may not be a configuration, so the message must not quote it.
        got = "text" if isinstance(data, str) else "a single value"
        got = "a list" if isinstance(data, list) else got
        reader.stop((), f"expected lines of 'key: value', got {got}", reader.values[()])
    return Source(name, data, reader.values, reader.keys, _comment(reader.text), located)


def heading(text: str) -> str:
    """Return the first sentence of the comment at the top; of a long one, up to a colon."""
    lines = [line.strip("#-=* \t") for line in _comment(text).splitlines()]
    words = " ".join("\n".join(lines).strip().partition("\n\n")[0].split())
    sentence = re.split(r"(?<=[.?]) (?!\()", words)[0].removesuffix(".")
    whole = sentence if len(sentence) <= LONGEST else sentence.partition(": ")[0]
    return textwrap.shorten(whole, LONGEST, placeholder=" …")


def _comment(text: str) -> str:
    """Return the comment at the top, without lines for other readers than people."""
    lines = re.findall(r"\A(?:---)?((?:[ \t\r]*(?:#.*)?\n)*)", text)[0].splitlines(keepends=True)
    for_programs = ("# yaml-language-server:", "# found by eqt ")  # an editor, and eqt
    return "".join(line for line in lines if not line.startswith(for_programs)).lstrip()


def parse_value(text: str, name: str, path: KeyPath = ()) -> Any:
    """Read one value of any kind, such as that of an override at `path`; an empty text is null.

    Raises
    ------
    ConfigError
        With every error, each at the place `name`.
    """
    return _Reader(name, located=False, below=path).read(text)


# Reading --------------------------------------------------------------------------------------


class _Loader(_PARSER):  # type: ignore[misc]  # with libyaml, if it is there
    """Composes a bounded number of nodes, of which only those with a tag in the text have one."""

    _depth = 0
    _size = 0

    def descend_resolver(self, parent: yaml.Node | None, index: object) -> None:
        # The parser in C would recurse until it crashes. `_Reader` has the exact limits, which
        # count aliases and tell the path of a node.
        self._depth += 1
        self._size += 1
        if parent and self._depth > 2 * MAX_DEPTH:
            raise yaml.MarkedYAMLError(problem="nesting depth", problem_mark=parent.start_mark)
        if parent and self._size > 2 * MAX_VALUES:
            raise yaml.MarkedYAMLError(problem="many nodes", problem_mark=parent.start_mark)

    def ascend_resolver(self) -> None:
        self._depth -= 1

    def resolve(self, kind: object, value: object, implicit: object) -> str:
        return ""


class _Reader:
    """Makes data and places of the nodes of one text."""

    def __init__(self, name: str, *, located: bool, below: KeyPath = ()) -> None:
        self.values: dict[KeyPath, _Position] = {}
        self.keys: dict[KeyPath, _Position] = {}
        self._name, self._below = name, below
        self._located = located
        self._problems: list[InputProblem] = []
        self._within: list[yaml.Node] = []

    def read(self, source: str | bytes) -> Any:
        """Return the data of the only document, or None if it is empty."""
        self.text = self._characters(source)
        try:
            root = _Loader(self.text).get_single_node()
        except yaml.MarkedYAMLError as error:
            self._stop_at_syntax(error)
        except (yaml.YAMLError, ValueError, OverflowError):
            # Python's parser gives escapes such as \UFFFFFFFF to chr() and int() unchecked.
            self.stop((), "an escape or a directive (%) is not valid YAML", None)
        data = None if root is None else self._value(root, (), _mark(root.start_mark))
        if self._problems:
            raise ConfigError(self._problems)
        if data is None and (root is None or root.value == ""):
            self.values.clear()  # of an empty document
        return data

    def stop(self, path: KeyPath, message: str, position: _Position | None) -> NoReturn:
        """Report an error after which reading cannot continue."""
        self._report(path, message, position)
        raise ConfigError(self._problems)

    def _report(self, path: KeyPath, message: str, position: _Position | None) -> None:
        whole = dotted((*self._below, *path))
        self._problems.append(InputProblem(whole, message, self._place(position)))
        if len(self._problems) == MAX_PROBLEMS:
            more = InputProblem("", f"and perhaps more; only the first {MAX_PROBLEMS} are shown")
            raise ConfigError([*self._problems, more])

    def _place(self, position: _Position | None) -> str:
        return _place(self._name, position if self._located else None)

    def _characters(self, source: str | bytes) -> str:
        size = len(source if isinstance(source, bytes) else source.encode("utf-8", "surrogatepass"))
        if size > MAX_BYTES:
            self.stop((), f"expected at most {MAX_BYTES} bytes, got {size}", None)
        if isinstance(source, bytes):
            source = source.removeprefix(codecs.BOM_UTF8)
            try:
                text = source.decode()
            except UnicodeDecodeError as error:
                before = source[: error.start].decode()
                message = f"byte 0x{source[error.start]:02x} is not UTF-8; save the file as UTF-8"
                self.stop((), message, _position(before, len(before)))
        else:
            text = source.removeprefix("\ufeff")
        invalid = _INVALID.search(text)
        if invalid:
            message = (
                f"character U+{ord(invalid.group()):04X} is not allowed; "
                "remove it, or write it as an escape in double quotes"
            )
            self.stop((), message, _position(text, invalid.start()))
        return text

    def _value(self, node: yaml.Node, path: KeyPath, position: _Position) -> Any:
        """Return the value of a node, which an alias at the position may refer to."""
        self.values[path] = position
        if len(self.values) + len(self.keys) > MAX_VALUES:
            self.stop(path, _TOO_MANY, position)
        self._check_tag(node, path, position)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, path, position)
        if node in self._within:
            self._report(path, "the alias is part of what it refers to", position)
            return None
        self._within.append(node)
        if len(self._within) > MAX_DEPTH:
            self.stop(path, f"nested more than {MAX_DEPTH} deep", position)
        value: Any = []
        if isinstance(node, yaml.MappingNode):
            value = self._mapping(node, path)
        else:
            last = node.start_mark.index
            for item in node.value:
                # The node of an alias stands further up, so that the place is that of the list.
                place = item if item.start_mark.index > last else node
                last = max(last, item.start_mark.index)
                value.append(self._value(item, (*path, len(value)), _mark(place.start_mark)))
        self._within.pop()
        return value

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            position = _mark(key_node.start_mark)
            key = self._key(key_node, path, position)
            if key is None:
                continue
            key_path = (*path, key)
            if key in mapping:
                first = f"; the first is at {self._place(self.keys[key_path])}"
                self._report(key_path, f"duplicate key{first if self._located else ''}", position)
                continue
            self.keys[key_path] = position
            position = _mark(value_node.start_mark)
            if value_node.start_mark.index < key_node.start_mark.index:
                # The node of an alias stands further up; only the text tells where the alias is.
                end = key_node.end_mark
                after = self.text[end.index : end.index + _LONGEST_KEY].partition("*")[0]
                line, column = _position(after, len(after))
                position = end.line + line, column + (end.column if line == 1 else 0)
            mapping[key] = self._value(value_node, key_path, position)
        return mapping

    def _key(self, node: yaml.Node, path: KeyPath, position: _Position) -> str | None:
        """Return the text of a key, or None after reporting that it is not text."""
        if isinstance(node, yaml.ScalarNode) and (
            node.style or not _NOT_TEXT.fullmatch(node.value)
        ):
            path = (*path, node.value)
            self._check_tag(node, path, position)
            return str(self._scalar(node, path, position))
        message = "expected a key before ':'"
        if not isinstance(node, yaml.ScalarNode):
            got = "a mapping" if isinstance(node, yaml.MappingNode) else "a list"
            message = f"expected text as a key, got {got}"
        elif node.value == "<<":
            message = "merge keys (<<) are not supported; write out the keys to merge"
        elif node.value:
            text = _short(node.value)
            message = f'expected text as a key, got {text}; write "{text}"'
        self._report(path, message, position)
        return None

    def _scalar(self, node: yaml.ScalarNode, path: KeyPath, position: _Position) -> _Scalar:
        if _BARE_TAG.match(self.text, node.start_mark.index):
            self._report(path, "tag ! is not allowed; write the value without it", position)
        if not node.style:
            try:
                return _resolved(node.value)
            except ValueError as error:
                self._report(path, str(error), position)
        elif _SURROGATE.search(node.value):
            self._report(path, "an escape for half a surrogate pair is no character", position)
        return str(node.value)

    def _check_tag(self, node: yaml.Node, path: KeyPath, position: _Position) -> None:
        if node.tag:
            tag = _short(node.tag.replace("tag:yaml.org,2002:", "!!"))
            self._report(path, f"tag {tag} is not allowed; write the value without it", position)

    # Syntax

    def _stop_at_syntax(self, error: yaml.MarkedYAMLError) -> NoReturn:
        """Report an error of the parser in our own words."""
        problem, context = str(error.problem), str(error.context)
        here = error.problem_mark or error.context_mark
        start = error.context_mark or here
        if here is None or start is None:
            self.stop((), "invalid YAML", None)
        if "nesting depth" in problem:  # libyaml has a bound of its own
            self.stop((), f"nested more than {MAX_DEPTH} deep", _mark(here))
        before, at_here = _split(self.text, here)
        opening = _split(self.text, start)[1][:1]
        since = f" that starts at {self._place(_mark(start))}" if self._located else ""
        if "flow" in context:
            self._stop_in_brackets(before, at_here, opening, _mark(here), _mark(start), since)
        character = at_here[:1]
        if "cannot start any token" in problem or "tab" in problem.split():
            message = f"a value cannot start with {character!r}; quote it"
            if character == "\t":
                message = "a tab cannot stand here; use spaces"
            self.stop((), message, _mark(here))
        in_collection = "block" in context and not {"node", "scalar"} & set(context.split())
        if in_collection and before.strip():
            message = f"unexpected {character!r} after a value; quote the whole value"
            self.stop((), message, _mark(here))
        name = _short(re.split(r"[^\w-]", at_here[1:], maxsplit=1)[0])  # of an anchor
        for in_context, in_problem, at_start, template in _SYNTAX:
            if in_context in context and in_problem in problem:
                message = template.format(
                    opening=opening, character=character, since=since, name=name
                )
                self.stop((), message, _mark(start if at_start else here))
        self.stop((), "invalid YAML", _mark(here))

    def _stop_in_brackets(
        self, before: str, after: str, opening: str, here: _Position, start: _Position, since: str
    ) -> None:
        """Report an error within a list or mapping in brackets, if it is a known one."""
        if not after.strip():
            if opening in ("[", "{"):
                self.stop((), f"the '{opening}' is never closed", start)
            self.stop((), "a '[' or '{' is never closed", here)
        # The key around a bracket that the parser takes for the start of a list
        begin = _KEY_START.search(before[-_LONGEST_KEY:])
        end = _KEY_REST.match(after[:_LONGEST_KEY])
        if opening == "{" and begin and end:
            key = begin[0] + end[1]
            quoted = f'{{"{_short(key)}": …}}'
            at_key = here[0], here[1] - key.index("[")
            self.stop((), f"a key with a bracket must be quoted here: {quoted}", at_key)
        if opening in ("[", "{"):
            closing, collection = ("]", "list") if opening == "[" else ("}", "mapping")
            self.stop((), f"expected ',' or '{closing}' in the {collection}{since}", here)


_LONGEST_KEY: Final = 200  # the search takes time quadratic in this
_KEY_START: Final = re.compile(r"[^\s,:\"'\[\]{}]+$")
_KEY_REST: Final = re.compile(r"((?:\[[^\s,\[\]{}]*\][^\s,:\[\]{}]*)+)\s*:")


_QUOTE: Final = "; quote text that starts with it"

# Errors of both parsers: a part of the context, a part of the problem, whether the place is the
# start of the context, and our message. The first row that matches is used.
_SYNTAX: Final = (
    ("", "many nodes", False, _TOO_MANY),
    ("", "another document", False, "a second document starts here; expected only one"),
    ("", "undefined alias", False, "*{name} refers to nothing; no &{name} comes before it"),
    ("duplicate anchor", "", False, "&{name} is set a second time; choose another name"),
    ("quoted scalar", "unexpected", True, "the quote {opening} is never closed"),
    ("quoted scalar", "", True, "unknown escape in this text; use single quotes, or \\\\ for \\"),
    ("alias", "", True, f"'*' starts a reference{_QUOTE}"),
    ("anchor", "", True, f"'&' starts an anchor{_QUOTE}"),
    ("block scalar", "", True, f"'{{opening}}' starts a block of text{_QUOTE}"),
    ("tag", "", True, f"'!' starts a tag, which is not allowed{_QUOTE}"),
    ("", "tag", False, f"'!' starts a tag, which is not allowed{_QUOTE}"),
    ("directive", "", True, f"'%' starts a directive{_QUOTE}"),
    ("", "directive", False, f"'%' starts a directive{_QUOTE}"),
    ("", "incompatible YAML", False, "expected YAML 1.1 or 1.2"),
    ("", "document start", False, "unexpected text after the end of the document"),
    ("", "mapping values", False, "unexpected ':'; check the indentation, or quote the text"),
    ("", "mapping keys", False, f"unexpected '?'{_QUOTE}"),
    ("", "sequence entries", False, "a list cannot start here; start it on a new line"),
    ("simple key", "expected ':'", True, "expected ':' after this text, or '- ' before it"),
    ("", "node content", False, f"unexpected {{character!r}}{_QUOTE}"),
    ("block mapping", "", False, "expected a key of the mapping{since}; check the indentation"),
    ("block", "", False, "expected a '- ' of the list{since}; check the indentation"),
)


# Characters and positions ---------------------------------------------------------------------

# What YAML allows takes ten times as long to compile, for its characters beyond U+FFFF.
_INVALID: Final = re.compile(
    "[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ud800-\udfff\ufeff\ufffe\uffff]"
)
# A tag without a name, which PyYAML's nodes do not tell of; an anchor may come before it.
_BARE_TAG: Final = re.compile(r"(?:&\S+(?:\s|#.*\n)+)?!(?:\s|\Z)")
_SURROGATE: Final = re.compile("[\ud800-\udfff]")
_LINE_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # as the parsers count them


def _position(text: str, offset: int) -> _Position:
    starts = [0, *(match.end() for match in _LINE_BREAK.finditer(text, 0, offset))]
    return len(starts), offset - starts[-1] + 1


def _split(text: str, mark: Any) -> tuple[str, str]:
    """Return the text before `mark` on its line, and the rest of the text."""
    starts = [0, *(match.end() for match in _LINE_BREAK.finditer(text)), len(text)]
    line = starts[min(mark.line, len(starts) - 1)]
    return text[line : line + mark.column], text[line + mark.column :]


def _mark(mark: Any) -> _Position:
    return mark.line + 1, mark.column + 1


def _place(name: str, position: _Position | None) -> str:
    return name if position is None else f"{name}:{position[0]}:{position[1]}"


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


# Scalars --------------------------------------------------------------------------------------

_WORDS: Final[dict[str, bool | None]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INTEGER: Final = re.compile(r"[-+]?[0-9]+")
_BASED_INTEGER: Final = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT: Final = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_SPECIAL_FLOAT: Final = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_NUMBER: Final = re.compile(
    "|".join(p.pattern for p in (_INTEGER, _BASED_INTEGER, _FLOAT, _SPECIAL_FLOAT))
)
_NOT_TEXT: Final = re.compile(f"<<|{_NUMBER.pattern}|{'|'.join(_WORDS)}")
_MAX_DIGITS: Final = 4000  # Python refuses to convert more than 4300


def _resolved(text: str) -> _Scalar:
    """Return the value of a plain scalar in YAML 1.2's core schema.

    Raises
    ------
    ValueError
        If it looks like a number but is ambiguous or too large; the message is for users.
    """
    if text in _WORDS:
        return _WORDS[text]
    if _BASED_INTEGER.fullmatch(text):
        return int(text[2:], 8 if text[1] == "o" else 16)
    if _INTEGER.fullmatch(text):
        return _integer(text)
    if _FLOAT.fullmatch(text):
        value = float(text)
        if math.isinf(value):
            raise ValueError(
                f"{_short(text)} is too large for a floating-point number; write .inf for infinity"
            )
        return value
    if _SPECIAL_FLOAT.fullmatch(text):
        return float(text.replace(".", ""))
    return text


def _integer(text: str) -> int:
    digits = text.lstrip("+-")
    if len(digits) > _MAX_DIGITS:
        raise ValueError(f"{_short(text)} has {len(digits)} digits; expected at most {_MAX_DIGITS}")
    value = int(text)
    if digits[0] == "0" and len(digits) > 1:
        octal = ""
        if value and not set(digits) & {"8", "9"}:
            octal = f" or {-int(digits, 8)}" if value < 0 else f" or 0o{digits.lstrip('0')}"
        raise ValueError(f"{_short(text)} is ambiguous: write {value}{octal}")
    return value


# Writing --------------------------------------------------------------------------------------

_WIDTH: Final = 200  # fits a row of a 9×9 matrix at full precision
_SHORT_WIDTH: Final = 80


def dump(data: dict[str, Any]) -> str:
    """Return readable YAML, which `load` reads back as equal `data`.

    Keys keep their order. Lists of numbers and short lists of scalars are on one line, matrices one
    row per line. Text that YAML 1.1 or 1.2 would read as another type is quoted.
    """
    return yaml.dump(
        data,
        Dumper=_Dumper,
        default_flow_style=False,
        sort_keys=False,
        allow_unicode=True,
        width=_WIDTH,
    )


def flow(value: Any) -> str:
    """Return a value as YAML on one line; JSON is valid YAML, but for NaN and Infinity."""
    text = json_of(value)
    if re.search("NaN|Infinity", text):
        text = yaml.safe_dump(json.loads(text), default_flow_style=True, width=math.inf)
    return text.removesuffix("...\n").strip()


def json_of(value: Any) -> str:
    """Return a value as JSON, with NaN and Infinity as Python reads them."""
    try:
        return json.dumps(value, default=_listed)
    except TypeError as error:
        raise EqtError(
            f"{error}: a configuration holds numbers, text, lists and mappings"
        ) from error


def _listed(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(repr(value))


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True  # repeated values are written out

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)  # lists are indented below their key


def _represent_list(dumper: _Dumper, items: Sequence[Any]) -> yaml.Node:
    numbers = all(isinstance(item, (int, float)) for item in items)
    short = all(item is None or isinstance(item, (str, int, float)) for item in items) and (
        sum(len(str(item)) + 2 for item in items) <= _SHORT_WIDTH
    )
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=numbers or short)


def _represent_text(dumper: _Dumper, text: str) -> yaml.Node:
    # Other quotes would fold NEL and similar characters, which are line breaks in YAML 1.1.
    style = None if text.isprintable() else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(str, _represent_text)
# No representer uses this tag, so plain text that `load` would read as a number is quoted.
_Dumper.add_implicit_resolver(
    "!number", re.compile(rf"(?:{_NUMBER.pattern})\Z"), list("-+.0123456789")
)
