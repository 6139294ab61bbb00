"""The reference at later times, as code is given it: against closed forms, in C and in Python."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.extend import EqtError

STEPS, EVERY, PERIOD = 3, 0.1, 0.02
PATH = {"kind": "path", "factors": [{"axis": "wz", "by": "0.8*sin(0.8*t)"}]}
BY_TORQUE = {"kind": "torque", "torque": [0.1, 0.0, 0.0]}
PYTHON = """
import numpy as np

class Recorder:
    def __init__(self):
        self.given = np.zeros(45)

    def compute(self, velocity, later_pose, later_velocity, later_torque):
        self.given = np.concatenate([x.ravel() for x in (later_pose, later_velocity, later_torque)])
        return -velocity
"""
C = """
typedef double real;
typedef struct { real gain; } law_numbers;
typedef struct { real given[45]; } law_memory;
typedef struct {
    real t, pose[9], velocity[3], desired_pose[9], desired_velocity[3], desired_acceleration[3];
    real later_pose[3][9], later_velocity[3][3], later_torque[3][3];
} law_input;
void law_torque(const law_numbers *n, law_memory *m, const law_input *in, real *torque)
{
    int k;
    (void)n;
    for (k = 0; k < 27; k++) m->given[k] = in->later_pose[k / 9][k % 9];
    for (k = 0; k < 9; k++) m->given[27 + k] = in->later_velocity[k / 3][k % 3];
    for (k = 0; k < 9; k++) m->given[36 + k] = in->later_torque[k / 3][k % 3];
    for (k = 0; k < 3; k++) torque[k] = -in->velocity[k];
}
"""
SE3 = """
import numpy as np

class Recorder:
    def __init__(self):
        self.given = np.zeros(44)

    def compute(self, q, v, p):
        self.given = np.concatenate([x.ravel() for x in (q, v, p)])
        return np.zeros(6)
"""
MODEL = {"forces": [{"kind": "restoring", "weight": 2 * 9.81}]}
FLAT = {"kind": "flat", "position": ["t**2", 0, "t"], "along": [0, 0, 1]}


@pytest.fixture
def flown(config):
    def fly(text, file, engine, reference=PATH, **options):
        Path(file).write_text(text, encoding="utf-8")
        law = {"file": file, "as": None, "numbers": None, "memory": ["given"], **options}
        law |= {"preview": {"steps": STEPS, "every": "100 ms"}}
        over = {"reference": reference, "solver": {"engine": engine, "cross_check": 1}}
        over["store"] = {"memory": True}
        return eqt_cli.run(config(over=over, **law))

    return fly


def expected(t):
    """Q_d, V_d and 𝕀V̇_d of a turn about z, by SciPy and by derivatives taken by hand."""
    rows = []
    for s in t + EVERY * np.arange(1, STEPS + 1):
        angle, rate, change = (
            0.8 * np.sin(0.8 * s),
            0.64 * np.cos(0.8 * s),
            -0.512 * np.sin(0.8 * s),
        )
        R = Rotation.from_rotvec([0, 0, angle]).as_matrix()
        rows.append((R.ravel(), [0, 0, rate], [0, 0, 3.0 * change]))  # I_zz = 3 kg m²
    return np.concatenate([np.ravel(part) for part in zip(*rows, strict=True)])


COMPILES = pytest.mark.ci("another engine is fast")


@pytest.mark.parametrize("engine", ["solve_ivp", pytest.param("native", marks=COMPILES)])
@pytest.mark.parametrize("language", [pytest.param("Python", marks=COMPILES), "C"])
def test_the_reference_ahead_is_that_of_its_formula(language, engine, flown):
    """The law keeps what it was given; rounding only. No tick is at the end, t = 0.4 s."""
    how = {"Python": (PYTHON, "law.py"), "C": (C, "law.c")}[language]
    more = {"function": "Recorder().compute"} if language == "Python" else {}
    result = flown(*how, engine, **more)
    times = result["time"]
    given = result["law_output"][0, 0][:, :45]
    for k, t in enumerate([*times[:-1], times[-1] - PERIOD]):
        np.testing.assert_allclose(given[k], expected(t), rtol=0, atol=1e-12)
    assert result.attributes["cross_check_difference"] < result.attributes["cross_check_bound"]


def test_a_reference_that_is_integrated_has_no_later_values(flown):
    with pytest.raises(EqtError, match="preview: the reference is integrated, so its later val"):
        flown(PYTHON, "law.py", "native", BY_TORQUE, function="Recorder().compute")


@pytest.mark.ci("one group is fast")
def test_an_adapter_names_orders_and_turns_what_is_later(config):
    """On SE(3), with p_d and its derivatives; vectors of later frames turn by their own poses."""
    Path("law.py").write_text(SE3, encoding="utf-8")
    inputs = {
        "q": {"signal": "later_pose.rotation", "as": "quaternion wxyz"},
        "v": {"signal": "later_velocity.translation", "frame": "space"},
        "p": {"signal": "later_position", "unit": "mm"},
    }
    law = {"file": "law.py", "as": None, "numbers": None, "function": "Recorder().compute"}
    law |= {"adapter": {"inputs": inputs}, "memory": ["given"]}
    law |= {"preview": {"steps": 2, "every": EVERY}}
    over = {"group": "SE3", "inertia": [1.0, 2.0, 3.0, 2.0, 2.0, 2.0], "model": MODEL}
    over |= {"reference": FLAT, "store": {"memory": True}, "control": {"period": PERIOD}}
    result = eqt_cli.run(config(over=over, **law))
    t = result["time"][1] + EVERY * np.arange(1, 3)
    p, v = (np.stack(x, axis=-1) for x in ((t**2, 0 * t, t), (2 * t, 0 * t, 1 + 0 * t)))
    q, velocity, flat, _ = np.split(result["law_output"][0, 0, 1], [8, 14, 44])
    np.testing.assert_allclose(velocity.reshape(2, 3), v, atol=1e-12)
    np.testing.assert_allclose(flat.reshape(2, 5, 3)[:, :2], 1e3 * np.stack([p, v], 1), atol=1e-9)
    # The thrust m (p̈_d − g) is along the body's third axis, and heading 0 is in the plane y = 0.
    turn = np.arctan2(2.0, 9.81) / 2
    np.testing.assert_allclose(q.reshape(2, 4), [[np.cos(turn), 0, np.sin(turn), 0]] * 2, atol=1e-9)


@pytest.mark.ci("one without a preview is fast")
def test_it_is_judged_where_there_is_no_reference(config):
    """There it goes on at its velocity; what eqt keeps for failures is no memory of the law."""
    text = PYTHON.replace("return -velocity", "return later_torque[0] - velocity")
    Path("law.py").write_text(text, encoding="utf-8")
    law = {"file": "law.py", "as": None, "numbers": None, "function": "Recorder().compute"}
    law |= {"memory": ["given"], "preview": {"steps": STEPS, "every": EVERY}}
    over = {"reference": PATH, "store": {"memory": True}}
    rows = eqt_cli.verify(config(over=over, **law)).rows
    [words] = [row.remark for row in rows if row.kind == "code" and "nearest" in row.name]
    assert "damping" in words
    assert "last_command" not in words
    assert "failed_calls" not in words
