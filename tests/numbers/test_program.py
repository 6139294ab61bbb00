"""A function as a program: the same numbers, by as few operations as its structure allows."""

import re

import numpy as np
import pytest
from case_tables import refusal

from eqt_cli.base import arrays
from eqt_cli.base.arrays import FUNCTIONS, less, smooth_less, where
from eqt_cli.extend import parse
from eqt_cli.numbers.c_code import c_function, c_name, distinct
from eqt_cli.numbers.jets import Jet, series
from eqt_cli.numbers.program import _NUMPY, ArrayProgram, Chain, Input, Operation, fused, traced


def evaluated(program, **inputs):
    """What a program returns, for one run."""
    by_numpy = ArrayProgram(program, 1)
    for group, numbers in inputs.items():
        by_numpy.inputs[group][:, 0] = numbers
    return {name: values[..., 0] for name, values in by_numpy().items()}


def program_of(function, length=4):
    """The program of a function of a vector."""
    return traced(lambda given: {"y": np.asarray(function(given["x"]))}, {"x": length})


def operations(function):
    """The names of the operations of a function, in their order."""
    return names(program_of(function))


def names(program):
    return [value.name for value in program.values if isinstance(value, Operation)]


def everything(x):
    """Every operation, on what each is defined for."""
    a, b, c, d = x
    rotation = np.array([[a, -b, 1.0], [b, a, 0.0], [c, -d, -1.0]], dtype=x.dtype)
    return arrays.stack(
        [
            *(rotation[:, None] * rotation * np.array([d, -c, 2.0], dtype=x.dtype))
            .sum(axis=-1)
            .flat,
            (a - b) / (c - 3.0) + (b - a) * -d - -a / 7.0 + 2.0 / -b,
            1.0 - (d - 0.5) / 4.0,
            where(less(a, b), c, -d) - where(less(b, a), c, -d),
            where(smooth_less(c * d, 0.1), arrays.absolute(a - b), 0.5),
            arrays.clip(a * 3, -b, b),
            *(
                getattr(np, name)(a) if x.dtype == float else arrays.apply(name, a)
                for name in FUNCTIONS
                if name != "acosh"
            ),
            arrays.apply("acosh", 1 + a * a),
            a**2.5,
        ]
    )


@pytest.mark.parametrize("seed", range(5))
def test_a_program_rounds_as_its_function_does(seed):
    """Bit for bit: nothing is regrouped."""
    x = np.random.default_rng(seed).uniform(0.05, 0.95, 4)
    program = program_of(everything)
    known = "add subtract multiply divide negative less smooth_less select pow".split()
    assert {*names(program)} >= {*known, *FUNCTIONS} - {"abs"}
    np.testing.assert_array_equal(evaluated(program, x=x)["y"], everything(x))


@pytest.mark.parametrize(
    ("function", "expected"),
    {
        "equal operations": (lambda x: x[0] * x[1] + x[1] * x[0], "multiply add"),
        "0 and 1 in sums and products": (lambda x: 0.0 + 1.0 * x[0] - 0.0 * x[1], ""),
        "minus 1": (lambda x: x[0] + -1.0 * x[1], "subtract"),
        "signs of products": (lambda x: -x[0] * x[1] + (-x[2]) * (-x[3]),
            "multiply multiply subtract"),
        "signs of quotients": (lambda x: -x[0] / x[1] - x[0] / x[1], "divide add negative"),
        "a difference and its negative":
            (lambda x: [x[0] - x[1], x[1] - x[0]], "subtract negative"),
        "a negative of a negative": (lambda x: -(0.0 - x[0]), ""),
        "a sign and a number": (lambda x: -(2.0 * x[0]), "multiply"),
        "numbers alone": (lambda x: x[0] * ((x[1] * 0 + 3.0) / 7.0 - 3.0 / 7.0), ""),
        "a product with a power of 2": (lambda x: x[0] / 4.0 + x[0] * 0.25, "multiply add"),
        "and with its negative": (lambda x: x[0] / -4.0 + x[1] + x[0] * -0.25, "multiply add add"),
        "a quotient that overflows": (lambda x: x[0] / 2.0**-1074, "divide"),
        "what nothing needs": (lambda x: [x[0] * x[1], x[2]][1], ""),
        "equal choices": (lambda x: where(less(x[0], x[1]), x[2], x[2]), ""),
        "a comparison of numbers": (lambda x: where(less(x[0] * 0, 1.0), x[2], x[3]), ""),
        "a comparison of equal numbers":
            (lambda x: where(less(x[0] * 0 + 1.0, 1.0), x[2] * x[3], x[3]), ""),
        "whole powers": (lambda x: x[0] ** 5 + x[0] ** 4, "multiply multiply multiply add"),
        "negative powers": (lambda x: x[0] ** -2, "multiply divide"),
        "half powers": (lambda x: x[0] ** 0.5 + x[1] ** 0, "sqrt add"),
        "other powers": (lambda x: x[0] ** -2.5, "pow divide"),
        "a function of a number": (lambda x: arrays.sin(0 * x[0] + 0.5), "sin"),
    }.values(),
)  # fmt: skip
def test_operations_that_are_left(function, expected):
    assert sorted(operations(function)) == sorted(expected.split())


def test_equal_functions_have_equal_programs():
    one, other = (program_of(lambda x: everything(x)) for _ in range(2))
    assert one == other
    assert hash(one) == hash(other)
    assert program_of(lambda x: x[0] + x[1]) == program_of(lambda x: x[1] + x[0])
    assert program_of(lambda x: x[0] - x[1]) != program_of(lambda x: x[1] - x[0])


def test_what_belongs_together_stands_together():
    """All products first, then their sum: that is how NumPy goes, and would keep 32 numbers."""

    def function(x):
        products = x[:32] * x[32:]
        return products.sum()

    values = program_of(function, 64).values
    last = {
        operand: place
        for place, value in enumerate(values)
        if isinstance(value, Operation)
        for operand in value.operands
    }
    kept = [
        sum(
            isinstance(values[at], Operation) and at <= place < last.get(at, at)
            for at in range(place + 1)
        )
        for place in range(len(values))
    ]
    assert max(kept) <= 6  # log₂ 32, and one


@pytest.mark.parametrize(
    "function",
    [
        lambda x: x[0] * x[1] * x[2] * x[3] + arrays.sin(x[2]),
        lambda x: arrays.sin(x[2]) + x[0] * x[1] * x[2] * x[3],
        lambda x: where(less(x[1], x[0]), x[0] * x[1] * x[2] * x[3], arrays.sin(x[2]))[()],
    ],
    ids=["first in a sum", "last in a sum", "in a choice"],
)
def test_the_longest_chain_is_computed_first(function):
    """So that the result of a shorter one does not wait for it."""
    assert operations(function)[:3] == ["multiply"] * 3


def test_a_comparison_of_symbols_has_no_truth_value():
    assert refusal(TypeError, program_of, lambda x: x[0] if less(x[0], x[1]) else x[1]) == (
        "a symbol has no truth value; choose by where(less(a, b), x, y)"
    )


def test_arrays_that_a_program_returns_keep_their_shapes():
    program = traced(
        lambda given: {"sum": given["x"].sum(), "matrix": np.outer(given["x"], given["z"])},
        {"x": 2, "unused": 1, "z": 3},
    )
    found = evaluated(program, x=[1.0, 2.0], z=[3.0, 4.0, 5.0])
    np.testing.assert_array_equal(found["sum"], 3.0)
    np.testing.assert_array_equal(found["matrix"], [[3, 4, 5], [6, 8, 10]])
    assert program.inputs == (("x", 2), ("unused", 1), ("z", 3))


def test_runs_are_evaluated_side_by_side_and_again():
    """Where inputs are outputs, too, and results stay when other numbers follow."""
    x = np.random.default_rng(5).uniform(0.05, 0.95, (4, 7))
    program = traced(lambda given: {"y": everything(given["x"]), "x": given["x"]}, {"x": 4})
    by_numpy = ArrayProgram(program, 7)
    by_numpy.inputs["x"][...] = x
    first = by_numpy()
    by_numpy.inputs["x"][...] = x[:, ::-1]
    for found, runs in ((first, x), (by_numpy(), x[:, ::-1])):
        np.testing.assert_array_equal(found["x"], runs)
        np.testing.assert_allclose(found["y"].T, [everything(run) for run in runs.T], rtol=1e-15)


def test_derivatives_of_expressions_are_programs():
    expression = parse("sin(t)**2 + t**3/(1 + t*t) + exp(-t) + sqrt(t) + 2**t")

    def derivatives(x):
        found = series(expression, {"t": x[0]}, 2)
        return [found.derivative(k) for k in range(3)]

    program, expected = program_of(derivatives, 1), derivatives([0.7])
    np.testing.assert_allclose(evaluated(program, x=[0.7])["y"], expected, rtol=1e-14)


# In C ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compiler", ["cc", "c++"])
def test_c_gives_the_same_as_numpy(in_c, compiler):
    """But for functions, which the library of C may round in another way, by a last place."""
    x = np.random.default_rng(1).uniform(0.05, 0.95, 4)
    program = program_of(everything)
    found = in_c(program, compiler, x=x)["y"]
    np.testing.assert_allclose(found, everything(x), rtol=1e-15, atol=0)
    np.testing.assert_array_equal(found[:14], everything(x)[:14])


def _all_functions(x, apply):
    """The functions that choose between numbers, of x and y."""
    texts = ("min(x, y)", "max(x, y)", "sign(x)", "step(x, y)", "smoothstep(0.5, x, y)")
    texts += ("atan2(x, y)", "where(x < y, 1, 2)", "min(max(x, -1), y)", "abs(x)")
    of_two = {"x": x[0], "y": x[1]}
    found = [parse(text, ("x", "y")).evaluate(of_two) for text in texts]
    found += [arrays.clip(x[0], -1.0, 1.0), arrays.clip(0.5, x[0], x[1])]
    return apply([arrays.unwrapped(each) for each in found])


SPECIAL = [-np.inf, -2.0, 0.0, 0.5, 3.0, np.inf, np.nan]


@pytest.mark.parametrize("x", SPECIAL)
@pytest.mark.parametrize("y", SPECIAL)
def test_functions_that_choose_choose_no_number_for_nan(x, y):
    """NumPy's own functions keep NaN; the others are NaN where an argument is."""
    with np.errstate(all="ignore"):
        s = (0.5 - x) / np.subtract(y, x)
        both = np.nan if np.isnan(x) or np.isnan(y) else 0.0
        s = np.clip(s, 0.0, 1.0)
        expected = [np.minimum(x, y), np.maximum(x, y), np.sign(x), both + (x >= y)]
        expected += [s * s * (3 - 2 * s), np.nan, both + (1.0 if x < y else 2.0)]
        expected += [np.minimum(np.maximum(x, -1), y), np.abs(x)]
        expected += [np.clip(x, -1.0, 1.0), np.minimum(np.maximum(0.5, x), y)]
        expected[5] = np.arctan2(x, y) if abs(x) != abs(y) or 0 < abs(x) < 9 else np.nan
        traced_ = evaluated(program_of(lambda z: _all_functions(z, np.array), 2), x=[x, y])["y"]
        at = [Jet([np.float64(x), 1.0]), Jet([np.float64(y), None])]
        ways = {
            "floats": _all_functions([np.float64(x), np.float64(y)], np.array),
            "arrays": _all_functions(np.array([[x], [y]]), np.array)[..., 0],
            "program": traced_,
            "jets": np.array([float(one.value) for one in _all_functions(at, list)]),
        }
    for way, found in ways.items():
        np.testing.assert_allclose(found, expected, rtol=1e-15, atol=0, err_msg=way)


def test_functions_in_c_choose_no_number_for_nan(in_c):
    program = program_of(lambda z: _all_functions(z, np.array), 2)
    for x, y in ((np.nan, 1.0), (1.0, np.nan), (0.25, 0.75)):
        with np.errstate(all="ignore"):
            expected = evaluated(program, x=[x, y])["y"]
        found = in_c(program, x=np.array([x, y]))["y"]
        np.testing.assert_allclose(found, expected, rtol=1e-15, atol=0)


def test_numbers_in_c_are_exact(in_c):
    numbers = [0.1, 1 / 3, 1e-320, 1.7e308, -1e-9, 2.0**-1074, np.inf, -np.inf, np.nan, 123456789.0]
    program = program_of(lambda x: np.array([*numbers, x[0]], dtype=object))
    found = in_c(program, x=np.full(4, -0.0))["y"]
    np.testing.assert_array_equal(found.view(np.int64), np.array([*numbers, -0.0]).view(np.int64))


def test_zeros_of_either_sign_are_two_numbers_and_nan_is_one():
    numbers = [0.0, -0.0, np.nan, -np.nan, float("nan"), 0.0]
    program = program_of(lambda x: np.array(numbers, dtype=object))
    assert len(program.values) == 3
    found = evaluated(program, x=np.zeros(4))["y"]
    np.testing.assert_array_equal(found, numbers)
    np.testing.assert_array_equal(np.signbit(found[[0, 1, 5]]), [False, True, False])


@pytest.mark.parametrize(
    ("function", "expected"),
    {
        "a product and a number": (lambda x: x[0] * x[1] + x[2], "fma"),
        "less a number": (lambda x: x[0] * x[1] - x[2], "negative fma"),
        "a number less a product": (lambda x: x[2] - x[0] * x[1], "negative fma"),
        "two products": (lambda x: x[0] * x[1] + x[2] * x[3], "multiply fma"),
        "their difference": (lambda x: x[0] * x[1] - x[2] * x[3], "multiply negative fma"),
        "a product for two sums": (lambda x: [x[0] * x[1] + x[2], x[0] * x[1] - x[3]],
            "multiply add subtract"),
        "a product that is returned": (lambda x: [x[0] * x[1], x[0] * x[1] + x[2]], "multiply add"),
        "no product": (lambda x: x[0] / x[1] + (x[2] - x[3]), "divide subtract add"),
        "no sum": (lambda x: x[0] * x[1] / x[2], "multiply divide"),
        "a sum of sums": (lambda x: x[0] * x[1] + x[2] * x[3] + x[0], "multiply fma add"),
    }.values(),
)  # fmt: skip
def test_products_are_fused_with_sums(monkeypatch, function, expected):
    monkeypatch.setitem(_NUMPY, "fma", lambda a, b, c, out: np.add(a * b, c, out))
    program = program_of(function)
    found = fused(program)
    assert sorted(names(found)) == sorted(expected.split())
    x = np.array([3.0, -5.0, 8.0, 2.0])  # nothing rounds, so that both are exact
    np.testing.assert_array_equal(evaluated(found, x=x)["y"], evaluated(program, x=x)["y"])


@pytest.mark.parametrize(
    ("function", "kept"),
    [
        (lambda x: x[0] * x[1] + x[2] * x[3] * x[3], {2, 3}),
        (lambda x: x[2] * x[3] * x[3] - x[0] * x[1], {2, 3}),
        (lambda x: x[0] * x[1] * x[1] + x[2] * x[3], {0, 1}),
    ],
)
def test_of_two_products_in_a_sum_the_one_that_is_computed_first_is_kept(function, kept):
    """The longer chain comes first; so the other one is known last."""
    values = fused(program_of(function)).values
    products = [value for value in values if getattr(value, "name", "") == "multiply"]
    used = {values[operand] for product in products for operand in product.operands}
    assert {value.number for value in used if isinstance(value, Input)} == kept


# Numbers of expressions, which become inputs where a tracer collects them -------------------------


def of_expressions(texts, numbers):
    """The program of expressions in t, and their values at some times."""
    expressions = [parse(text) for text in texts]

    def values(t):
        return arrays.stack([expression.evaluate({"t": t}) for expression in expressions])

    def computed(given):
        return {"y": values(given["t"][0])}

    return traced(computed, {"t": 1, "held": 2}, numbers), values


@pytest.mark.parametrize(
    ("texts", "others"),
    {
        "amplitude and time": (["0.02*cos(t/5)", "3"], ["0.3*cos(t/7)", "-4"]),
        "constants are one number": (["2*pi/5*t + sin(2)"], ["pi/9*t + sin(7)"]),
        "conditions": (["where(t < 0.4, 0.3, 5)*t"], ["where(t < 2.5, 7, 0.6)*t"]),
        "smooth steps": (["smoothstep(t, 0.4, 3)"], ["smoothstep(t, 0.2, 7)"]),
        "a quotient by a power of 2": (["t/4 + 0.3*sin(t)"], ["t/16 + 0.7*sin(t)"]),
        "a power is structure": (["5*t**2 + 3**t"], ["7*t**2 + 3**t"]),
    }.values(),
)
def test_programs_of_other_numbers_are_equal(in_c, texts, others):
    one, values = of_expressions(texts, {})
    other, values_of_other = of_expressions(others, {})
    assert one == other and one.numbers != other.numbers
    for program, expected in ((one, values), (other, values_of_other)):
        for t in (0.3, 0.4, 2.7, 9.0):
            held = [np.nan, np.nan, *program.numbers]
            y = in_c(program, t=[t], held=held)["y"]
            np.testing.assert_allclose(y, np.atleast_1d(expected(t)), rtol=1e-14)


@pytest.mark.parametrize(
    ("texts", "others"),
    [
        (["0.3*t"], ["0*t"]),  # 0, 1 and -1 shorten programs
        (["0.3*t"], ["1*t"]),
        (["t**2"], ["t**3"]),
        (["0.3*t", "0.5*sin(t)"], ["0.5*t", "0.5*sin(t)"]),  # equal numbers are one
    ],
)
def test_programs_of_another_structure_differ(texts, others):
    assert of_expressions(texts, {})[0] != of_expressions(others, {})[0]


def test_numbers_are_constants_where_nobody_collects_them():
    program, _ = of_expressions(["0.3*t + 7"], None)
    assert program.numbers == () and dict(program.inputs)["held"] == 2


# A filter of measurements that wait in a ring: y ← y + g (x − y) where x has arrived --------------


def filtered(given, apart=False):
    """The filter after its first and its last measurement, the ring a tick later, and a gain."""
    ring, now = given["ring"].reshape(-1, 2), given["now"]
    rows = [{"x": x[:1], "arrived": x[1:]} for x in [*ring, now]]
    gain = given["gain"] * given["gain"]

    def step(carried, row):
        y = carried["y"] + gain * (row["x"] - carried["y"])
        y = where(less(gain, 0.0), 0.0, where(less(0.5, row["arrived"]), y, carried["y"]))
        return {"y": y, "change": y - carried["y"]}

    def steps(carried, row):
        return arrays.repeated(step, carried, [row], apart)[1] | {"twice": 2.0 * row["x"]}

    first, last = arrays.repeated(steps, {"y": given["y"]}, rows[:2])
    if rows[2:]:
        _, last = arrays.repeated(step, {"y": last["y"]}, rows[2:], apart)
    later = np.concatenate([given["ring"][2:], now])
    return {"first": first["y"], "twice": first["twice"], **last, "ring": later}


def ring_of(length):
    random = np.random.default_rng(length)
    given = {"ring": random.normal(size=2 * length), "now": random.normal(size=2)}
    return given | {"y": np.array([0.3]), "gain": np.array([0.7])}


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("length", [1, 2, 3, 30])
def test_a_loop_computes_what_its_steps_do(in_c, length, apart):
    given = ring_of(length)
    expected = filtered(given)
    program = traced(lambda x: filtered(x, apart), {name: x.size for name, x in given.items()})
    computed = in_c(program, **given)
    for name, value in expected.items():
        np.testing.assert_array_equal(computed[name], np.atleast_1d(value), err_msg=name)


def test_a_program_is_no_longer_for_a_longer_ring():
    """But for the digits of its numbers; in static functions, moves are loops, too."""
    lengths = []
    for length in (10, 1000):
        sizes = {name: x.size for name, x in ring_of(length).items()}
        program = traced(lambda x: filtered(x, apart=True), sizes)
        assert names(program).count("loop") == 2
        lengths.append(len(c_function(program, "law", static=True)))
    assert lengths[1] < lengths[0] + 100
    assert c_function(program, "law").count("noinline") == 0


def test_a_step_that_loops_share_is_one_function():
    sizes = {name: x.size for name, x in ring_of(9).items()}
    program = traced(lambda x: filtered(x, apart=True), sizes)
    assert c_function(program, "law").count("EQT_APART") == 2  # with the one that it is part of


def test_rows_that_only_a_loop_needs_are_written_before_it():
    """As measurements that are lost, of which the filter reads a part."""

    def seen(given):
        rows = [{"x": where(less(0.5, given["lost"]), given["y"], x)} for x in given["x"]]
        return arrays.repeated(lambda y, row: {"y": y["y"] + row["x"]}, {"y": given["y"]}, rows)[1]

    text = c_function(traced(seen, {"x": 3, "y": 1, "lost": 1}), "law")
    body = text[text.index("void law(") :]
    assert {*re.findall(r"\bv\d+", body)} == {*re.findall(r"const \w+ (v\d+)", body)}


def test_a_select_of_what_waits_is_written_as_a_loop():
    """As where the first measurement of a sensor fills all places of a delay."""

    def waiting(given):
        now, held = given["now"], given["held"]
        first, moved = less(0.5, given["first"]), held[3:]
        return {"held": np.concatenate([where(first, np.tile(now, len(moved) // 3), moved), now])}

    programs = [traced(waiting, {"held": n, "now": 3, "first": 1}) for n in (30, 300)]
    texts = [c_function(program, "law", static=True) for program in programs]
    assert len(texts[1]) < len(texts[0]) + 20 < len(c_function(programs[0], "law"))


def test_names_that_are_none_in_c():
    program = program_of(lambda x: x)
    head = "void law(const eqt_real *__restrict in_x, eqt_real *__restrict out_y)"
    assert head in c_function(program, "law")
    with pytest.raises(ValueError, match=re.escape("'a); evil(' is not an identifier of C")):
        c_function(program, "a); evil(")


def test_a_chain_simplifies_nothing_across_a_border(in_c):
    """-0 and infinity come through, where a product with a constant 0 or a sum would lose them."""
    first = traced(lambda given: {"y": given["x"] * 2.0, "none": np.zeros(1)}, {"x": 2})
    second = traced(lambda given: {"z": given["y"] + given["n"] * given["y"]}, {"y": 2, "n": 1})
    chain = Chain([("x", 2)])
    middle = chain.then(first, {"x": chain.places_of("x")})
    last = chain.then(second, {"y": middle["y"], "n": middle["none"]})
    whole = chain.program({"z": last["z"]})
    for x in ([-0.0, 3.0], [np.inf, -0.0], [0.1, -0.3]):
        y = in_c(first, x=x)
        expected = in_c(second, y=y["y"], n=y["none"])["z"]
        assert in_c(whole, x=x)["z"].tobytes() == expected.tobytes()


def test_a_chain_has_equal_operations_once_and_no_others():
    both = traced(lambda given: {"y": given["x"] * given["x"], "z": given["x"] + 1.0}, {"x": 1})
    chain = Chain([("x", 1)])
    x = chain.places_of("x")
    one, other = chain.then(both, {"x": x}), chain.then(both, {"x": x})
    assert one == other
    whole = chain.program({"y": one["y"]})
    assert whole.values == (Input("x", 0), Operation("multiply", (0, 0)))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        *(("lee2010", "lee2010"), ("kp=2", "kp_2"), ("2nd law", "n_2nd_law"), ("int", "int_")),
        *(("λ", "n"), ("from_", "from_")),
    ],
)
def test_a_text_as_a_name_in_c(text, name):
    assert c_name(text) == name


def test_names_in_c_are_distinct():
    assert distinct(["a b", "a-b", "period"], taken=("period",)) == ["a_b", "a_b_2", "period_2"]
    assert distinct(["a", "A"]) == ["a", "A_2"]  # one file on some systems
    ends = ("", "_check")
    assert distinct(["a", "a_check"], endings=ends) == ["a", "a_check_2"]
    assert distinct(["A_check", "a"], endings=ends) == ["A_check", "a_2"]
