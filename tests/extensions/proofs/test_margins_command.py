"""`eqt margins`, and what `eqt config check` says of loops that are unstable."""

import json
import re

import pytest
from plugin_sources import component
from said import says

LATE = """\
group: SO3
inertia: [2, 1, 3]
gains: {kp: 0.05, kd: 0.5}
reference: {kind: constant}
controllers:
  - eqt
  - {kind: sliding, slope: 0.1, gain: 0.02}
actuators:
  - {kind: limit, limit: 5.0}
  - {kind: lag, time_constant: 0.2}
control: {period: 0.5, delay: 1}
sensors: {velocity: [{kind: noise, std: 0.001, period: 1.0}]}
ensemble: {runs: 2}
time: {duration: 5, samples: 11}
"""
REVERSED = component("""
reversed(eqt_cli.components.laws.EqT):
    def torque(self, s):
        return super().torque(s) + 2 * s.G.Ad_star(s.Qd, s.gradient)
""")
JUMPS = component("""
from eqt_cli.base.arrays import less, where
jumps(eqt_cli.components.laws.EqT):
    def torque(self, s):
        return super().torque(s) - where(less(s.V_tilde, 0 * s.P), -0.1, 0.1)
""")
BRANCHES = component("""
branches(eqt_cli.components.classic_laws.Goodarzi2013):
    def memory_rate(self, s):
        return super().memory_rate(s) if s.t < 1 else {"integral": 0 * s.P}
""")
AT_REST = ("--set", "reference={kind: constant}", "--set", "controllers=[eqt]")
NOTES = """\

stable up to this further delay, and for these multiples; any: 1/128 to 128
"""


def table(out):
    """The cells of what is printed as a table."""
    lines = out.split("\n\n")[0].splitlines()
    return [line.split() for line in (lines[0], *lines[2:])]


@pytest.mark.ci("test_margins.py has fast ones")
def test_margins_of_a_sampled_loop(eqt, folder):
    (folder / "late.yaml").write_text(LATE)
    done = eqt("margins", "late.yaml")
    assert (done.code, done.err) == (0, "")
    header, first, second = table(done.out)
    assert " ".join(header) == (
        "law largest |eigenvalue| delay margin multiples of kp of kd of both verdict"
    )
    assert " ".join(first) == (
        "EqT 0.921979 1 s (2 periods) below 3.54 0.203 to 2.75 below 2.39 indicative"
    )
    assert " ".join(second[:2]) == "sliding mode"
    assert " ".join(second[-4:]) == "not used any indicative"
    assert done.out.endswith(
        NOTES + "eigenvalues of EqT, sliding mode: over 1 s, when all clocks coincide again\n"
        "indicative: the numbers hold for the loop without the parts that are left out, not for "
        "the whole\nloop\n"
        "left out: actuators[0] (torque limited), sensors.velocity[0] (only its noise)\n"
    )


def test_an_unstable_loop_ends_with_4_and_config_check_warns_of_it(eqt, folder):
    (folder / "late.yaml").write_text(LATE)
    unstable = ("late.yaml", "--set", "control.delay=4", "--set", "controllers=[eqt]")
    done = eqt("margins", *unstable)
    assert (done.code, done.err) == (4, "")
    assert " ".join(table(done.out)[1]) == "EqT 1.05537 - - - - unstable"
    quiet = eqt("margins", *unstable, "--quiet")
    said = "eqt: error: late.yaml: the loop of 'eqt' is unstable\n"
    assert (quiet.code, quiet.out, quiet.err) == (4, "", said)
    checked = eqt("config", "check", *unstable)
    where = "eqt: warning: --set controllers=[eqt]: controllers: the loop of 'eqt' is unstable…"
    rate = "0.0539 1/s (eigenvalue 1.055 in 1 s)…actuators[0]…sensors.velocity[0]…\n"
    assert checked.code == 0 and says(checked.err, where + rate)
    assert "unstable" not in eqt("config", "check", "late.yaml").err


def test_a_law_with_a_wrong_sign_is_told_before_it_is_run(eqt, folder):
    (folder / "reversed.py").write_text(REVERSED)
    of_mine = ("--set", "plugins=[reversed.py]", "--set", "controllers=[reversed]")
    done = eqt("config", "check", "c.yaml", *AT_REST[:2], *of_mine)
    where = "eqt: warning: --set controllers=[reversed]: controllers: the loop of 'reversed' is"
    assert done.code == 0 and says(done.err, where + " unstable…1.19 1/s…signs…\n")


def test_margins_say_where_eigenvalues_decide_nothing(eqt):
    """The paper's law is proved to be stable, and an eigenvalue says nothing else."""
    done = eqt("margins", "c.yaml", "--set", "controllers=[eqt]")
    assert (done.code, done.err) == (0, "")
    of_json = eqt("margins", "c.yaml", "--set", "controllers=[eqt]", "--json").out
    [law] = json.loads(of_json)["laws"]
    assert (law["largest_eigenvalue"], law["eigenvalue"], law["growth_rate"]) == (None, None, None)
    checked = eqt("config", "check", "c.yaml", "--set", "controllers=[eqt]")
    assert (checked.out.splitlines()[0], checked.err) == ("✓ c.yaml: valid", "")
    why, frozen = " ".join(done.out.split()).split(" Frozen ")
    assert says(why, "The reference moves…EqT…--certified…--set 'reference={kind: constant}'…")
    at = re.fullmatch(r"at the worst of nine times, errors do not decay: EqT at (.*) s\.", frozen)
    assert 0 <= float(at[1]) <= 1
    assert law["at"] == pytest.approx(float(at[1]), rel=0.005)


@pytest.mark.ci("computes the margins at nine times, twice")
def test_a_loop_that_is_stable_at_each_of_nine_times_has_indicative_numbers(eqt):
    """A slow reference; the delay margin is near that at rest, and no cell is empty."""
    slow = ("--set", "reference={kind: constant, velocity: [0.01, 0.02, 0]}")
    distinct = ("--set", "gains.kp=[1,2,3]", "--set", "controllers=[eqt]")
    done = eqt("margins", "c.yaml", *slow, *distinct)
    why, cells, notes = done.out.split("\n\n")
    assert why.startswith("The reference moves, so the loop of EqT varies in time: ")
    header, _, row = cells.splitlines()
    assert " ".join(header.split()) == "law delay margin multiples of kp of kd of both verdict"
    assert "-" not in row.split()
    [law] = json.loads(eqt("margins", "c.yaml", *slow, *distinct, "--json").out)["laws"]
    assert row.split()[1] == f"{law['delay_margin']:.4g}"
    assert "indicative: delay and multiples are those of the loop frozen at the worst of" in notes


def test_margins_where_a_force_pushes(eqt):
    push = ("--set", "plant.forces=[{kind: constant, force: [0.2, 0, 0]}]")
    done = eqt("margins", "c.yaml", *AT_REST, *push)
    assert done.out.endswith(
        NOTES + "EqT stays 0.1 rad away from its reference; linearised there\n"
    )


def test_runs_that_are_one_run_do_not_concern_margins(eqt):
    done = eqt("margins", "c.yaml", *AT_REST, "--set", "initial={}", "--set", "ensemble.runs=3")
    assert (done.code, done.err) == (0, "")


def test_margins_as_json(eqt):
    found = json.loads(eqt("margins", "c.yaml", *AT_REST, "--json").out)
    [law] = found.pop("laws")
    about = {"name": "c", "group": "SO3", "period": None, "left_out": [], "causes": []}
    assert found == {**about, "refused": {}}
    assert " ".join(law) == (
        "label verdict largest_eigenvalue eigenvalue at cycle estimator at_rest_where_it_begins "
        "forces_frozen_where_it_begins "
        "growth_rate offset delay_margin delay_margin_periods delay_margin_is_least "
        "delay_margin_is_frozen gain_margins delay_margins_of_lags"
    )
    assert (law["verdict"], law["at"], law["delay_margin_periods"]) == ("stable", None, None)
    assert law["gain_margins"]["kp"] == {"lower": None, "upper": None}


def test_margins_of_a_point_of_a_sweep(eqt):
    swept = (*AT_REST, "--set", "sweep=[{grid: {gains.kp: [1, 5]}}]")
    done = eqt("margins", "c.yaml", *swept, "--json")
    assert done.err == "c.yaml: without its sweep; choose one of its points with --point\n"
    last = eqt("margins", "c.yaml", *swept, "--json", "--point", 1)
    margins = [json.loads(each.out)["laws"][0]["delay_margin"] for each in (done, last)]
    assert (last.err, margins[0] != margins[1]) == ("", True)


def test_margins_of_a_reference_that_leaves_the_real_numbers(refused):
    torque = "reference={torque: [sqrt(0.5 - t), '0', '0']}"
    assert "has no finite real value at about t = 0.5" in refused(
        "margins", "c.yaml", "--set", torque
    )


def test_a_loop_with_a_long_delay_is_too_large(refused):
    """Six states of the motion, and three for every command that waits."""
    assert refused("margins", "c.yaml", "--set", "control={period: 0.001, delay: 999}") == (
        "the linearised loop has 3,006 states, because what waits for a delay counts, and at "
        "most 300 are computed; take fewer ticks of delay, or a longer control.period\n"
    )


@pytest.mark.parametrize("control", ["null", "{period: 0.5}"])
def test_a_law_that_jumps_at_its_reference_has_no_margins(eqt, refused, folder, control):
    (folder / "jumps.py").write_text(JUMPS)
    law = ("--set", "plugins=[jumps.py]", "--set", "controllers=[jumps]", "--set")
    assert refused("margins", "c.yaml", *law, f"control={control}").endswith(
        "the loop of 'jumps' has no derivative where all errors are 0, for example because "
        "its law jumps there; leave this law out\n"
    )
    assert "derivative" not in eqt("config", "check", "c.yaml", *law, f"control={control}").err


@pytest.mark.ci("two loops")
def test_the_others_have_margins_beside_a_law_that_jumps(eqt, folder):
    (folder / "jumps.py").write_text(JUMPS)
    law = ("--set", "plugins=[jumps.py]", "--set", "controllers=[jumps, eqt]")
    shown, told = (eqt("margins", "c.yaml", *law, *more) for more in ((), ("--json",)))
    found = json.loads(told.out)
    assert shown.code == told.code == 0
    assert [law["label"] for law in found["laws"]] == ["eqt"]
    assert "no derivative" in found["refused"]["jumps"]
    assert "No margins of jumps: the loop of 'jumps' has no derivative" in shown.out


def test_a_law_that_takes_one_time_only_is_named_with_its_line(eqt, refused, folder):
    (folder / "branches.py").write_text(BRANCHES)
    law = ("--set", "plugins=[branches.py]", "--set", "controllers=[branches]")
    why = (
        "ValueError: The truth value of an array with more than one element is ambiguous. Use "
        "a.any() or a.all() at branches.py:9: return super().memory_rate(s) if s.t < 1 else "
        '{"integral": 0 * s.P}\n'
    )
    assert refused("margins", "c.yaml", *law) == why
    checked = eqt("config", "check", "c.yaml", *law)
    place = "--set controllers=[branches]: controllers"
    said = f"eqt: warning: {place}: loops cannot be linearised: {why}"
    assert (checked.code, checked.err) == (0, said)


CERTIFIED = """\
  law  proved rate, 1/s  overshoot  slowest constant V_d  its rate, 1/s
  ───  ────────────────  ─────────  ────────────────────  ─────────────
each V_d(t) within −0.5 to 0.5, −0.5 to 0.5, −0.5 to 0.5
  EqT            0.1185       1.65  (0, 0, 0)                    0.1409
  nog            0.0850       1.62  (−0.5, −0.5, −0.5)           0.1035

proved: along all references in the box, errors shrink like overshoot · exp(−rate · t)
slowest constant V_d: no proof in the box can exceed its rate; below 0 it is unstable
"""


def test_each_of_several_values_is_a_number(refused):
    said = refused("margins", "c.yaml", "--velocity", "1", "--velocity", "inf")
    assert said == "--velocity: expected a number, got inf\n"


def test_certified_rates_as_text_and_as_json(eqt):
    pytest.importorskip("clarabel", reason="the extra certify is not installed")
    few = ("margins", "paper", "--certified", "--velocity", 0.5, "--set", "controllers=[eqt,nog]")
    done = eqt(*few)
    # Corners of the box that are alike: rounding decides which of them is the slowest.
    corner = re.compile(r"\(−?0\.5, −?0\.5, −?0\.5\) +(?=0\.1035)")
    out = corner.sub("(−0.5, −0.5, −0.5)           ", done.out)
    assert (done.code, out, done.err) == (0, CERTIFIED, "")
    laws = json.loads(eqt(*few, "--json").out)["laws"]
    assert [law["label"] for law in laws] == ["eqt", "nog"]
    certified = laws[0]["certified"]
    assert 0.1185 < certified["rate"] < certified["slowest_rate"]
    assert (certified["velocity"], len(certified["P"])) == ([[-0.5, 0.5]] * 3, 6)
    assert certified["slowest_constant"] == [0, 0, 0]


def test_a_law_without_a_certificate_is_named(eqt):
    distinct = ("--set", "gains.kp=[1,2,3]", "--set", "controllers=[eqt]")
    done = eqt("margins", "paper", "--velocity", 0.5, *distinct)
    why = "has a stiffness or damping in space that depends on the desired pose R_d"
    said = f"EqT has no certified rate: it {why}"
    assert (done.code, " ".join(done.out.split()), done.err) == (0, said, "")
    document = json.loads(eqt("margins", "paper", "--velocity", 0.5, *distinct, "--json").out)
    assert document == {"laws": [{"label": "eqt", "certified": None, "why": why}]}


@pytest.mark.parametrize(
    ("varying", "cause", "remedy"),
    [
        ("plant: {forces: [{kind: expression, force: ['sin(t)', 0, 0]}]}", "A force varies", True),
        ("inertia: {matrix: [['2+sin(t)', 0, 0], [0, 2, 0], [0, 0, 3]]}", "The inertia or", False),
    ],
)
def test_what_varies_at_rest_is_named_with_a_remedy_that_helps(eqt, folder, varying, cause, remedy):
    inertia = "" if varying.startswith("inertia") else "inertia: [2, 2, 3]"
    rest = "reference: {kind: constant}\ntime: {duration: 5, samples: 11}\nrigid: false"
    gains = "group: SO3\ngains: {kp: 0.05, kd: 0.5}\ncontrollers: [eqt]"
    (folder / "varying.yaml").write_text("\n".join([gains, rest, varying, inertia]))
    said = " ".join(eqt("margins", "varying.yaml").out.split())
    assert said.startswith(cause)
    assert ("add --set plant.forces=[]" in said) is remedy
    assert "reference={kind: constant}" not in said
