"""Answers that hold at every look, looks that are told, models as covariates, drifts."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from said import says

from eqt_cli.extend import EqtError
from eqt_cli.extensions.flights import figures
from eqt_cli.extensions.flights.api import compare_flights
from eqt_cli.extensions.flights.every_look import blocks_of, p_value, pairs

RNG = np.random.default_rng(0)
A, B = (scale * np.exp(0.15 * RNG.normal(size=10)) for scale in (0.2, 0.3))


@pytest.fixture(autouse=True)
def _draw_nothing(monkeypatch):
    monkeypatch.setattr(figures, "save_flights", lambda *_: None)


def test_flights_may_be_added_until_it_is_decided(fly):
    of_a, of_b = fly(A, B)
    p = [compare_flights(of_a[:n], of_b[:n], sequential=True).pairs[0].p for n in (6, 10)]
    x, y = np.log(A), np.log(B)
    assert p == pytest.approx([p_value(pairs(x[:n] - y[:n])) for n in (6, 10)])
    found = compare_flights(of_a, of_b, sequential=True)
    assert (found.pairs[0].word, found.pairs[0].decided) == ("better", True)
    assert found.notes[-1].endswith("by bets on the signs of pairs: valid at every look")
    few = compare_flights(of_a[:6], of_b[:6], sequential=True)
    assert few.notes[0] == "6 pairs: 7 are the least for better or worse at any look"


def test_one_side_that_grows_alone_decides_nothing(fly):
    """Flights of A without one of B do not count, so that nobody chooses among more of them."""
    of_a, of_b = fly(A, B)
    short, grown = (compare_flights(of_a[:n], of_b[:7], sequential=True) for n in (7, 10))
    assert grown.pairs == short.pairs
    assert grown.notes[0].startswith("3 flights of A not counted yet: ")


def test_sides_of_a_list_may_have_other_numbers(fly):
    of_a, of_b = fly(A, B)
    rows = [f"{name},new" for name in of_a] + [f"{name},old" for name in of_b[:7]]
    Path("flights.csv").write_text("\n".join(["file,law", *rows]))
    found = compare_flights(["flights.csv"], ["old"], sequential=True)
    assert found.pairs == compare_flights(of_a, of_b[:7], sequential=True).pairs


def test_a_second_look_at_more_flights_is_told(fly):
    of_a, of_b = fly(A, B)

    def look(n, **how):
        return compare_flights(of_a[:n], of_b[:n], out="looks", **how).notes[0]

    assert look(6).startswith(
        "p and intervals hold for a number of flights that was planned before"
    )
    assert look(6) == look(6)
    assert says(look(8), "look 2, after looks at 6 and 6 flights:…use --sequential")
    assert look(10, sequential=True) == "look 3 at these flights: p and interval hold at every look"
    said = compare_flights(of_a, of_b, out="looks", of="median").notes[1]
    assert says(said, "errors were measured in another way before…")


def test_a_flight_that_was_looked_at_is_not_left_out(fly):
    of_a, of_b = fly(A, B)
    compare_flights(of_a[:8], of_b[:8], out="looks", sequential=True)
    said = refusal(EqtError, compare_flights, of_a[1:], of_b[1:], out="looks", sequential=True)
    assert says(said, "looks/looks.json: a0.ulg was flight 1 of A at look 1, and is not now;…")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mine", "looks/looks.json: cannot be read: eqt did not write it…"),
        ('{"looks": [{"how": 1}]}', "looks/looks.json: cannot be read: its looks are not of…"),
    ],
)
def test_looks_of_somebody_else_are_not_replaced(fly, text, said):
    Path("looks").mkdir()
    Path("looks/looks.json").write_text(text)
    assert says(refusal(EqtError, compare_flights, *fly(), out="looks"), said)
    assert Path("looks/looks.json").read_text() == text


def listed(fly, pairs_of_a, pairs_of_b):
    of_a, of_b = fly(A[: len(pairs_of_a)], B[: len(pairs_of_b)])
    rows = [f"{name},new,{pair}" for name, pair in zip(of_a, pairs_of_a, strict=True)]
    rows += [f"{name},old,{pair}" for name, pair in zip(of_b, pairs_of_b, strict=True)]
    Path("flights.csv").write_text("\n".join(["file,law,pair", *rows]))
    return ["flights.csv"], ["old"]


def test_a_list_has_blocks_of_several_flights(fly):
    found = compare_flights(*listed(fly, "112233445", "12345"), sequential=True)
    expected = p_value(blocks_of(np.log(A[:9]), np.log(B[:5]), [(2, 1)] * 4 + [(1, 1)]))
    assert found.pairs[0].p == pytest.approx(expected)
    said = refusal(EqtError, compare_flights, *listed(fly, "112", "12"))
    assert says(said, "flights.csv:2: pair: expected one flight of law old and one of new…")


def test_a_pair_without_a_partner_is_refused(fly):
    for of_a, of_b in (("1234", "123"), (["1", "2", "3", ""], "123")):
        said = refusal(EqtError, compare_flights, *listed(fly, of_a, of_b), sequential=True)
        assert says(said, "flights.csv:5: pair: expected flights of law old and of new in a pair…")


def test_laps_of_one_flight_in_turns_are_looked_at(fly):
    t = np.arange(0.0, 48.0, 0.1)
    size = np.where(t % 4 < 2, 0.2, 0.3) * (1 + 0.01 * np.floor(t / 2))
    name = fly.one("f.ulg", size, t, t)
    (one,) = compare_flights([name], within="AB" * 12, period=2.0, sequential=True).pairs
    assert (one.word, one.decided) == ("better", True)


def test_two_folders_are_before_and_after(fly):
    of_a, of_b = fly()
    for folder, names in (("after", of_a), ("before", of_b)):
        Path(folder).mkdir()
        for name in names:
            Path(folder, name).write_text(f"{folder}{name}")
    found = compare_flights(["before", "after"])
    assert found.pairs == compare_flights(["after"], ["before"]).pairs
    assert found.premises[0].startswith("A: after, flown after B: before;")


def test_a_drift_with_one_side_first_is_told(fly):
    drift = 0.2 * np.exp(0.05 * np.arange(12) + 0.01 * RNG.normal(size=12))
    said = compare_flights(*fly(drift[6:], drift[:6])).premises[-1]
    assert says(said, "drift: position errors change by +5…%…if all of B was flown first, that…")
    order = "abbaabbaabba"
    names = [[*fly(*(drift[[x == law for x in order]] for law in "ab"))[k]] for k in (0, 1)]
    rows = [f"{names['ab'.index(law)].pop(0)},{law}" for law in order]
    Path("turns.csv").write_text("\n".join(["file,law", *rows]))
    assert not any("drift" in line for line in compare_flights(["turns.csv"], ["b"]).premises)
    Path("blocks.csv").write_text("\n".join(["file,law", *sorted(rows)]))
    said = compare_flights(["blocks.csv"], ["b"]).premises[-1]
    assert says(said, "drift: position errors change by +…%…with A flown first, that alone makes…")


# A model ------------------------------------------------------------------------------------------


def with_model(fly, predicted, law=None):
    of_a, of_b = fly(A, B)
    rows = [f"{name},0.1,{x:.6f}" for name, x in zip([*of_a, *of_b], predicted, strict=True)]
    Path("model.csv").write_text("\n".join(["file,measured,predicted", *rows]))
    return of_a, of_b


def test_a_model_makes_flights_worth_more(fly):
    wind = np.r_[A / 0.2, B / 0.3] * np.exp(0.05 * RNG.normal(size=20))
    (one,) = compare_flights(*with_model(fly, wind), model="model.csv").pairs
    (plain,) = compare_flights(*fly(A, B)).pairs
    gain = (np.log(plain.high / plain.low) / np.log(one.high / one.low)) ** 2
    assert one.worth == pytest.approx(10 * gain)
    assert 30 < one.worth < 150
    assert one.ratio == pytest.approx(2 / 3, rel=0.05)


def test_predictions_of_one_law_are_taken(fly):
    of_a, of_b = fly(A, B)
    rows = [f"{name},{law},{x}" for name in [*of_a, *of_b] for law, x in (("b", 0.1), ("a", 0.2))]
    Path("model.csv").write_text("\n".join(["file,law,predicted", *rows]))
    compare_flights(of_a, of_b, model="model.csv")
    rows = [f"{x},a,0.2" for x in of_a] + [f"{x},b,0.1" for x in of_b]
    Path("model.csv").write_text("\n".join(["file,law,predicted", *rows]))
    said = refusal(EqtError, compare_flights, of_a, of_b, model="model.csv")
    assert says(said, "model.csv: no prediction by law a of…b0.ulg; expected one of every flight…")


def test_the_table_of_validate_is_read(fly):
    """It names flights without their folders, and stands elsewhere."""
    wind = np.r_[A / 0.2, B / 0.3] * np.exp(0.05 * RNG.normal(size=20))
    files = with_model(fly, wind)
    expected = compare_flights(*files, model="model.csv").pairs
    Path("there").mkdir()
    text = Path("model.csv").read_text().replace("file,measured", "flight,law")
    Path("there/predicted.csv").write_text(text)
    assert compare_flights(*files, model="there/predicted.csv").pairs == expected


def test_predictions_that_know_the_law_are_refused(fly):
    said = refusal(EqtError, compare_flights, *with_model(fly, [*A, *B]), model="model.csv")
    assert says(said, "model.csv: predictions of A are −…% against those of B, which flights in…")


def test_predictions_of_pairs_that_know_the_law_are_refused(fly):
    """They would explain the difference itself."""
    x = 0.2 * np.exp(0.02 * np.arange(-6, 6))
    of_a, of_b = fly(x, 1.5 * x[::-1])
    known = [*x, *(1.5 * x[::-1])]
    rows = [f"{name},{y:.6f}" for name, y in zip([*of_a, *of_b], known, strict=True)]
    Path("model.csv").write_text("\n".join(["file,predicted", *rows]))
    said = refusal(EqtError, compare_flights, of_a, of_b, model="model.csv", pair=True)
    assert says(said, "model.csv: predictions of A are −33 % against those of B, which flights in…")


def test_few_pairs_are_refused_with_a_model(fly):
    files = with_model(fly, [*A, *B])
    said = refusal(EqtError, compare_flights, *files, model="model.csv", pair=True)
    assert says(said, "model: 12 pairs are the least, got 10;…")


@from_yaml
def test_slips_with_looks_and_models(fly, options, table, said):
    of_a, of_b = fly(A, B)
    Path("model.csv").write_text(table)
    assert says(refusal(EqtError, compare_flights, of_a, **{"against": of_b} | options), said)
