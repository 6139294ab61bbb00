"""The row *tracks*: of runs made up for it, one reason for each verdict, and of laws that fail.

And the class of groups of Remark 6.3.
"""

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.components.groups import ProductGroup, group_named
from eqt_cli.components.matrix_groups import SO3
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.extend import EqT, Lee2010
from eqt_cli.extensions.proofs.certificates import Runs, Verdict
from eqt_cli.extensions.proofs.run_checks import Fifths, Tracks, compact_times_vector
from eqt_cli.extensions.proofs.verification import verify_experiment

TIMES = np.linspace(0.0, 10.0, 101)
ONE = np.ones((3, 101))
GONE = np.exp(-2 * TIMES) * ONE
"""Nothing is left."""
SLOW = np.exp(-0.05 * TIMES) * ONE
"""0.67 of it is left, and it still falls."""
OFFSET = 0.6 * ONE + 0.4 * GONE
"""It stays."""
GROWS = np.exp(0.05 * TIMES) * ONE
LATE = TIMES * ONE / 10
"""The runs begin on the reference, and leave it."""


def row(pose=GONE, velocity=GONE, lyapunov=None, **changes):
    none = np.zeros(3)
    L = OFFSET if lyapunov is None else lyapunov
    runs = Runs("law", None, 1e-9, 0.05, TIMES, L, none, none, none, none, None, pose_error=pose,
                velocity_error=velocity, desired_speed=1.0)  # fmt: skip
    return Tracks().check(dataclasses.replace(runs, **changes))


@pytest.mark.parametrize(
    ("given", "verdict", "remark"),
    [
        ({}, "holds", "pose 1.1e-07, velocity 1.1e-07"),
        ({"pose": SLOW}, "undecided", "pose 0.67, velocity 1.1e-07; the error still falls"),
        ({"pose": OFFSET}, "FAILS", "pose 0.84, velocity 1.1e-07; the error no longer falls"),
        ({"velocity": OFFSET}, "FAILS", "pose 1.1e-07, velocity 0.84; the error no longer falls"),
        ({"pose": 0.05 * OFFSET}, "holds", "pose 0.84, velocity 1.1e-07"),
        ({"velocity": 0.05 * OFFSET}, "holds", "pose 1.1e-07, velocity 0.84"),
        ({"velocity": 0.05 * OFFSET, "desired_speed": 0.1}, "FAILS", None),
        ({"pose": GROWS}, "FAILS", "pose 1.5, velocity 1.1e-07; the error no longer falls"),
        ({"pose": OFFSET, "rate": 0.1}, "FAILS", None),
        ({"pose": OFFSET, "rate": 0.08}, "undecided", "pose 0.84, velocity 1.1e-07; small errors "
         "decay at 0.08 1/s, too slowly for this horizon"),
        ({"pose": GROWS, "lyapunov": GONE}, "undecided", None),
        ({"pose": LATE, "velocity": LATE}, "undecided", "pose 7.7, velocity 7.7; the runs begin on "
         "the reference"),
        ({"pose": LATE}, "FAILS", None),
        ({"pose": OFFSET, "departures": "constant force"}, "undecided", "pose 0.84, velocity "
         "1.1e-07; constant force"),
        ({"pose": GROWS, "departures": "constant force"}, "undecided", "pose 1.5, velocity "
         "1.1e-07; constant force"),
        ({"pose": GROWS, "lyapunov": GROWS, "departures": "constant force"}, "FAILS", None),
        ({"pose": None}, "undecided", "the result holds no trajectories"),
        ({"failed": 1}, "holds", "pose 1.1e-07, velocity 1.1e-07; 1 run failed"),
    ],
)  # fmt: skip
def test_each_verdict_has_its_reason(given, verdict, remark):
    found = row(**given)
    assert str(found.verdict) == verdict
    assert remark is None or found.remark == remark


def test_a_law_that_claims_a_decrease_does_not_fail_on_a_short_horizon():
    """While L has not grown; a law without a claim must show that its errors fall."""
    barely = (1 - 1e-4 * TIMES) * ONE
    found = row(pose=barely, lyapunov=barely, claims_decrease=True)
    assert (found.verdict, found.remark) == (
        Verdict.UNDECIDED,
        "pose 1, velocity 1.1e-07; L has not grown",
    )
    assert row(pose=barely, lyapunov=barely, claims_decrease=None).verdict is Verdict.FAILS
    rises = (1 + 1e-4 * TIMES) * ONE
    assert row(pose=rises, lyapunov=rises, claims_decrease=True).verdict is Verdict.FAILS


def test_what_is_measured_is_the_worse_of_the_medians():
    pose = np.array([1.0, 3.0, 8.0])[:, None] * GONE + np.array([0.2, 0.6, 0.1])[:, None]
    fifths = Fifths.of(TIMES, pose)
    assert row(pose=pose).measured == np.median(fifths.last / fifths.first)
    first, last = pose[:, :21], pose[:, 80:]
    np.testing.assert_allclose(fifths.first, np.sqrt((first**2).mean(axis=1)), rtol=1e-12)
    np.testing.assert_allclose(fifths.last, np.sqrt((last**2).mean(axis=1)), rtol=1e-12)


def test_too_few_samples():
    few = {"times": TIMES[[0, -1]], "pose": ONE[:, :2], "velocity": ONE[:, :2]}
    found = row(few["pose"], few["velocity"], ONE[:, :2], times=few["times"])
    assert (found.verdict, found.remark) == (Verdict.UNDECIDED, "2 samples are too few")


# Laws ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WithoutAcceleration(Lee2010):
    """Lee's law without J RᵀR_d Ω̇_d, as a popular firmware has it."""

    name: ClassVar[str] = "without acceleration"

    def torque(self, s):
        r = s.relative
        return super().torque(s) - r.inertia.momentum(r.G.Ad(r.G.inverse(r.Q), s.Vd_dot))


@dataclass(frozen=True)
class OtherStiffness(EqT):
    """The gradient with the other sign: the runs end half a turn away."""

    name: ClassVar[str] = "other stiffness"

    def torque(self, s):
        return super().torque(s) + 2 * s.G.Ad_star(s.Qd, s.gradient)


@pytest.mark.parametrize("law", [WithoutAcceleration(), OtherStiffness()], ids=lambda law: law.name)
def test_laws_in_the_experiment_of_the_paper(law):
    """Without a fault nothing is red in test_planted_faults.py."""
    few = "ensemble.runs=5", "time.samples=101", "solver.rtol=1.0e-6", "controllers=[eqt]"
    experiment = build(read_config(shipped.folder() / "paper.yaml", few))
    experiment.loops["eqt"] = dataclasses.replace(experiment.loops["eqt"], controller=law)
    rows = {row.name: row for row in verify_experiment(experiment).rows}
    assert rows["tracks"].verdict is Verdict.FAILS and rows["tracks"].measured > 0.9
    # Nothing else says so: a law that claims nothing cannot break a claim.
    others = {row.verdict for name, row in rows.items() if name != "tracks"}
    assert Verdict.FAILS not in others


class OfUnknownClass(SO3):
    name = "unknown"
    compact = compact_times_vector = None


@pytest.mark.parametrize("name", ["SO2", "SO3", "SE2", "SE3", "SE23", "R3", "SO3*SO2", "SO3*R3"])
def test_remark_6_3_class_of_the_group(name):
    assert compact_times_vector(group_named(name)) is True


@pytest.mark.parametrize(("other", "compact"), [("SO3", None), ("R3", False)])
def test_a_product_is_of_unknown_class_where_a_factor_is(other, compact):
    """Unless one factor settles it: a product with an unbounded factor is not compact."""
    for factors in ((OfUnknownClass(), group_named(other)), (group_named(other), OfUnknownClass())):
        assert ProductGroup(*factors).compact is compact
        assert compact_times_vector(ProductGroup(*factors)) is None
