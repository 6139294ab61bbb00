"""`eqt verify`, within this process: what it prints where, and how it ends."""

import json
import re
from collections import Counter
from pathlib import Path

import pytest
from plugin_sources import ESCAPE, component
from said import says

from eqt_cli.config import shipped
from eqt_cli.extensions.proofs.certificates import Row, Verdict, open_rows

DRIVES_AWAY = component("""
away(eqt_cli.components.laws.EqT):
    title: ClassVar[str] = "Away"

    def torque(self, s):
        return super().torque(s) + 2 * s.body_damping

    def dissipation(self, s):
        return super().dissipation(s)
""")
CERTIFICATE = '''\
from typing import ClassVar
from eqt_cli.extensions.proofs.certificates import Certificate
from eqt_cli.extensions.proofs.certificates import Identity

class Mine(Identity):
    """My own."""

    name: ClassVar[str] = "a statement of my own"
    statement: ClassVar[str] = "my notes, p. 3"
    section: ClassVar[float] = 99.0

    def sides(self, sample):
        yield sample.s.V, sample.s.V_tilde + sample.s.Vd
'''
AWAY = ("--set", "plugins=[away.py]", "--set", "controllers=[away]")


@pytest.fixture
def plugins(folder):
    (folder / "away.py").write_text(DRIVES_AWAY, encoding="utf-8")
    (folder / "escape.py").write_text(ESCAPE, encoding="utf-8")
    (folder / "mine.py").write_text(CERTIFICATE, encoding="utf-8")


def row(document, name, controller=""):
    [found] = [
        entry
        for entry in document["rows"]
        if (entry["name"], entry["controller"]) == (name, controller)
    ]
    return found


def test_a_configuration(eqt):
    done = eqt("verify", "c.yaml", "-v")
    assert (done.code, done.err) == (0, "")
    blocks = done.out.split("\n\n")
    assert [block.split(",")[0].split(":")[0] for block in blocks[1:]] == [
        "Identities",
        "Trajectories",
        "Hypotheses",
        "undecided",
    ]
    assert re.match(r"✓ \d+ hold   \? \d undecided   0 fail\n\? undecided: ", blocks[0])
    assert blocks[0].endswith("\nc on SO3, 6 runs with engine solve_ivp")
    header, rule, first, *_ = blocks[1].splitlines()[1:]
    assert header.split() == "statement what law measured bound verdict".split()
    assert set(rule) == {"─", " "}
    assert first.startswith("eq. (1)  ") and first.endswith("  holds")
    assert "Morse-Bott" in blocks[3]


def test_json_has_every_row_and_without_verbose_only_what_does_not_hold_is_listed(eqt):
    done = eqt("verify", "c.yaml", "--json")
    document = json.loads(done.out)
    assert (done.code, done.err) == (0, "")
    assert document["verified"] == "c.yaml"
    assert (document["name"], document["group"], document["engine"]) == ("c", "SO3", "solve_ivp")
    assert (document["runs"], document["failed"], document["holds"]) == (6, 0, True)
    assert document["causes"] == []
    left = row(document, "left invariance")
    assert (left["statement"], left["kind"], left["verdict"]) == (
        "Theorem 4.1",
        "identity",
        "holds",
    )
    assert left["measured"] <= left["bound"] < 1e-12
    assert row(document, "energy balance", "gt")["verdict"] == "holds"
    assert row(document, "Υ is a navigation function")["verdict"] == "Morse-Bott"
    rows = document["rows"]
    done = eqt("verify", "c.yaml")
    assert (done.code, done.err) == (0, "")
    totals, *lines, where, hint = done.out.splitlines()
    assert all(line.startswith("? ") for line in lines)
    assert where == "c on SO3, 6 runs with engine solve_ivp"
    assumed = sum(row["kind"] == "hypothesis" for row in rows)
    stated = len(rows) - assumed
    assert hint.startswith(f"checked: {stated} statements; hypotheses: {assumed}; --verbose")
    counts = dict(reversed(count.split()[-2:]) for count in totals.split("   "))
    verdicts = Counter(row["verdict"] for row in rows if row["kind"] != "hypothesis")
    assert sum(map(int, counts.values())) == stated
    assert counts.pop("hold") == str(verdicts.pop("holds"))
    assert counts.pop("fail") == "0"
    assert counts == {verdict: str(count) for verdict, count in verdicts.items()}


def test_rows_of_one_cause_stand_in_one_line_with_the_runs_of_each_law():
    def row(name, law, verdict="undecided", remark="", kind="trajectory"):
        return Row(name, "Theorem 6.2", kind, law, 0.1, 0.05, Verdict(verdict), remark)

    late = "{} of 20 runs not converged at 20 s; L decays at 0.36 1/s (median)"
    rows = [
        row("V_d is bounded", "", "unknown", "supremum over the horizon", "hypothesis"),
        row("Q → Q_d", "EqT", remark=late.format(16)),
        row("Q → Q_d", "GT", "holds"),
        row("Q → Q_d", "nog", remark=late.format(20)),
        row("P → P_d", "EqT", remark=late.format(3)),
        row("energy balance", "EqT", "FAILS"),
        row("decrease of L", "EqT", "not covered", "drag, sampled control"),
        row("decrease of L", "GT", "not covered", "drag, sampled control"),
    ]
    assert open_rows(rows) == [
        "? undecided: Q → Q_d (EqT 16, nog 20); P → P_d (EqT 3) of 20 runs not converged at 20 s",
        "? unknown: V_d is bounded",
        "? not covered: decrease of L (EqT, GT): drag, sampled control",
    ]


def test_what_is_not_claimed_is_named_in_one_line(eqt):
    off_plane = "controllers=[{kind: family, label: off, transport: 0.2}, {kind: family, label: b}]"
    done = eqt("verify", "c.yaml", "--set", off_plane)
    said = "? unclaimed: decrease of L (off): not claimed of this law"
    assert said in done.out.splitlines(), done.out


@pytest.mark.usefixtures("plugins")
def test_plugins_of_a_result_are_executed_on_request_and_quiet_prints_only_what_fails(
    eqt, refused, forget_plugins
):
    assert (done := eqt("verify", "c.yaml", "--quiet")).out + done.err == ""
    eqt("run", "c.yaml", "--quiet", *AWAY)
    forget_plugins()
    assert "add --trust-plugins" in refused("verify", "results/c")
    done = eqt("verify", "results/c", "--trust-plugins", "--quiet")
    assert (done.code, done.out) == (4, "")
    assert done.err.splitlines() == [
        "eqt: error: results/c: Theorems 3.2, 6.2: rate of L (Away) fails",
        "eqt: error: results/c: Theorems 3.2, 6.2: energy balance (Away) fails",
        "eqt: error: results/c: measured on the runs: tracks (Away) fails",
    ]


@pytest.mark.ci("verifies the paper's experiment")
def test_paper_shows_what_it_claims(eqt):
    """Every identity holds, energy balance and decrease of L too; K_p = I is Morse-Bott."""
    paper = shipped.folder() / "paper.yaml"
    done = eqt("verify", paper, "--json", "--runs", 3)
    assert done.code == 0
    rows = json.loads(done.out)["rows"]
    assert {each["verdict"] for each in rows if each["kind"] == "identity"} == {"holds"}
    assert len([each for each in rows if each["kind"] == "identity"]) == 30
    certain = ("energy balance", "decrease of L")
    assert {each["verdict"] for each in rows if each["name"] in certain} == {"holds"}
    assert row({"rows": rows}, "Υ is a navigation function")["verdict"] == "Morse-Bott"
    [remark] = {each["remark"][-28:] for each in rows if each["name"] == "Q → Q_d"} & {
        each["remark"][-28:] for each in rows if each["controller"] == "nog"
    }
    assert remark.endswith("1/s (median)")


def test_a_result_is_verified_by_what_it_holds(eqt):
    eqt("run", "c.yaml", "--quiet")
    done = eqt("verify", "results/c", "--json")
    assert done.code == 0
    document = json.loads(done.out)
    assert (document["verified"], document["runs"]) == ("results/c", 6)
    from_config = json.loads(eqt("verify", "c.yaml", "--json").out)
    for one, other in zip(document["rows"], from_config["rows"], strict=True):
        assert one["verdict"] == other["verdict"]
        if other["measured"] is not None:
            assert one["measured"] == pytest.approx(other["measured"], rel=1e-6, abs=1e-9)


def test_a_result_without_trajectories(eqt):
    few = ("--set", "controllers=[eqt]", "--set", "store.trajectories=none")
    eqt("run", "c.yaml", "--quiet", *few)
    document = json.loads(eqt("verify", "results/c", "--json").out)
    assert row(document, "decrease of L", "eqt")["verdict"] == "undecided"
    assert row(document, "energy balance", "eqt")["verdict"] == "holds"


def test_a_result_with_some_samples_of_some_trajectories(eqt):
    stored = ("--set", "store.trajectories=2", "--set", "store.decimate=5")
    some = ("--set", "controllers=[eqt]", *stored)
    eqt("run", "c.yaml", "--quiet", *some)
    document = json.loads(eqt("verify", "results/c", "--json").out)
    assert row(document, "decrease of L", "eqt")["verdict"] == "holds"
    assert row(document, "Q_d is bounded")["verdict"] == "holds"


def test_a_result_is_verified_as_it_is(eqt, refused):
    eqt("run", "c.yaml", "--quiet")
    for option in (("--set", "gains.kp=2"), ("--engine", "native"), ("--runs", "2")):
        assert says(
            refused("verify", "results/c", *option), "results/c: a result is verified as it is…\n"
        )


@pytest.mark.usefixtures("plugins")
def test_a_statement_that_does_not_hold_ends_with_4(eqt):
    done = eqt("verify", "c.yaml", *AWAY)
    assert done.code == 4
    assert re.match(r"✓ \d+ hold   \? \d unclaimed   3 fail\n", done.out)
    assert done.out.splitlines()[1:4] == [
        "Theorems 3.2, 6.2: rate of L (Away) fails",
        "Theorems 3.2, 6.2: energy balance (Away) fails",
        "measured on the runs: tracks (Away) fails",
    ]
    _, table, _ = done.out.split("\n\n")
    assert [line.split()[-2] for line in table.splitlines()[2:5] if "FAILS" in line] != []
    document = json.loads(eqt("verify", "c.yaml", *AWAY, "--json").out)
    assert document["holds"] is False
    assert len(document["causes"]) == 3


@pytest.mark.usefixtures("plugins")
def test_failed_runs_end_with_3(eqt):
    escape = ("--set", "plugins=[escape.py]", "--set", "controllers=[escape]")
    done = eqt("verify", "c.yaml", *escape, "--set", "solver.rtol=1e-3", "--runs", 1, "--json")
    document = json.loads(done.out)
    assert (done.code, document["failed"]) == (3, 1)
    assert document["causes"] == ["1 of 1 run failed"]
    assert row(document, "energy balance", "escape")["verdict"] == "undecided"


def test_a_law_of_which_every_run_fails_is_not_asked_about_none(eqt):
    text = ESCAPE.replace("20 * s.V_tilde**3", "s.V.reshape(len(s.V), -1).reshape(s.V.shape) / 0.0")
    Path("nan.py").write_text(text, encoding="utf-8")
    done = eqt(
        "verify", "c.yaml", "--set", "plugins=[nan.py]", "--set", "controllers=[eqt, escape]"
    )
    assert (done.code, done.err) == (3, "")
    assert re.fullmatch(r"(\d+) of \d+ runs failed", done.out.splitlines()[1])


@pytest.mark.usefixtures("plugins")
def test_a_plugin_may_bring_a_certificate(eqt):
    done = eqt("verify", "c.yaml", "--json", "--set", "plugins=[mine.py]")
    own = row(json.loads(done.out), "a statement of my own")
    assert (own["verdict"], own["statement"]) == ("holds", "my notes, p. 3")


@pytest.mark.ci("verifies another result")
def test_runs_bounds_what_is_integrated(eqt):
    assert json.loads(eqt("verify", "c.yaml", "--json", "--runs", 1).out)["runs"] == 2
    assert json.loads(eqt("verify", "c.yaml", "--json", "--runs", 99).out)["runs"] == 6


def test_laws_that_fly_with_turned_gains_stand_in_the_summary(eqt):
    """At 90 deg about x the stiffness diag(5, 4, 3) of K = diag(1, 2, 3) meets the axes x, z, y.

    About z, with J = 3 and K_d = 1: s = −1/6 ± i √(k/3 − 1/36), k = 4 for 3.
    """
    gains = "gains={kp: [1, 2, 3], kd: 1}"
    reference = "reference={kind: constant, pose: {rotvec: [90 deg, 0, 0]}}"
    done = eqt("verify", "c.yaml", "--runs", 1, "--set", gains, "--set", reference)
    pole = "slowest pole −0.167 ± 1.14i rad/s at 0 s, −0.167 ± 0.986i at Q_d = I: K in space"
    said = " ".join(done.out.split())
    assert all(f"small errors of {law}: {pole}" in said for law in ("EqT", "GT")), done.out


def test_hypotheses_in_doubt_stand_in_the_summary(eqt):
    off_plane = "controllers=[{kind: family, label: off, transport: 0.2}]"
    torque = 'reference={torque: ["exp(t)", "0", "0"]}'
    done = eqt("verify", "c.yaml", "--verbose", "--set", off_plane, "--set", torque)
    assert done.code == 0
    summary, *lines = done.out.split("\n\n")[0].splitlines()
    assert summary.endswith(" unclaimed   0 fail")
    assert {"? growing: V_d is bounded", "? violated: theorem for the law (off)"} < set(lines)
    legend = done.out.split("\n\n")[4].splitlines()
    assert "violated: the theorems do not cover this experiment." in legend
    assert "unclaimed: the paper does not claim this for the law." in legend
    assert not any(line.startswith("unknown:") for line in legend)


def test_a_sweep_is_left_out_and_that_is_said(eqt, folder):
    text = (folder / "c.yaml").read_text(encoding="utf-8")
    swept = text + "sweep: [{grid: {gains.kd: [1, 2]}}]\n"
    (folder / "s.yaml").write_text(swept, encoding="utf-8")
    done = eqt("verify", "s.yaml", "--json")
    assert done.code == 0
    assert done.err == (
        "s.yaml: verified without its sweep; choose one of its points with --point\n"
    )
    assert json.loads(done.out)["runs"] == 6


def test_the_result_of_a_sweep_is_refused(eqt, refused):
    eqt("sweep", "c.yaml", "--grid", "gains.kd=1,2", "--out", "swept", "--quiet")
    assert says(
        refused("verify", "swept"),
        f"{Path('swept/results.h5')}: one experiment is verified, and this is…\n",
    )
