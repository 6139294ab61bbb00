"""Laws over conditions: ratios, interactions, tables, against plain programs and simulations."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from said import says
from scipy import stats

from eqt_cli.extend import EqtError
from eqt_cli.extensions.flights.api import compare_conditions, compare_flights
from eqt_cli.extensions.flights.conditions import interactions, over_conditions

RNG = np.random.default_rng(0)
WINDS, SIZES = ["calm", "breeze", "gusts"], {"calm": 0.1, "breeze": 0.2, "gusts": 0.4}


def cells(differences, n=6, spread=0.2):
    return [
        (shift + spread * RNG.normal(size=n), spread * RNG.normal(size=n + 2))
        for shift in differences
    ]


def test_the_mean_over_conditions_is_that_of_contrasts():
    """With one condition, it is Welch's t; with three, its variance is a ninth of the sum."""
    one = cells([-0.3])
    ends, p = over_conditions(one, 0.95)
    welch = stats.ttest_ind(*one[0], equal_var=False)
    expected = welch.confidence_interval()
    assert ends[1:] == pytest.approx((expected.low, expected.high))
    three = cells([-0.1, -0.12, -0.08])
    ends, p = over_conditions(three, 0.95)
    parts = [part.var(ddof=1) / len(part) / 9 for cell in three for part in cell]
    freedom = sum(parts) ** 2 / sum(
        v**2 / (len(x) - 1) for v, x in zip(parts, (x for c in three for x in c), strict=True)
    )
    half = stats.t.ppf(0.975, freedom) * np.sqrt(sum(parts))
    assert ends.high - ends.value == pytest.approx(half)
    assert p == pytest.approx(
        2 * stats.t.sf(abs(ends.value) * 1.0 / np.sqrt(sum(parts)), freedom), abs=0.03
    )


def test_conditions_with_one_flight_each_are_pairs():
    single = [(x[:1], y[:1]) for x, y in cells([-0.3] * 7)]
    d = np.array([x[0] - y[0] for x, y in single])
    ends, _ = over_conditions(single, 0.95)
    expected = stats.ttest_1samp(d, 0).confidence_interval()
    assert ends[1:] == pytest.approx((expected.low, expected.high))
    assert interactions(single) == []


def test_intervals_cover_and_interactions_are_seldom_false():
    """1,000 tables of three conditions, whose errors differ in spread, too."""
    inside, found = 0, 0
    for _ in range(1_000):
        some = [(s * RNG.normal(size=5), s * RNG.normal(size=5)) for s in (0.1, 0.2, 0.3)]
        found += any(p <= 0.05 for _, p in interactions(some))
        parts = [np.mean(part) for cell in some for part in cell]
        inside += abs(np.mean(parts[::2]) - np.mean(parts[1::2])) <= _half(some)
    assert 0.93 <= inside / 1_000 <= 0.975
    assert found / 1_000 <= 0.065


def _half(some):
    from eqt_cli.extensions.flights.conditions import _contrasts

    ((ends, _),) = _contrasts(some, [np.full(3, 1 / 3)], 0.95)
    return ends.high - ends.value


@pytest.fixture
def flights(fly):
    """A list of two laws and a base in three winds, five flights each; `new` fails in gusts."""
    rows = ["file,law,condition,wind"]
    for law, factor in (("old", 1.0), ("new", 0.6), ("same", 1.0)):
        for wind in WINDS:
            for k in range(5):
                worse = 1.6 if (law, wind) == ("new", "gusts") else factor
                name = fly.one(
                    f"{law}{wind}{k}.ulg", worse * SIZES[wind] * np.exp(0.1 * RNG.normal())
                )
                rows.append(f"{name},{law},{wind},{SIZES[wind]}")
    Path("flights.csv").write_text("\n".join(rows))
    return "flights.csv"


def test_a_table_of_laws_and_conditions(flights):
    table = compare_conditions(flights, "old")
    at = {(x.law, x.condition): x for x in table.cells}
    assert [at["new", wind].word for wind in WINDS] == ["better", "better", "worse"]
    assert at["same", "all"].word == "undecided"
    rows = [line for line in Path(flights).read_text().splitlines() if "calm" in line]
    Path("calm.csv").write_text("\n".join(["file,law,condition,wind", *rows]))
    (one,) = compare_flights(["calm.csv"], ["old"], law="new").pairs
    assert at["new", "calm"][5:8] == pytest.approx((one.ratio, one.low, one.high))
    assert at["new", "all"].ratio == pytest.approx(
        np.prod([at["new", x].ratio for x in WINDS]) ** (1 / 3)
    )
    assert any(
        says(note, "interaction: new in gusts: +…% against its ratio elsewhere, p…")
        for note in table.notes
    )
    assert not any("same in" in note for note in table.notes)
    by_wind = compare_conditions(flights, "old", by="wind")
    assert by_wind.conditions == ["0.1", "0.2", "0.4"]
    assert [x[3:] for x in by_wind.cells] == [x[3:] for x in table.cells]


def test_the_command_prints_text_csv_and_latex(flights, invoke):
    command = ["log", "compare", flights, "--against", "old", "--by", "wind"]
    text = invoke(*command, "--out", "forest").stdout
    assert says(" ".join(text.split()), "errors against old, by wind error law all p 0.1 0.2 0.4…")
    assert {x.name for x in Path("forest").glob("forest.*")} == {
        "forest.pdf",
        "forest.png",
        "forest.svg",
    }
    assert invoke(*command, "--format", "csv").stdout.startswith(
        "metric,law,condition,flights,against,ratio"
    )
    assert r"\toprule" in invoke(*command, "--format", "latex").stdout
    said = invoke(*command, "--sequential", code=2).stderr
    assert said.startswith("eqt: error: --by compares all laws of a list with one law")
    assert said.endswith("; leave out --sequential\n")


@from_yaml
def test_slips_with_conditions(flights, columns, arguments, said):
    lines = Path(flights).read_text().splitlines()
    if columns:
        lines = [line for line in lines if not line.startswith(columns)]
    Path(flights).write_text("\n".join(lines))
    named = {"path": flights, "against": "old"} | arguments
    assert says(refusal(EqtError, compare_conditions, **named), said)
