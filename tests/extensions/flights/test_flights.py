"""Flights of two settings: known ratios, how sure they are, what differs, and what is refused."""

import json
import sys
from itertools import combinations, product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from flights import dataflash, ulog
from said import says
from scipy import stats

import eqt_cli
from eqt_cli.extend import EqtError
from eqt_cli.extensions.flights import api, flights
from eqt_cli.extensions.flights.api import compare_flights
from eqt_cli.extensions.flights.one_look import difference, permutation_test

A, B = [0.21, 0.30, 0.22, 0.19, 0.25, 0.24], [0.28, 0.29, 0.37, 0.33, 0.31, 0.32]
T = np.arange(0.0, 15.0, 0.1)


# The statistics, against closed forms and plain programs ------------------------------------------


def test_the_interval_is_welchs():
    x, y = np.log(A), np.log(B)
    s2 = x.var(ddof=1) / 6, y.var(ddof=1) / 6
    df = sum(s2) ** 2 / (s2[0] ** 2 / 5 + s2[1] ** 2 / 5)
    half = stats.t.ppf(0.975, df) * np.sqrt(sum(s2))
    centre = x.mean() - y.mean()
    assert difference(x, y, False, 0.95)[0] == pytest.approx((centre, centre - half, centre + half))
    half = stats.t.ppf(0.975, 5) * np.std(x - y, ddof=1) / np.sqrt(6)
    assert difference(x, y, True, 0.95)[0] == pytest.approx((centre, centre - half, centre + half))


def test_the_test_tries_all_ways():
    x, y = np.log(A), np.log(B)
    both, least = np.r_[x, y], abs(x.mean() - y.mean()) - 1e-12
    splits = [both[list(of)].mean() for of in combinations(range(12), 6)]
    further = [abs(mean - (both.sum() - 6 * mean) / 6) >= least for mean in splits]
    assert permutation_test(x, y, False) == pytest.approx(np.mean(further))
    swaps = [abs(np.mean(signs * (x - y))) >= least for signs in product([1, -1], repeat=6)]
    assert permutation_test(x, y, True) == pytest.approx(np.mean(swaps))


@pytest.mark.ci("4,000 experiments in each of 6 cells")
@pytest.mark.parametrize("n", [5, 6, 10])
@pytest.mark.parametrize("paired", [False, True])
def test_intervals_cover_and_words_are_seldom_false(n, paired):
    """Flights as in wind that is drawn for each: the error varies by a third, of a skewed law."""
    rng = np.random.default_rng(0)
    x, y = np.log(0.2 + rng.gamma(2.0, 0.08, size=(2, 4000, n)))
    if paired:
        x, y = x + y + 0.2 * rng.normal(size=x.shape), y + x
    _, low, high = difference(x, y, paired, 0.95)[0]
    cover = np.mean((low <= 0) & (high >= 0))
    parts = zip(np.array_split(x, 40), np.array_split(y, 40), strict=True)
    p = np.concatenate([permutation_test(*part, paired) for part in parts])
    false = np.mean(((low > 0) | (high < 0)) & (p <= 0.05))
    assert 0.94 <= cover <= 0.975
    assert false <= 0.06


# Words --------------------------------------------------------------------------------------------


def test_the_ratio_of_flights(fly):
    (one,) = compare_flights(*fly()).pairs
    x, y = np.log(A), np.log(B)
    assert (one.metric, one.unit, one.word, one.decided) == ("position", "m", "better", True)
    ends = stats.ttest_ind(x, y, equal_var=False).confidence_interval()
    assert (one.low, one.high) == pytest.approx(np.exp([ends.low, ends.high]))
    assert one.ratio == pytest.approx(np.exp(x.mean() - y.mean()))
    assert str(one) == "−26 % [−38, −12], better"


def test_a_small_difference_is_none_and_a_broad_interval_undecided(fly):
    same = [1.00, 1.01, 0.99, 1.00, 1.01]
    assert (
        str(compare_flights(*fly(same, same[::-1])).pairs[0]) == "0.0 % [−1.2, +1.2], no difference"
    )
    one = compare_flights(*fly(A[:5], [0.30, 0.20, 0.24, 0.28, 0.26])).pairs[0]
    assert (one.word, one.decided, one.needed > 20) == ("undecided", False, True)


def test_numbers_are_corrected_together(fly):
    """Of three numbers, each with p = 0.0087, the words of all stand; with 0.03 of two, none."""
    more = [("velocity", 0.3), ("attitude", 2.0)]
    found = compare_flights(*fly(more=more))
    alone = compare_flights(*fly(more=more), metrics=["position"])
    assert found.pairs[0].p == pytest.approx(3 * alone.pairs[0].p)


@pytest.mark.parametrize(
    ("a", "b", "pair", "said"),
    [
        (3, 2, False, "3 and 2 flights: no interval and no words below 5 each; pairs flown in the "
                      "same hour need far fewer"),
        (5, 5, True, "5 pairs: 6 are the least for better or worse"),
        (3, 3, True, "3 pairs: no interval below 5; 6 are the least for better or worse"),
        (1, 1, False, "this compares two flights, not two settings"),
    ],
)  # fmt: skip
def test_few_flights_have_no_words(fly, a, b, pair, said):
    found = compare_flights(*fly(A[:a], B[:b]), pair=pair)
    assert found.notes[0] == said
    assert not found.pairs[0].decided
    assert np.isnan(found.pairs[0].low) == (a < 5)


def test_pairs_are_in_order(fly):
    found = compare_flights(*fly(), pair=True)
    assert [(x.side, x.file) for x in found.flights[:4]] == [
        ("A", "a0.ulg"), ("B", "b0.ulg"), ("A", "a1.ulg"), ("B", "b1.ulg")
    ]  # fmt: skip
    ends = stats.ttest_1samp(np.log(A) - np.log(B), 0).confidence_interval()
    assert found.pairs[0].low == pytest.approx(np.exp(ends.low))
    _, rows = found.tables()
    assert rows.rows[1] == ["B", "b0.ulg", "1", "14.9", "1.00", "-", "0.280"]


def test_laps_are_averaged(fly):
    """Two laps of 1 and 4 have the geometric mean 2, and the flight counts once."""
    error = np.where(T < 7.5, 1.0, 4.0)
    files = [[fly.one(f"{side}{k}.ulg", error) for k in range(2)] for side in "ab"]
    found = compare_flights(*files, period=7.5)
    assert [(x.laps, x.errors["position"]) for x in found.flights] == [(2, pytest.approx(2.0))] * 4


def test_laps_in_turns_are_pairs(fly):
    t = np.arange(0.0, 24.0, 0.1)
    name = fly.one("f.ulg", np.where(t % 4 < 2, 0.2, 0.3), t, t)
    found = compare_flights([name], within="AB" * 6, period=2.0)
    assert [len([x for x in found.flights if x.side == side]) for side in "AB"] == [6, 6]
    assert found.pairs[0].ratio == pytest.approx(2 / 3)
    assert found.flights[1].file == "f.ulg lap 2"


def test_the_size_of_an_error(fly):
    error = np.where(T < 11.25, 1.0, 3.0)
    files = [[fly.one(f"{side}.ulg", error)] for side in "ab"]
    for of, expected in (("rms", np.sqrt(np.mean(error**2))), ("median", 1.0), ("largest", 3.0)):
        found = compare_flights(*files, of=of).flights[0]
        assert found.errors["position"] == pytest.approx(expected), of


# What differs -------------------------------------------------------------------------------------


def test_what_differs_comes_first(fly):
    in_a = [(0, "MC_ROLL_P", 7.0), (0, "MPC_XY_P", 0.95), (0, "CAL_ACC0_XOFF", 0.1)]
    in_b = [(0, "MC_ROLL_P", 6.5), (0, "MPC_XY_P", 0.95), (0, "CAL_ACC0_XOFF", 0.2)]
    of_a, of_b = fly(in_a=in_a, in_b=in_b)
    fly.one(of_b[0], settings=[in_b[0], (0, "MPC_XY_P", 1.1), in_b[2]], speed=2.0)
    found = compare_flights(of_a, of_b)
    assert found.premises == [
        "MC_ROLL_P 6.5 → 7 in all",
        "the flights of B do not have one setting: MPC_XY_P 1.1 (1), 0.95 (5) → 0.95",
        "the flights of A are 0.86 times as fast as those of B",
    ]
    assert found.parameters[0] == {"name": "MC_ROLL_P", "A": {"7": 6}, "B": {"6.5": 6}}
    everything = compare_flights(of_a, of_b, all_parameters=True)
    assert any("CAL_ACC0_XOFF" in line for line in everything.premises)


def test_equal_parameters_are_told(fly):
    found = compare_flights(*fly(in_a=[(0, "P", 1.0)], in_b=[(0, "P", 1.0)]))
    assert found.premises == ["all flights have the same settings"]


def test_settings_of_another_release_are_counted(fly):
    of_a, of_b = fly(in_a=[(0, "P", 1.0), (0, "NEW", 1.0)], in_b=[(0, "P", 2.0)])
    fly.one(of_a[0], speed=3.0, settings=[(0, "P", 1.0)])
    assert compare_flights(of_a, of_b).premises == [
        "P 2 → 1 in all",
        "1 settings are not in all files",
        "the flights of A are 1.3 times as fast as those of B",
    ]


def test_a_change_on_the_ground_is_the_setting_of_the_flight(fly):
    """Nothing is compared before 2 s."""
    t = T[20:]
    change = [(0, "P", 1.0), (1.5, "P", 2.0)]
    of_a, of_b = fly(in_a=change, in_b=[(0, "P", 1.0)], t=t)
    assert compare_flights(of_a, of_b).premises == ["P 1 → 2 in all"]


# What is refused ----------------------------------------------------------------------------------


def test_a_change_in_flight_is_refused(fly):
    of_a, of_b = fly()
    fly.one(
        "a3.ulg", settings=[(0, "P", 1.0), (5.0, "P", 2.0), (6.0, "CAL_X", 1.0), (7, "CAL_X", 2)]
    )
    assert says(
        refusal(EqtError, compare_flights, of_a, of_b), "a3.ulg: changed in flight: P 1 → 2 at 5 s…"
    )


@pytest.fixture
def read(fly, monkeypatch):
    """The names of the files that are evaluated, in order."""
    names, whole = [], api.log_errors
    monkeypatch.setattr(
        api, "log_errors", lambda path, **how: names.append(path.name) or whole(path)
    )
    return names


def test_a_file_counts_once(fly, read):
    of_a, of_b = fly()
    Path("b2.ulg").write_text("a1.ulg")
    assert refusal(EqtError, compare_flights, of_a, of_b) == (
        "b2.ulg: the same recording as a1.ulg; a flight counts once: leave one out, or include "
        "both by --duplicates"
    )
    assert not read
    assert len(compare_flights(of_a, of_b, duplicates=True).flights) == 12


def test_a_second_look_evaluates_new_flights_and_those_that_are_read_otherwise(
    fly, read, monkeypatch
):
    figures = SimpleNamespace(save_flights=lambda *_: None)
    monkeypatch.setitem(sys.modules, "eqt_cli.extensions.flights.figures", figures)
    of_a, of_b = fly(A[:3], B[:3], in_a=[(0, "P", 1.0)], in_b=[(0, "P", 2.0)])
    Path("columns.yaml").write_text("t: t")
    for files, options, expected in (
        (of_a[:2], {}, [*of_a[:2], *of_b]),
        (of_a, {}, of_a[2:]),
        (of_a, {"of": "median"}, [*of_a, *of_b]),
        (of_a, {"mapping": "columns.yaml"}, [*of_a, *of_b]),
    ):
        read.clear()
        found = compare_flights(files, of_b, out="kept", **options)
        assert read == expected
        alone = compare_flights(files, of_b, **options)
        assert json.dumps([found.pairs, found.flights]) == json.dumps([alone.pairs, alone.flights])
    Path("columns.yaml").write_text("t: time")
    read.clear()
    compare_flights(of_a, of_b, out="kept", mapping="columns.yaml")
    assert read == [*of_a, *of_b]
    Path("kept/compared.json").write_text("mine")
    assert says(
        refusal(EqtError, compare_flights, of_a, of_b, out="kept"),
        "kept/compared.json: cannot be read: eqt did not write it…",
    )
    assert Path("kept/compared.json").read_text() == "mine"


@pytest.mark.parametrize(
    "flights",
    [
        [],
        {"a": [{}, []]},
        {"a": {}},
        {"a": [{}, [[1, 2.0]], None]},
        {"a": ["p", [[1, 9.9, 1.0, None, {"position": 0.3}, {}]], None]},
        {"a": [{}, [[1, 9.9, 1.0, None, {"position": "far"}, {}]], None]},
        {"a": [{}, [[1, 9.9, 1.0, 0.0, {"position": 0.3}, {}]], None, "abc 4"]},
    ],
)
def test_what_is_kept_in_another_shape_is_evaluated_again(fly, read, flights, monkeypatch):
    figures = SimpleNamespace(save_flights=lambda *_: None)
    monkeypatch.setitem(sys.modules, "eqt_cli.extensions.flights.figures", figures)
    of_a, of_b = fly(A[:2], B[:2])
    compare_flights(of_a, of_b, out="kept")
    kept = Path("kept/compared.json")
    how, whole = (json.loads(kept.read_text())[key] for key in ("how", "flights"))
    if flights:
        flights = dict.fromkeys(whole, flights["a"])
    kept.write_text(json.dumps({"how": how, "flights": flights}))
    read.clear()
    compare_flights(of_a, of_b, out="kept")
    assert read == [*of_a, *of_b]
    assert json.loads(kept.read_text())["flights"] == whole


def test_what_was_evaluated_before_a_refusal_is_kept(fly, read):
    of_a, of_b = fly()
    fly.one("short.ulg", t=T[:20])
    refusal(EqtError, compare_flights, [*of_a, "short.ulg"], of_b, out="kept")
    read.clear()
    refusal(EqtError, compare_flights, [*of_a, "short.ulg"], of_b, out="kept")
    assert read == ["short.ulg"]


def test_other_topics_are_refused(fly):
    of_a, of_b = fly()
    fly.one("b5.ulg", topic="p − other")
    assert says(
        refusal(EqtError, compare_flights, of_a, of_b),
        "b5.ulg: compares p − other, but a0.ulg p − s…",
    )


def test_short_flights_and_gaps_are_refused(fly):
    of_a, of_b = fly()
    fly.one("a0.ulg", t=T[:50])
    assert refusal(EqtError, compare_flights, of_a, of_b) == (
        "a0.ulg: only 4.9 s are compared; expected 10 s or more, and half of 14.9 s with setpoints"
    )
    t = np.arange(0.0, 60.0, 0.1)
    fly.one("a0.ulg", t=np.r_[t[:60], t[-60:]], goal=t)
    assert "only 11.8 s are compared" in refusal(EqtError, compare_flights, of_a, of_b)


def test_what_one_flight_lacks_is_left_out(fly):
    of_a, of_b = fly(more=[("rates", 1.0)])
    fly.one("b1.ulg", B[1])
    found = compare_flights(of_a, of_b)
    assert found.notes[0] == "rates: left out, as b1.ulg has none"
    assert [x.metric for x in found.pairs] == ["position"]
    said = refusal(EqtError, compare_flights, of_a, of_b, metrics=["rates"])
    assert said == "no quantity that all flights have; rates: left out, as b1.ulg has none"


@from_yaml
def test_slips_of_a_user(fly, options, said):
    of_a, of_b = fly()
    options = {"against": of_b} | options
    assert says(refusal(EqtError, compare_flights, of_a, **options), said)


@pytest.mark.parametrize("order", ["AAABBB", "AABB", "ABX", "A"])
def test_laps_in_blocks_are_refused(fly, order):
    said = refusal(EqtError, compare_flights, [fly.one("f.ulg")], within=order, period=2.0)
    assert said.endswith(f"because wind and battery change with time; got '{order}'")


def test_folders_stand_for_their_recordings(fly):
    of_a, of_b = fly()
    for folder, names in (("x", of_a), ("y", of_b)):
        Path(folder).mkdir()
        for name in names:
            Path(folder, name).write_text(f"{folder}{name}")
    Path("x", "notes.txt").touch()
    found = compare_flights(["x"], ["y"])
    assert [flight.file for flight in found.flights[:2]] == ["x/a0.ulg", "x/a1.ulg"]


def test_pairs_need_partners():
    for folder, names in (("x", "123"), ("y", "234")):
        Path(folder).mkdir()
        for name in names:
            Path(folder, name).touch()
    folders = [[f"x/{n}" for n in "123"], [f"y/{n}" for n in "234"]]
    said = refusal(EqtError, compare_flights, *folders, pair=True)
    assert said.endswith("got 1, 2, 3 and 2, 3, 4")


# The gate -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "a", "b", "outcome"),
    [
        ("position worse by 10 %", A, B, "holds"),
        ("position worse by 10 %", B, A, "worse"),
        ("position worse by 30 %", B, A, "not shown"),
        ("position worse by 2 cm", A, B, "holds"),
        ("position worse by 10 %", A[:4], B[:4], "not shown"),
    ],
)
def test_rules(fly, rule, a, b, outcome):
    (one,) = compare_flights(*fly(a, b), fail_on=[rule]).findings
    assert one.outcome == outcome
    if len(a) > 4 and rule.endswith("%"):
        ends = stats.ttest_ind(np.log(a), np.log(b), equal_var=False).confidence_interval(0.9)
        assert one.change[1:] == pytest.approx(100 * np.exp([ends.low, ends.high]) - 100)


def test_worse_alone_goes_by_the_words(fly):
    assert not compare_flights(*fly(), fail_on=["worse"]).findings
    for flown, rule in ((fly(A[:4], B), "worse"), (fly(), "failed")):
        assert says(
            refusal(EqtError, compare_flights, *flown, fail_on=[rule]),
            "fail_on: worse needs 5 flights of each side…",
        )
    (one,) = compare_flights(*fly(B, A), fail_on=["worse"]).findings
    assert str(one) == "worse: position: +36 % [+14, +61], worse"


# Files --------------------------------------------------------------------------------------------


def motion(t):
    return np.c_[2 * np.cos(0.5 * t), np.sin(t), -1 - 0 * t]


def write_ulogs(changes=()):
    """Flights of PX4, off by a known distance; from the ground, wind and parameters are logged."""
    t, s, us = np.arange(1, 14, 0.05), np.arange(1, 14, 0.1), 1e6
    nan = np.full((len(s), 3), np.nan)
    names = {"A": [], "B": []}
    for side, k in product("AB", range(5)):
        off = (A if side == "A" else B)[k]
        content = ulog(
            ("vehicle_local_position", "uint64_t timestamp;float x;float y;float z;",
             np.c_[us * t, motion(t) + np.array([off, 0, 0])]),
            ("trajectory_setpoint", "uint64_t timestamp;float[3] position;float[3] velocity;",
             np.c_[us * s, motion(s), nan]),
            ("wind", "uint64_t timestamp;float windspeed_north;float windspeed_east;",
             np.c_[us * s, 0 * s + 3, 0 * s + 4]),
            ("vehicle_status", "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;",
             [(0.5 * us, 2, 14)]),
            parameters={"MC_ROLL_P": 7.0 if side == "A" else 6.5}, changes=changes,
            hardware=b"PX4_FMU_V5",
        )  # fmt: skip
        names[side].append(f"{side}{k}.ulg")
        Path(names[side][-1]).write_bytes(content)
    return names["A"], names["B"]


@pytest.mark.ci("starts a process for each of 10 logs")
def test_flights_of_px4():
    found = eqt_cli.compare_flights(*write_ulogs(), out="figure")
    (one,) = found.pairs
    expected = np.exp(np.mean(np.log(A[:5])) - np.mean(np.log(B[:5])))
    assert one.ratio == pytest.approx(expected, rel=2e-3)  # of interpolation
    assert (found.premises, one.word) == (["MC_ROLL_P 6.5 → 7 in all"], "better")
    flight = found.flights[0]
    t = np.arange(1, 14, 0.1)
    speed = np.linalg.norm(np.diff(motion(t), axis=0), axis=1).sum() / (t[-1] - t[0])
    assert (flight.wind, flight.speed) == pytest.approx((5.0, speed), rel=0.01)
    assert flight.settings["hardware"] == "PX4_FMU_V5"
    assert {path.name for path in Path("figure").iterdir()} == {
        "compared.json", "flights.pdf", "flights.png", "flights.svg", "looks.json"
    }  # fmt: skip


@pytest.mark.ci("starts a process to read a log")
def test_parameters_of_px4_and_their_changes():
    of_a, _ = write_ulogs([(0.9e6, "MC_ROLL_P", 8.0), (5.03e6, "MC_ROLL_P", 9.0)])
    tracking = eqt_cli.log_errors(of_a[0])
    settings, changes = flights.settings_of(tracking, 1.0, 14.0)
    assert settings["MC_ROLL_P"] == "8"  # before the first position
    assert changes == ["MC_ROLL_P 8 → 9 at 5 s"]


@pytest.mark.ci("starts a process to read a log")
def test_parameters_of_ardupilot():
    """They are logged at the begin, also of a log that starts in flight, and if they change."""
    t, us = np.arange(0.0, 8.0, 0.1), 1e6
    rows = [(us * s, 3, 2, 0, 0, 359, 1) for s in t]
    named = [(0.2e6, b"ATC_P", 4.5), (0.3e6, b"STAT_RUNTIME", 7.0), (5e6, b"ATC_P", 6.0)]
    content = dataflash(
        ("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw", rows),
        ("PARM", "QNf", "TimeUS,Name,Value", named),
    )
    Path("f.BIN").write_bytes(content)
    settings, changes = flights.settings_of(eqt_cli.log_errors("f.BIN"), 0.1, 8.0)
    assert settings == {"ATC_P": "4.5", "STAT_RUNTIME": "7"}
    assert changes == ["ATC_P 4.5 → 6 at 5 s"]


def write_tables():
    t = np.arange(0.0, 12.0, 0.1)
    for name, off in [
        ("wanted", 0.0),
        *((f"{s}{k}", x) for s, xs in (("a", A), ("b", B)) for k, x in enumerate(xs)),
    ]:
        rows = np.c_[t, motion(t) + np.array([0, off, 0])]
        np.savetxt(f"{name}.csv", rows, delimiter=",", header="t,x,y,z", comments="")
    return [[f"{side}{k}.csv" for k in range(6)] for side in "ab"]


@pytest.mark.ci("reads 12 tables, thrice")
def test_the_command_on_tables(invoke):
    of_a, of_b = write_tables()
    command = ["log", "compare", *of_a, "--against", *of_b, "--second", "wanted.csv"]
    done = invoke(*command, "--json", "--fail-on", "position worse by 5 %")
    document = json.loads(done.stdout)
    assert document["gate"]["passes"] is True
    assert document["pairs"][0]["ratio"] == pytest.approx(
        np.exp(np.mean(np.log(A)) - np.mean(np.log(B))), rel=1e-6
    )
    flipped = ["log", "compare", *of_b, "--against", *of_a, "--second", "wanted.csv"]
    done = invoke(*flipped, "--fail-on", "position worse by 5 %", code=4)
    assert done.stdout.startswith("gate fails: 1 worse\n")
    done = invoke(*command, "--format", "csv", "--pair")
    lines = done.stdout.splitlines()
    assert lines[0] == "side,file,digest,laps,seconds,speed,wind,position"
    assert [line.split(",")[1] for line in lines[1:4]] == ["a0.csv", "b0.csv", "a1.csv"]


# A list of flights --------------------------------------------------------------------------------


def listed(fly, rows, columns="file,law,pair,wind"):
    for name, error in zip((f"{k}.ulg" for k in range(12)), [*A, *B], strict=True):
        fly.one(name, error)
    Path("flights.csv").write_text("\n".join([columns, *rows]))
    return ["flights.csv"]


def test_a_list_gives_laws_and_factors(fly):
    rows = [
        f"{k}.ulg,{'new' if k < 6 else 'old'},,{'calm' if k < 6 else 'gusts'}" for k in range(12)
    ]
    found = compare_flights(listed(fly, rows), ["old"])
    assert str(found.pairs[0]) == str(compare_flights(*fly()).pairs[0])
    assert (found.paired, found.premises[0]) == (False, "wind gusts → calm in all")


def test_pairs_of_a_list_are_in_any_order(fly):
    rows = [f"{k}.ulg,new,{k},calm" for k in range(6)]
    rows += [f"{k + 6}.ulg,old,{k},calm" for k in (3, 1, 0, 2, 5, 4)]
    found = compare_flights(listed(fly, rows), ["old"])
    assert found.paired
    assert str(found.pairs[0]) == str(compare_flights(*fly(), pair=True).pairs[0])


@pytest.mark.parametrize(
    ("rows", "against", "law", "said"),
    [
        (["0.ulg,new,,"], [], "", "against: expected a law of flights.csv (new), got none"),
        (["0.ulg,,,"], ["old"], "", "against: expected a law of flights.csv (none; write it into…"),
        (["0.ulg,a,,", "1.ulg,b,,", "2.ulg,c,,"], ["a"], "", "law: name the law of A;…a, b, c"),
        (["0.ulg,a,,", "1.ulg,b,,"], ["a"], "c", "law: expected another law of…(b), got c"),
        (["0.ulg,a,1,", "1.ulg,b,2,"], ["a"], "", "flights.csv:3: pair: expected one…"),
    ],
)
def test_what_a_list_leaves_open_is_asked_for(fly, rows, against, law, said):
    assert says(refusal(EqtError, compare_flights, listed(fly, rows), against, law=law), said)


def test_one_motion_of_two_names_counts_once():
    wanted = np.c_[np.cos(T), np.sin(1.3 * T), 0 * T + 1]
    header = "t,x,y,z,x_ref,y_ref,z_ref"
    for name, seed, late in ("a", 0, 0.0), ("b", 1, 0.0), ("c", 0, 3.0):
        flown = wanted + 0.01 * np.random.default_rng(seed).normal(size=wanted.shape)
        rows = np.c_[T + late, flown, wanted]
        np.savetxt(f"{name}.csv", rows, delimiter=",", header=header, comments="")
    said = refusal(EqtError, compare_flights, ["a.csv", "b.csv"], ["c.csv"])
    assert says(said, "c.csv: the same motion, by a clock 3 s ahead…as a.csv; a flight…once…")
    both = compare_flights(["a.csv", "b.csv"], ["c.csv"], duplicates=True)
    assert len(both.flights) == 3
