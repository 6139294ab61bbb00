"""The shipped configurations: one for every group at least, each certified.

By `solve_ivp`, and some of each kind of loop by `native` too; the one with the most control
instants by `native` alone. That the engines agree is tested in tests/engines.
"""

from functools import cache
from pathlib import Path

import pytest
from ci_cases import mostly_ci

from eqt_cli.base.yaml_source import load
from eqt_cli.components.groups import ProductGroup, groups
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.engines.choice import unavailable
from eqt_cli.engines.engine import engines
from eqt_cli.extend import EqtError

# The first seconds of a few runs, which show what is wrong with a law as well as all of them.
SHORT = ["time.duration=1", "time.samples=11", "ensemble.runs=2", "solver.rtol=1.0e-8"]

UNMATCHED = ("goodarzi2013", "slotine_li", "sliding", "maithripala2006", "lqr")
UNCLAIMED = {
    ("satellite_panels", "decrease of L", "no feedforward"),
    *(("crazyflie", "energy balance", label) for label in ("cascade", "without rates")),
    ("sweep_lqr", "energy balance", "lqr"),
    ("quadrotor_recovery", "energy balance", "cascade"),
    *(("quadrotor_speeds", "energy balance", label) for label in ("cascade", "lqr")),
    *(("planar_vtol", "energy balance", label) for label in ("model", "no rates")),
    *(("quadrotor_lee", "energy balance", label) for label in ("filter", "no rates")),
    ("quadrotor_gnss", "energy balance", "cascade"),
    *((name, "decrease of L", "goodarzi2013") for name in ("reviewers", "reviewers_se3")),
}

AS_IT_FLIES = (
    "cubesat cubesat_orbit cubesat_sun crazyflie planar_vtol quadrotor_lee "
    "quadrotor_lee_upside_down quadrotor_gnss quadrotor_recovery quadrotor_speeds tune_flies "
    "satellite_breaks satellite_estimated satellite_wheels se3_bluerov2_estimated "
    "se3_bluerov2_flies se3_bluerov2_navigation se3_bluerov2_thrusters sweep_lag sweep_lqr "
    "sweep_region"
).split()
"""Of loops that the theorems do not cover."""


def experiment(name, *overrides):
    return build(read_config(shipped.folder() / f"{name}.yaml", overrides))


@cache
def found(name, engine):
    from eqt_cli.extensions.proofs.verification import verify_experiment

    return verify_experiment(experiment(name, *SHORT, f"solver.engine={engine}"))


def test_every_group_has_a_configuration():
    shown = {load(shipped.text(name), name).data.get("group", "") for name in shipped.names()}
    for kind in groups.all():
        named = [example for example in kind.examples() if example in shown]
        is_product = kind is ProductGroup and any("*" in name for name in shown)
        factor = any(f"*{example}" in name for name in shown for example in kind.examples())
        assert named or is_product or factor, kind.name


SLOW = ("crazyflie", "quadrotor_gnss", "se3_bluerov2_navigation", "se3_bluerov2_thrusters")
"""Which take seconds by solve_ivp."""
BY_NATIVE = ("satellite_panels", "se3_bluerov2_flies", "attitude_distinct", *SLOW)
BY_SOLVE_IVP = [name for name in shipped.names() if name not in BY_NATIVE]
ENGINES = {"solve_ivp": BY_SOLVE_IVP, "native": BY_NATIVE}


CASES = [f"{name}-{engine}" for engine, names in ENGINES.items() for name in names]


@pytest.mark.needs("proofs")
@mostly_ci("case", CASES, ["attitude_distinct-native"], "verifies the laws of an experiment")
def test_certificates_hold(case):
    from eqt_cli.extensions.proofs.certificates import Verdict

    name, engine = case.split("-")
    if unavailable(engines.get(engine)):
        pytest.skip(f"engine {engine} is not installed")
    verification = found(name, engine)
    assert not verification.failed_runs
    fails = [row for row in verification.rows if row.verdict is Verdict.FAILS]
    # The law without rates diverges, which is what the configuration shows.
    assert [
        row.controller for row in fails if (name, row.name) != ("quadrotor_lee", "tracks")
    ] == []
    for row in verification.rows:
        if row.kind == "identity" and row.verdict is not Verdict.HOLDS:
            if (name, row.name) == ("planar_vtol", "rates of the commanded attitude"):
                continue  # numbers with bounds choose no piece of a minimum snap
            assert row.verdict is Verdict.UNCLAIMED
            assert row.name == "stiffness and damping of small errors"
            assert row.controller in UNMATCHED
    certain = ("energy balance", "decrease of L")
    for row in verification.rows:
        uncovered = row.name == "decrease of L" and name in AS_IT_FLIES
        if uncovered:
            assert row.verdict is Verdict.NOT_COVERED, row
        elif row.name in certain and (name, row.name, row.controller) not in UNCLAIMED:
            assert row.verdict is Verdict.HOLDS, row
    # What the horizon decides is left out: it is short here.
    exceptions = Verdict.NOT_COVERED, Verdict.UNCLAIMED, Verdict.VIOLATED, Verdict.MORSE_BOTT
    rows = [
        row
        for row in verification.rows
        # The first second, or a run that diverges, decides the least F here.
        if not (name.startswith("quadrotor_lee") and row.name == "F is not 0")
    ]
    verdicts = {row.verdict for row in rows} & set(exceptions)
    diverges = {Verdict.VIOLATED} if name == "quadrotor_lee" else set()
    assert documented()[name] - diverges == verdicts


def documented():
    """What the documentation says of each shipped configuration."""
    from eqt_cli.extensions.proofs.certificates import Verdict

    page = Path(__file__).parents[2] / "docs/reference/verdicts.md"
    lines = page.read_text(encoding="utf-8")
    lines = lines.split("## Shipped configurations")[1].split("\n## ")[0]
    rows = [line.split("|")[1:-1] for line in lines.splitlines() if line.startswith("| `")]
    return {
        name.strip(" `"): {Verdict(word) for word in said.strip().split(", ") if word}
        for name, said, *_ in rows
    }


@pytest.mark.needs("proofs")
def test_every_configuration_is_reviewed():
    assert sorted(documented()) == sorted(shipped.names())


@pytest.mark.needs("proofs")
@pytest.mark.skipif(unavailable(engines.get("native")) is not None, reason="no compiler")
def test_weights_of_the_slow_escape_are_a_navigation_function():
    from eqt_cli.extensions.proofs.certificates import Verdict

    verification = found("attitude_distinct", "native")
    [row] = [row for row in verification.rows if row.name == "Υ is a navigation function"]
    assert row.verdict is Verdict.HOLDS
    assert row.remark.count("half-turn") == 3


def test_slow_escape_starts_next_to_a_maximum_of_the_potential():
    from drawn_starts import draw_initial_states

    from eqt_cli.components.inertia import critical_sets, distance_to_unstable

    one = experiment("attitude_distinct")
    Q, _ = draw_initial_states(
        one.group,
        one.start.poses,
        one.start.velocities,
        Qd=one.desired.pose,
        Vd=one.desired.velocity,
        seed=one.config.ensemble.seed,
        runs=range(20),
    )
    K = next(iter(one.loops.values())).gains.K
    # A milliradian from the half-turn, times √2 per axis and the tail of twenty normal draws.
    assert 1e-5 < distance_to_unstable(one.group, K, Q).max() < 1e-2
    sets = critical_sets(one.group, K)
    assert sets is not None
    nearest = min(sets, key=lambda each: each.squared_distance(Q).max())
    assert nearest.index == 3


def test_panels_of_the_satellite_unfold():
    law = next(iter(experiment("satellite_panels").loops.values())).inertia
    folded, unfolded = law.at(0.0).matrix, law.at(60.0).matrix
    assert unfolded[0, 0] / folded[0, 0] == pytest.approx(4.0, rel=1e-4)
    assert unfolded[1, 1] == folded[1, 1]


@pytest.mark.parametrize("name", ["se3_bluerov2", "se3_bluerov2_flies", "se3_bluerov2_thrusters"])
def test_inertia_of_the_bluerov2_is_that_of_its_source(name):
    """M of Fossen's order (v, ω) with added mass, rows and columns taken to (ω, v)."""
    import numpy as np

    m, z_g, added, rotational = 11.5, 0.02, np.array([5.5, 12.7, 14.57]), 0.16 + 0.12
    r = np.array([[0, -z_g, 0], [z_g, 0, 0], [0, 0, 0]])  # r_g^× for r_g = (0, 0, z_g)
    fossen = np.block([[np.diag(m + added), -m * r], [m * r, rotational * np.eye(3)]])
    order = [3, 4, 5, 0, 1, 2]
    law = next(iter(experiment(name).loops.values())).inertia
    np.testing.assert_allclose(law.at(0.0).matrix, fossen[np.ix_(order, order)], atol=1e-15)


def test_a_folder_of_other_files_does_not_hide_a_shipped_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("paper").mkdir()
    Path("paper", "paper.tex").touch()
    assert read_config(Path("paper")).source.name == str(shipped.folder() / "paper.yaml")
    Path("paper", "mine.yaml").touch()
    with pytest.raises(EqtError, match=r"^paper: is a folder without a result; give one of its"):
        read_config(Path("paper"))
