"""`eqt time`: the CPU time of a call, at the inputs of a result."""

from pathlib import Path

import pytest

import eqt_cli
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.results.timing import late_lines

SPINNING = """
typedef double real;
typedef struct {{ real unused; }} {name}_numbers;
typedef struct {{ real unused; }} {name}_memory;
typedef struct {{
    real t, pose[9], velocity[3], desired_pose[9], desired_velocity[3], desired_acceleration[3];
}} {name}_input;
void {name}_torque(const {name}_numbers *n, {name}_memory *m, const {name}_input *in, real *torque)
{{
    int k;
    real x = 2 + in->velocity[0] * in->velocity[0];
    (void)n, (void)m;
    for (k = 0; k < {divisions}; k++) x = 3 / x;
    for (k = 0; k < 3; k++) torque[k] = -in->velocity[k] + 0 * x;
}}
"""
BURNING = """
import time

class Burning:
    def __init__(self):
        self.z = 0.0

    def compute(self, velocity):
        self.z += 1.0
        ends = time.thread_time() + 0.003
        while time.thread_time() < ends:
            pass
        return -velocity
"""


@pytest.fixture
def flown(config):
    """A result of two laws in C of 1,000 and 10,000 divisions, one in Python, and EqT."""
    for name, divisions in (("short", 1000), ("long", 10000)):
        Path(f"{name}.c").write_text(SPINNING.format(name=name, divisions=divisions))
    Path("burning.py").write_text(BURNING)
    laws = [{"kind": "code", "file": f"{name}.c", "label": name} for name in ("short", "long")]
    slow = {"file": "burning.py", "function": "Burning().compute", "memory": ["z"]}
    data = config("eqt", *laws, **slow, **{"as": None, "numbers": None})
    few = {"ensemble": {"runs": 1}, "time": {"duration": 0.12, "samples": 4}}
    solver = {"engine": "native", "cross_check": 0, "error_estimate": False}
    eqt_cli.run(data | few | {"solver": solver}, "flown")
    return Path("flown")


@pytest.mark.ci("what they cost besides is fast")
def test_times_are_those_of_the_calls(flown, invoke):
    """Ten times as many divisions take ten times as long, less what both have besides."""
    with pytest.warns(EqtWarning, match="store a sample per control.period"):
        times = eqt_cli.call_times(flown, trust_plugins=True)
    laws = times["laws"]
    assert 9.0 < laws["long"]["median"] / laws["short"]["median"] < 10.5
    assert 5e-7 < laws["short"]["median"] < 2e-5  # 0.5 to 20 ns for a division
    assert 1e-9 < laws["eqt"]["median"] < laws["short"]["median"]
    assert 0.003 <= laws["ours"]["median"] < 0.006
    hows = {label: row["how"] for label, row in laws.items()}
    in_c = dict.fromkeys(("eqt", "short", "long"), "C, in loops")
    assert hows == in_c | {"ours": "Python, one by one"}
    # At all samples, of one run.
    assert {label: row["calls"] for label, row in laws.items()} == dict.fromkeys(laws, 4)
    assert times["late"] == [
        "ours flew as if it took none; `control: {delay: 1}` gives it a period"
    ]
    said = invoke("time", flown, "--trust-plugins", "--controller", "eqt").stdout.splitlines()
    assert said[0].split("  ")[0] == "law"
    assert said[2].startswith("EqT ")
    assert said[2].endswith("C, in loops")


@pytest.mark.ci("two runs with a compiler")
def test_a_file_that_has_changed_is_told(flown):
    Path("short.c").write_text("int x;")
    with pytest.warns(EqtWarning, match=r"^short\.c has changed since the run, whose law is timed"):
        eqt_cli.call_times(flown, "short", trust_plugins=True)


@pytest.mark.ci("what they are compared with is fast")
def test_gains_that_change_are_those_of_their_time(config):
    """LQR along a path has a gain for each piece, and the times of a law by NumPy are longer."""
    path = {"kind": "path", "factors": [{"axis": "wz", "by": "0.8*sin(t)"}]}
    lqr = {"kind": "lqr", "weights": {"pose": 2.0, "velocity": 0.5, "torque": 0.02}}
    data = config() | {"controllers": [lqr], "reference": path}
    eqt_cli.run(data, "r")
    assert eqt_cli.call_times("r")["laws"]["lqr"]["calls"] == 10


def test_results_without_inputs_are_told(config):
    eqt_cli.run(config() | {"controllers": ["eqt"], "store": {"trajectories": 0}}, "none")
    with pytest.raises(
        EqtError, match=r"needs the trajectories of 'pose'.* set store.trajectories"
    ):
        eqt_cli.call_times("none")


def test_a_law_that_did_not_fly_is_told(paper_result):
    with pytest.raises(EqtError, match=r"holds no controller 'lqr'; there are: eqt, gt"):
        eqt_cli.call_times(paper_result, "lqr")


class _Flown:
    title_of = {"mpc": "MPC"}  # noqa: RUF012

    def __init__(self, **control):
        self.config = {"control": control or None}


@pytest.mark.parametrize(
    ("slow", "control", "said"),
    [
        (0.3, {"period": 0.1}, ["MPC cannot keep its period of 0.1 s"]),
        (0.3, {"period": 0.1, "delay": 1}, ["MPC cannot keep its period of 0.1 s"]),
        (0.05, {"period": 0.1, "delay": 1}, []),
        (0.05, {"period": 0.1, "delay": "60 ms"}, []),
        (0.009, {"period": 0.1}, []),
        (0.3, {}, []),
        *(
            (
                0.05,
                {"period": 0.1, **delay},
                [f"MPC flew as if it took {took}; `control: {{delay: 1}}` gives it a period"],
            )
            for delay, took in (({}, "none"), ({"delay": "20 ms"}, "only 0.02 s"))
        ),
    ],
)
def test_late_answers_are_told(slow, control, said):
    rows = {"mpc": {"median": 0.0, "99 %": slow, "largest": 1.0}}
    assert [*late_lines(_Flown(**control), rows)] == said
