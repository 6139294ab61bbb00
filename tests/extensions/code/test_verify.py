"""`eqt verify` judges C against the law that it claims to be, and names what is missing."""

import json
import re
from pathlib import Path

import pytest
import yaml
from case_tables import from_yaml
from said import says

from eqt_cli.base import yaml_source

DOUBLE = "torque of Lee 2010, double, at random states"


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_law_that_was_typed_in_well(real, written, config, judged):
    written(real=real)
    assert judged(config(real=real)) == {}


@from_yaml
def test_what_is_said_of_a_fault(changes, said, written, config, judged):
    written(*changes)
    [(row, remark)] = judged(config()).items()
    assert row == DOUBLE
    assert says(remark, said)


def test_what_is_not_finite_without_an_error(written, config, judged):
    written(("const real eR[3] = {", "const real eR[3] = {0 / (3 - E[0] - E[4] - E[8]) + "))
    rows = judged(config())
    assert rows["finite torque at half turns and without an error"] == "no error: [nan, 0.0, 0.0]"
    assert re.match(r"at \d+ of \d+ states, for example at t = ", rows[DOUBLE])


OTHER = pytest.mark.ci("another branch is tried fast")


@pytest.mark.parametrize(
    ("condition", "outcome"),
    [
        ("in->t > 4.8 && in->t <= 5", "(in->t > 4.8 && in->t <= 5) is true"),
        pytest.param("in->t > 150000", "in->t > 150000 is true", marks=OTHER),
        pytest.param(
            "!(1e-9 < W[0] - 3 * W[1])", "(!(1e-9 < W[0] - 3 * W[1])) is true", marks=OTHER
        ),
        ("(W[1] - 3.21) * (W[1] - 3.21) < 1e-9", "(W[1] - 3.21) * (W[1] - 3.21) < 1e-9 is true"),
    ],
)
def test_a_branch_that_few_states_take(condition, outcome, written, config, judged):
    """Also one that only a search along its comparison finds."""
    written(("+ gyro[i]", f"+ (({condition}) ? -gyro[i] : gyro[i])"))
    [said] = judged(config()).values()
    place = re.escape(f", all of them where {outcome} (lee.c, line 33)")
    assert re.fullmatch(rf"at \d+ of \d+ states{place}", said)


def test_a_dead_zone_is_at_most_as_wide_as_the_least_torque(written, config, judged):
    """On the axis that has one."""
    zone = "if (i == 1 && torque[i] < 0.3 && torque[i] > -0.3) torque[i] = 0;"
    written(
        ("i++)\n            torque[i] =", "i++) { torque[i] ="), ("- A[i]);", f"- A[i]); {zone} }}")
    )
    said = judged(config())[DOUBLE]
    width = re.fullmatch(r"has a dead zone of at most ±(0.3\d*) N m on axis 2", said)
    assert width and float(width[1]) < 0.31


def test_a_line_that_was_never_run(written, config, judged):
    written(("cross(in->velocity, Jw", "if (n->kR < 0) Jw[0] = 0;\n    cross(in->velocity, Jw"))
    said = judged(config())[DOUBLE]
    assert said.startswith("undecided: lee.c, line 28: n->kR < 0 was never true; ")
    assert re.search(r"; \d+ states; a fault at more than 0.\d+ % of states like these", said)


def test_a_test_of_a_pointer_counts_as_constant(written, config, judged):
    """As CasADi writes one of every argument; one of a bit-field does not."""
    table = "const real *arg[1] = {in->velocity}; struct { unsigned set : 1; } is = {n->kR > 0};"
    written(("int i, j, k;", f"int i, j, k; {table}"), ("+ gyro[i]", "+ (arg[0] ? gyro[i] : 0)"))
    assert re.match(
        "undecided: lee.c, line 1[0-9]: n->kR > 0 was never false; ", judged(config())[DOUBLE]
    )
    written(
        ("int i, j, k;", "int i, j, k; const real *arg[1] = {in->velocity};"),
        ("+ gyro[i]", "+ (!arg[0] ? 0 : arg[0] != 0 ? gyro[i] : 0)"),
    )
    assert judged(config()) == {}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("static real s = 0; s += 1e-3;", marks=pytest.mark.ci("an array is fast")),
        "static struct { int k; } s[2]; ++s[0].k;",
    ],
)
def test_a_state_of_its_own(name, written, config, judged):
    """It is told by its name, even if it changes nothing."""
    written(("int i, j, k;", f"int i, j, k; {name}"))
    rows = judged(config())
    assert rows["equal inputs give equal torques"] == (
        "it keeps s from call to call; put it into memory, or make it const"
    )


@from_yaml
def test_a_state_elsewhere(more, said, written, config, judged):
    written(("+ gyro[i]", f"+ gyro[i] + {more}"), ("#include", "#include <stdlib.h>\n#include"))
    assert says(judged(config())["equal inputs give equal torques"], said)


def test_a_function_in_a_table_that_no_state_calls(written, config, judged):
    """A function that nothing names is none of the law's."""
    more = (
        "static double idle(double x) { return x > 1; }\n"
        "static double same(double x) { return x; }\n"
        "static double other(double x) { return 2 * x; }\n"
        "static double (*const table[2])(double) = {same, other};\n"
    )
    written(
        ("-n->kR", "-table[0 * (int)in->t](n->kR)"),
        ("static void cross", f"{more}static void cross"),
    )
    said = judged(config())[DOUBLE]
    assert said.startswith("undecided: lee.c, line 5: other was never reached; ")


def test_code_that_claims_nothing(written, config, judged):
    written()
    assert judged(config(**{"as": None})) == {"torque of the nearest law, lee2010": ""}


# The command ------------------------------------------------------------------------------------

MOVING = yaml.safe_load("""
gains: {kp: 4.0, kd: 4.0}
reference: {kind: path, factors: [{axis: wz, by: 2*sin(2*t)}, {axis: wx, by: 1.5*sin(3*t)}]}
initial: {pose: haar, velocity: fixed}
control: {period: 0.05}
time: {duration: 10*pi, samples: 101}
ensemble: {runs: 2, seed: 1}
solver: {engine: native, cross_check: 0}
""")


@pytest.mark.ci("compiles two closed loops and flies them through 630 control instants")
def test_the_simplified_lee_law_fails(written, config, eqt):
    """Without transport and desired acceleration it does not follow a reference that moves."""
    written(("- n->J[i] * (WxW[i] - A[i])", ""))
    law = {"controllers": ["lee2010"]}
    Path("c.yaml").write_text(yaml_source.dump(config(over=MOVING) | law), encoding="utf-8")
    numbers = "controllers[0].numbers={kR: 8, kW: 4, J: [1, 2, 3]}"
    asked = ("verify", "c.yaml", "--code", "lee.c", "--as", "lee2010", "--set", numbers, "--json")
    done = eqt(*asked)
    assert done.code == 4, done.err
    fails = {row["name"] for row in json.loads(done.out)["rows"] if row["verdict"] == "FAILS"}
    assert {DOUBLE, "torque of Lee 2010, double, along runs"} <= fails
    assert "tracks" in fails
    written()
    assert eqt(*asked).code == 0


def test_an_error_of_an_adapter_has_its_line(written, eqt, config):
    written()
    Path("c.yaml").write_text(yaml_source.dump(config()), encoding="utf-8")
    Path("lee.adapter.yaml").write_text(
        "inputs:\n  q: {signal: pose, unti: deg}\n", encoding="utf-8"
    )
    said = "lee.adapter.yaml:2:21: controllers[0].adapter.inputs.q.unti: unknown key"
    assert said in eqt("verify", "c.yaml", "--code", "lee.c", "--as", "lee2010").err


def test_what_the_command_says(written, eqt, config):
    written()
    Path("c.yaml").write_text(yaml_source.dump(config()), encoding="utf-8")
    assert eqt("verify", "c.yaml", "--as", "lee2010").err == (
        "eqt: error: --as is about a law in code; give its file with --code\n"
    )
    assert eqt("verify", "c.yaml", "--code", "no.c", "--as", "lee2010").err == (
        "eqt: error: no.c: not found; give a file in C, C++ or Python with --code\n"
    )
    said = eqt("verify", "c.yaml", "--code", "lee.c", "--as", "lee201").err
    assert says(said, "eqt: error: --code: controllers[0].as: unknown…'lee201'…'lee2012'?\n")


def test_a_torque_that_is_no_number_anywhere(written, config, told):
    written(
        body="(void)in; torque[0] = torque[1] = torque[2] = 0 * n->kR / (m->unused - m->unused);"
    )
    assert says(told(config()), "…no number at any state that was tried…divides by as `numbers`")
