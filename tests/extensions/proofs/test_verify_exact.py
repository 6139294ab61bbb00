"""`eqt verify --exact`: what is proved, what is not and why, and faults that floats do not show."""

import json
import re
from fractions import Fraction

import pytest
from plugin_sources import component
from said import mentions

from eqt_cli.extensions.proofs.sample import written

HEAD = component("""
import numpy as np
mine(eqt_cli.components.laws.EqT):
    claims_decrease: ClassVar[bool] = True
    dissipation = EqT.dissipation

    def torque(self, s):
        return super().torque(s) + """)
LAWS = {"right": "0.0", "wrong": "1e-30 * s.V_tilde", "numpy": "0.0 * np.sin(s.V)"}
ONE = ("--runs", 1, "--exact", "--set", "plugins=[mine.py]", "--set", "controllers=[mine]")


@pytest.fixture
def law(folder):
    def write(name):
        (folder / "mine.py").write_text(f"{HEAD}{LAWS[name]}\n", encoding="utf-8")

    return write


def identities(document):
    return {row["name"]: row for row in document["rows"] if row["kind"] == "identity"}


def test_rows_say_with_what_certainty_they_are_proved(eqt, law):
    law("right")
    done = eqt("verify", "c.yaml", *ONE, "--json")
    assert (done.code, done.err) == (0, "")
    rows = identities(json.loads(done.out))
    rate = rows["rate of L"]
    assert (rate["verdict"], rate["degree"], rate["points"]) == ("proved", 20, 3)
    assert rate["probability"] == pytest.approx((20 / 2**64) ** 3)
    assert (rate["not_proved"], rate["difference"]) == ("", "")
    assert rate["measured"] <= rate["bound"]
    drift = rows["drift of every part"]
    assert (drift["verdict"], drift["degree"], drift["probability"]) == ("holds", None, None)
    assert drift["not_proved"] == "a distance is a square root"


def test_what_is_not_proved_is_listed_with_the_reason(eqt, law):
    law("right")
    done = eqt("verify", "c.yaml", *ONE)
    open_rows = [x for x in done.out.splitlines() if x.startswith("? not proved: ")]
    assert [line.rpartition(": ")[2] for line in open_rows] == [
        "exp and log are not rational",
        "a distance is a square root",
        "eigenvalues are roots of polynomials",
    ]
    full = eqt("verify", "c.yaml", *ONE, "--verbose").out
    assert mentions(" ".join(full.split()), "proved: both sides are equal as rational functions…")
    [rate] = [line for line in full.splitlines() if "  rate of L  " in line]
    assert rate.endswith("  proved   degree 20, 3 states, p ≤ 1.3e-54")
    proved = sum(bool(re.search("  proved   degree [0-9]+, ", line)) for line in full.splitlines())
    [rate] = [line for line in full.splitlines() if "  certified rate of small errors  " in line]
    assert "  proved  1/s, in the box of the sampled V_d; overshoot 1." in re.sub("  +", "  ", rate)
    assert f" hold   ✓ {proved + 1} proved   " in done.out


def test_a_fault_that_floats_do_not_show_ends_with_4(eqt, law):
    law("wrong")
    done = eqt("verify", "c.yaml", *ONE, "--json")
    document = json.loads(done.out)
    assert (done.code, document["holds"]) == (4, False)
    assert document["causes"] == ["Theorems 3.2, 6.2: rate of L (mine) fails"]
    rate = identities(document)["rate of L"]
    assert rate["measured"] <= rate["bound"]
    assert 0 < abs(Fraction(rate["difference"])) < 1e-26
    assert rate["remark"] == (
        f"left − right = {written(Fraction(rate['difference']))} of equation 1, "
        "at a random state of small integers"
    )


def test_a_law_that_exact_numbers_cannot_be_put_into_says_at_which_line(eqt, law):
    law("numpy")
    rows = identities(json.loads(eqt("verify", "c.yaml", *ONE, "--json").out))
    line = HEAD.count("\n") + 1
    assert rows["rate of L"]["not_proved"] == (
        "cannot be evaluated on exact numbers: TypeError: loop of ufunc does not support argument "
        "0 of type Exact which has no callable sin method, "
        f"at mine.py:{line}: return super().torque(s) + 0.0 * np.sin(s.V)"
    )


def test_identities_of_a_result_are_proved_too(eqt):
    eqt("run", "c.yaml", "--quiet", "--set", "controllers=[eqt]")
    rows = identities(json.loads(eqt("verify", "results/c", "--exact", "--json").out))
    assert rows["rate of L"]["verdict"] == "proved"
