"""The YAML dialect: core-schema values with places, and every trap of YAML 1.1 closed."""

import math

import pytest
import yaml
from case_tables import from_yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from said import error_of, says

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import ConfigError
from eqt_cli.base.yaml_source import MAX_BYTES, MAX_DEPTH, dump, heading, load, parse_value

# The methods of the loader on the parser in Python, which is what PyYAML without C has.
_METHODS = {name: value for name, value in vars(yaml_source._Loader).items() if name[:2] != "__"}
_LOADERS = [type("_Loader", (yaml.SafeLoader,), _METHODS), yaml_source._Loader]


@pytest.fixture(params=_LOADERS, ids=["SafeLoader", "CSafeLoader"], autouse=True)
def _each_loader(request, monkeypatch):
    """Both parsers must give the same data and say the same."""
    monkeypatch.setattr(yaml_source, "_Loader", request.param)


def _message(text):
    return error_of(load, text, "c.yaml", kind=ConfigError)


def _set_message(text):
    return error_of(parse_value, text, "overrides[0]", kind=ConfigError)


def _nested(depth):
    """A flow mapping that holds lists, `depth` containers in all."""
    return "{a: " + "[" * (depth - 1) + "]" * (depth - 1) + "}"


# The comment at the top -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("# A wheel. It turns.\na: 1\n", "A wheel"),
        ("---\n# A wheel that\n# turns\na: 1\n", "A wheel that turns"),
        ("# yaml-language-server: $schema=a\r\n\r\n# A wheel\r\na: 1\r\n", "A wheel"),
        ("#####\n# A wheel\n#####\n#\n# It turns.\na: 1\n", "A wheel"),
        ("# found by eqt tune\na: 1\n", ""),
        ("a: 1 # A wheel\n# that turns\n", ""),
        (f"# A wheel: it {'turns ' * 30}\na: 1\n", "A wheel"),
        (f"# {'turns ' * 30}\na: 1\n", f"{'turns ' * 19}…"),
    ],
)
def test_first_sentence_of_the_comment_at_the_top(text, sentence):
    assert heading(text) == sentence
    comment = load(text, "c.yaml").comment
    assert heading(f"{comment}a: 1\n") == sentence  # what a result stores has it, too


# Values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("~", None),
        ("null", None),
        ("", None),
        ("true", True),
        ("False", False),
        ("0", 0),
        ("-12", -12),
        ("+5", 5),
        ("0x1F", 31),
        ("0o17", 15),
        ("1e-9", 1e-9),
        ("1E5", 1e5),
        ("1.", 1.0),
        ("-.5", -0.5),
        ("1.0e-9", 1e-9),
        ("01.5", 1.5),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        (".nan", math.nan),
    ],
)
def test_plain_values_are_those_of_the_core_schema(text, value):
    # By their repr, which tells 1 from 1.0 and True, and knows nan.
    assert repr(load(f"a: {text}", "c.yaml").data["a"]) == repr(value)


@pytest.mark.parametrize(
    "text",
    (
        "on off yes no y N tRue 12:30 1_000 2025-11-20 0b101 -0x1F 0o8 1e e5 1.2.3 "
        "= . + NaN inf cos(t)*sin(t) -pi/2"
    ).split(),
)
def test_other_plain_values_are_text(text):
    assert load(f"a: {text}", "c.yaml").data == {"a": text}


@pytest.mark.parametrize("text", ["'1'", '"1"', "|-\n  1", ">-\n  1"])
def test_quoted_values_are_text(text):
    assert load(f"a: {text}", "c.yaml").data == {"a": "1"}


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "---\n", "--- # x\n...\n", "\ufeff"])
def test_an_empty_document_is_an_empty_mapping(text):
    source = load(text, "c.yaml")
    assert source.data == {}
    assert source.place(("a",)) == "c.yaml:1:1"


@pytest.mark.parametrize(
    "text", ["%YAML 1.2\n---\na: [1, {b: c}]\n", "a:\n- 1\n- b: c\n", '{"a":[1,{"b":"c"}]}']
)
def test_one_document_in_several_notations(text):
    assert load(text, "c.yaml").data == {"a": [1, {"b": "c"}]}


@pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf"])
def test_bytes_are_utf8_with_or_without_a_mark(start):
    source = load(start + "a: 'é 😀'\nü: 1\r\nb: 2\rc: 3".encode(), "c.yaml")
    assert source.data == {"a": "é 😀", "ü": 1, "b": 2, "c": 3}
    assert source.key_place(("a",)) == "c.yaml:1:1"
    assert source.place(("ü",)) == "c.yaml:2:4"
    assert source.place(("c",)) == "c.yaml:4:4"


def test_aliases_give_equal_parts_that_are_not_shared():
    data = load("a: &x {k: [1, 2]}\nb: *x\n&key c: *key", "c.yaml").data
    assert data == {"a": {"k": [1, 2]}, "b": {"k": [1, 2]}, "c": "c"}
    data["a"]["k"].append(3)
    assert data["b"]["k"] == [1, 2]


# Places ---------------------------------------------------------------------------------------

_PLACED = """\
name: paper

gains: {kp: 1.0, "kd": [0.5, 2]}
controllers:
  - eqt
  - kind: family
    label: 'é'
shared: &s
  deep: 1
again: *s
"""


@pytest.mark.parametrize(
    ("path", "place"),
    [
        ((), "c.yaml:1:1"),
        (("name",), "c.yaml:1:7"),
        (("gains",), "c.yaml:3:8"),
        (("gains", "kd", 1), "c.yaml:3:30"),
        (("controllers",), "c.yaml:5:3"),
        (("controllers", 0), "c.yaml:5:5"),
        (("controllers", 1), "c.yaml:6:5"),
        (("controllers", 1, "label"), "c.yaml:7:12"),
        (("again",), "c.yaml:10:8"),
        (("again", "deep"), "c.yaml:9:9"),  # where it is written
        (("gains", "ki"), "c.yaml:3:8"),  # the nearest that exists
        (("gains", "kd", 7, "x"), "c.yaml:3:24"),
        (("name", 0), "c.yaml:1:7"),
        (("nothing", "of", "this"), "c.yaml:1:1"),
    ],
)
def test_place_of_a_value(path, place):
    assert load(_PLACED, "c.yaml").place(path) == place


@pytest.mark.parametrize(
    ("path", "place"),
    [
        (("name",), "c.yaml:1:1"),
        (("gains", "kd"), "c.yaml:3:18"),
        (("controllers", 1, "label"), "c.yaml:7:5"),
        (("again", "deep"), "c.yaml:9:3"),
        (("controllers", 1), "c.yaml:6:5"),  # an item has no key
        (("gains", "ki"), "c.yaml:3:8"),
        (("gone", "name"), "c.yaml:1:1"),
        ((), "c.yaml:1:1"),
    ],
)
def test_place_of_a_key(path, place):
    assert load(_PLACED, "c.yaml").key_place(path) == place


# Values of --set ------------------------------------------------------------------------------


def test_parse_value():
    assert parse_value("[1, 2.5, on, {kind: cos(t)}]", "set") == [1, 2.5, "on", {"kind": "cos(t)"}]
    assert parse_value("", "set") is None


@from_yaml
def test_message_for_a_value(text, message):
    assert says(_set_message(text), message)


# Errors of content ----------------------------------------------------------------------------


@from_yaml
def test_message(text, message):
    assert says(_message(text), message)


def test_message_of_many_digits():
    assert _message(f"a: {'9' * 4001}") == (
        f"c.yaml:1:4: a: {'9' * 37}... has 4001 digits; expected at most 4000"
    )


def test_all_problems_are_reported_together():
    text = "a: 1\na: 017\nb: !!int 3\n2: x\na: 3\ne: [1e999]\n"
    assert _message(text).splitlines() == [
        "c.yaml:2:1: a: duplicate key; the first is at c.yaml:1:1",
        "c.yaml:3:4: b: tag !!int is not allowed; write the value without it",
        'c.yaml:4:1: expected text as a key, got 2; write "2"',
        "c.yaml:5:1: a: duplicate key; the first is at c.yaml:1:1",
        "c.yaml:6:5: e[0]: 1e999 is too large for a floating-point number; write .inf for infinity",
    ]


# Errors of syntax -----------------------------------------------------------------------------


@from_yaml
def test_message_of_syntax(text, message):
    assert says(_message(text), message)


@pytest.mark.parametrize(
    ("text", "place", "code"),
    [
        ("a: 1\nb: '\x00'", "2:5", "0000"),
        ("a: \ud800", "1:4", "D800"),
        ("a: x\ufeff", "1:5", "FEFF"),
    ],
)
def test_message_of_characters(text, place, code):
    assert says(_message(text), f"c.yaml:{place}: character U+{code} is not allowed…")


@pytest.mark.parametrize(
    ("text", "place", "byte"),
    [(b"a: 1\r\nb: \xe9t\xe9", "2:4", "0xe9"), ("a: 1".encode("utf-16"), "1:1", "0xff")],
)
def test_message_of_bytes(text, place, byte):
    assert _message(text) == f"c.yaml:{place}: byte {byte} is not UTF-8; save the file as UTF-8"


@pytest.mark.parametrize(
    "text", ['a: "\\UFFFFFFFF"', 'a: "\\uD800"', f"%YAML {'9' * 5000}.1\n---\n"]
)
def test_what_one_parser_lets_through_or_breaks_on_is_refused(text):
    # The messages differ: Python's parser leaves such numbers to chr() and int().
    assert _message(text).startswith("c.yaml")


# Limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "of_bytes",
    [lambda size: b"#" * size, lambda size: "#" * size, lambda size: "#é" + "#" * (size - 3)],
)
def test_a_large_text_is_refused(of_bytes, monkeypatch):
    assert _message(of_bytes(MAX_BYTES + 1)) == (
        "c.yaml: expected at most 4000000 bytes, got 4000001"
    )
    # Of what is not refused every character is read, so that few must do.
    monkeypatch.setattr(yaml_source, "MAX_BYTES", 4000)
    assert load(of_bytes(4000), "c.yaml").data == {}
    assert _message(of_bytes(4001)) == "c.yaml: expected at most 4000 bytes, got 4001"


def test_the_deepest_nesting():
    assert load(_nested(MAX_DEPTH), "c.yaml").data
    assert _message(_nested(MAX_DEPTH + 1)) == (
        f"c.yaml:1:{4 + MAX_DEPTH}: a{'[0]' * (MAX_DEPTH - 1)}: nested more than 64 deep"
    )


def test_the_deepest_nesting_by_aliases():
    half = MAX_DEPTH // 2
    inner = "[" * half + "]" * half
    assert load(f"a: &a {inner}\nb: {inner[: half - 1]}*a{inner[half + 1 :]}", "c.yaml").data
    assert _message(f"a: &a {inner}\nb: {inner[:half]}*a{inner[half:]}") == (
        f"c.yaml:1:{6 + half}: b{'[0]' * (MAX_DEPTH - 1)}: nested more than 64 deep"
    )


@pytest.mark.parametrize("text", ["[" * 100_000, "? " * 100_000, "- " * 100_000, "{a: " * 100_000])
def test_bottomless_nesting_is_refused(text):
    assert _message(text).endswith("nested more than 64 deep")


def test_an_alias_bomb_is_refused(monkeypatch):
    monkeypatch.setattr(yaml_source, "MAX_VALUES", 1000)
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    assert _message("\n".join(lines)).startswith("c.yaml:1:28: a2[7][8][6]: expected at most ")


def test_the_most_values(monkeypatch):
    assert yaml_source.MAX_VALUES == 100_000  # which take seconds
    monkeypatch.setattr(yaml_source, "MAX_VALUES", 100)
    # The mapping, its key and the list are three.
    assert load(f"a: [{'1,' * 97}]", "c.yaml").data
    said = "expected at most 100000 keys and values, aliases followed, got more"
    assert _message(f"a: [{'1,' * 98}]") == f"c.yaml:1:199: a[97]: {said}"
    assert _message("a: [" + "1," * 500) == f"c.yaml:1:4: {said}"  # the end is not read


@settings(max_examples=20)
@given(st.text() | st.binary() | st.text("ab1.0: \n-[]{},&*!|>'\"%@?#\t<=~\\"))
def test_any_text_is_data_or_a_config_error(text):
    try:
        data = load(text, "c.yaml").data
    except ConfigError as error:
        problems = error.problems
    else:
        assert isinstance(data, dict)
        return
    assert problems
    assert all(problem.place.startswith("c.yaml") for problem in problems)


# Writing --------------------------------------------------------------------------------------


def test_dump_is_readable():
    data = {
        "name": "paper",
        "inertia": [[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]],
        "reference": {"torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)"], "pose": "identity"},
        "controllers": ["eqt", {"kind": "family", "gyroscopic": 0.5}],
        "solver": {"rtol": 1e-9, "atol": 1e-12, "max_error": None},
        "flags": {"on": True, "big": 1e22, "infinite": math.inf},
        "empty": {"list": [], "mapping": {}, "text": ""},
        "text": ["no", "017", "1e5", "12:30", "~", "<<", "a: b", "π"],
        "lines": "a\nb\t",
    }
    assert (
        dump(data)
        == """\
name: paper
inertia:
  - [0.824, 0, 0.12]
  - [0, 1.135, 0]
  - [0.12, 0, 1.759]
reference:
  torque: [cos(t), sin(t), cos(t)*sin(t)]
  pose: identity
controllers:
  - eqt
  - kind: family
    gyroscopic: 0.5
solver:
  rtol: 1.0e-09
  atol: 1.0e-12
  max_error: null
flags:
  'on': true
  big: 1.0e+22
  infinite: .inf
empty:
  list: []
  mapping: {}
  text: ''
text: ['no', '017', '1e5', '12:30', '~', '<<', 'a: b', π]
lines: "a\\nb\\t"
"""
    )


def test_long_lists_of_text_stand_one_to_a_line():
    words = ["x" * 30] * 3
    assert dump({"words": words}) == "words:\n" + f"  - {words[0]}\n" * 3


def test_what_occurs_twice_is_written_twice():
    row = [1, 2]
    assert dump({"a": row, "b": row}) == "a: [1, 2]\nb: [1, 2]\n"


_NUMBER_LIKE = "017 08 1e5 1e-9 0o17 0x1F 1_000 12:30 +1 .inf .nan 2025-11-20".split()
_WORD_LIKE = "no on null True ~ << = - ? # !x &x *x @ % ' \" \\".split()
_SPACED = ["", " a", "a ", "- a", "a: b", "a\nb", "\t", "\r", "\x85", "\u2028", "\ufeff", "\x00"]
_tricky = st.sampled_from(_NUMBER_LIKE + _WORD_LIKE + _SPACED)
_texts = st.text() | _tricky | st.text("-+.:019exo #'\"\n\\[]{},&*!|>%@`?~<=")
_scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | _texts
_json = st.recursive(
    _scalars, lambda inner: st.lists(inner) | st.dictionaries(_texts, inner), max_leaves=20
)


@pytest.mark.ci("writes and reads dozens of drawn documents")
@settings(max_examples=20)
@given(st.dictionaries(_texts, _json))
def test_what_is_written_is_read_back(data):
    # By their repr, which tells 1 from 1.0 and True, and 0.0 from -0.0.
    assert repr(load(dump(data), "c.yaml").data) == repr(data)
