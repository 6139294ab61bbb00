"""Runs that rounding decides, and numbers that are nothing but rounding."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from case_tables import in_ci
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.base.reporting import brief, fixed, percent, significant
from eqt_cli.cli.output import json_text
from eqt_cli.cli.result_tables import print_outcome
from eqt_cli.engines.horizon import _jumps
from eqt_cli.extend import Status
from eqt_cli.results.quantity import in_one_form
from eqt_cli.results.result import open_result
from eqt_cli.results.summary import headline

HALF_TURN = {"kind": "angle", "angle": "180 deg", "axis": [1, 0, 0]}
AT_REST, MOVING = ({"kind": "speed", "speed": x, "axis": [1, 0, 0]} for x in (0.0, 0.1))

SPIN = {"torque": ["0", "0", "0"], "velocity": [3, 0, 0]}
"""A reference that turns freely about its middle axis: 𝕀 = diag(2, 1, 3) kg m²."""

QUADROTOR: dict[str, Any] = {
    "group": "SE3",
    "inertia": [0.013, 0.014, 0.025, 1.0, 1.0, 1.0],
    "model": {"forces": [{"kind": "restoring", "weight": 9.81}]},
    "reference": {"kind": "flat", "position": [0, 0, 0], "heading": 0},
    "controllers": [
        {
            "kind": "cascade",
            "attitude": "lee2010",
            "along": [0, 0, 1],
            "position": {"kx": 6.25, "kv": 4.0},
            "gains": {"kp": 0.4, "kd": 0.12},
        }
    ],
}


def upside_down(height: float) -> dict[str, Any]:
    """A half-turn about x: exp takes the coordinate y to the height 2/π y."""
    coordinates = [math.pi, 0, 0, 0, math.pi / 2 * height, 0]
    return {"pose": {"kind": "fixed", "coordinates": coordinates}}


def statuses(folder: Path, duration: float, samples: int = 51, **changes: Any) -> set[int]:
    """The statuses of a run of some seconds; at a constant reference, unless there is another."""
    gains = {"kp": 4.0, "kd": 0.5}
    changes = {"reference": {"kind": "constant"}, "controllers": ["eqt"], "gains": gains} | changes
    once = {"ensemble": {"runs": 1}, "time": {"duration": duration, "samples": samples}}
    api.run(mapping(name="r", **changes, **once), folder / "r")
    with open_result(folder / "r") as result:
        return set(result.status.ravel().tolist())


@pytest.mark.parametrize(
    ("duration", "changes"),
    [
        (10.0, {"initial": {"pose": HALF_TURN, "velocity": AT_REST}}),
        in_ci(
            "as the first", 10.0, {"initial": {"pose": HALF_TURN}, "controllers": ["quaternion"]}
        ),
        in_ci("tightly solved", 20.0, {"reference": SPIN}),
        in_ci("as a cascade", 6.0, QUADROTOR | {"initial": upside_down(0)}),
        in_ci("as a cascade", 6.0, QUADROTOR | {"initial": upside_down(0.5)}),
    ],
    ids=["half-turn", "jump at a half-turn", "middle axis", "hangs", "moves up inverted"],
)
def test_a_start_at_an_unstable_motion_is_decided_by_rounding(
    tmp_path: Path, duration: float, changes: dict[str, Any]
) -> None:
    assert statuses(tmp_path, duration, **changes) == {Status.BY_ROUNDING}


def test_such_a_run_counts_neither_way_and_no_tolerance_is_advised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    statuses(tmp_path, 10.0, initial={"pose": HALF_TURN, "velocity": AT_REST})
    with open_result(tmp_path / "r") as result:
        (row,) = headline(result)
        print_outcome(result)
    assert (row["runs"], row["failed"], row["by_rounding"], row["settled"]) == (1, 1, 1, 0)
    out, err = capsys.readouterr()
    assert "0/0" in out
    assert "1 run failed: 1 by rounding\n  eqt run 0: rounding decides" in err
    assert "tighten" not in err


@pytest.mark.parametrize(
    ("duration", "changes"),
    [
        in_ci("moves", 10.0, {"initial": {"pose": HALF_TURN, "velocity": MOVING}}),
        (10.0, {"initial": {"pose": HALF_TURN | {"angle": 0}, "velocity": AT_REST}}),
        in_ci("a push", 10.0, {"plant": {"forces": [{"kind": "constant", "force": [0.1, 0, 0]}]}}),
        in_ci("a spin", 20.0, {"reference": SPIN | {"velocity": [0, 0, 3]}}),
    ],
    ids=["moves through it", "at the reference", "is pushed", "greatest axis"],
)
def test_other_starts_are_not(tmp_path: Path, duration: float, changes: dict[str, Any]) -> None:
    initial = {"initial": {"pose": HALF_TURN, "velocity": AT_REST}} | changes
    assert statuses(tmp_path, duration, **initial) == {Status.OK}


def test_nothing_is_written_as_0() -> None:
    assert [significant(x) for x in (1e-100, -1e-100, 0.0, 1e-20)] == ["0", "0", "0", "1.000e-20"]
    assert in_one_form(math.nan, 1e-100, 0.0) == ["0.000", "0.000"]
    assert [fixed(x, 1, signed=True) for x in (-0.01, 0.01, 0.06)] == ["0.0", "0.0", "+0.1"]
    assert [percent(x, signed=True) for x in (-1e-12, 0.0, -1e-7)] == [
        "0.0 %",
        "0.0 %",
        "-0.00001 %",
    ]
    assert [brief(x) for x in (-0.0, 1e-100, -1e-5)] == ["0", "0", "-1e-05"]
    assert json_text([-0.0, {"mean": -0.0}]) == '[0.0, {"mean": 0.0}]'


def test_rounding_is_no_jump() -> None:
    """Of a reference at rest, 1e-15 would be more than any share of its largest velocity."""
    shown = SimpleNamespace(
        pose=np.eye(3)[None], velocity=np.zeros((1, 3)), torque=np.zeros((1, 3))
    )

    def side(by: float) -> Any:
        ends = {"Vd": np.full((1, 3), by), "tau_d": np.zeros((1, 3)), "P": np.zeros((1, 3))}
        return SimpleNamespace(Qd=np.eye(3)[None], **ends)

    def found(by: float) -> list[Any]:
        units = ("rad/s", "N m")
        return list(_jumps(shown, np.array([1.0]), units, side(0.0), side(by)))  # type: ignore[arg-type]

    assert found(1e-15) == []
    assert found(1e-6) == [(1.0, "V_d", "1.73e-06 rad/s")]
