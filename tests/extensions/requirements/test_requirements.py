"""Requirements from a file to their answer, against plain NumPy on the stored samples."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import eqt_cli
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.requirements import answers
from eqt_cli.extensions.requirements.keys import Requirement
from eqt_cli.results.conclusion import words_of
from eqt_cli.results.result import open_result

BASE = {
    "group": "SO3",
    "inertia": [0.8, 1.1, 1.7],
    "gains": {"kp": 1.0, "kd": 1.0},
    "reference": {"torque": ["cos(t)", "sin(t)", 0], "pose": "identity"},
    "controllers": ["eqt", "gt"],
    "initial": {"pose": {"kind": "exp_normal", "std": 0.6}, "velocity": "normal"},
    "ensemble": {"runs": 40, "seed": 3},
    "time": {"duration": 10, "samples": 201},
    "windows": {"slew": {"stop": "4 s"}, "pointing": {"start": "6 s"}},
    "solver": {"engine": "solve_ivp", "cross_check": 0, "error_estimate": False, "rtol": 1e-6},
}
REQUIRE = [
    {"metric": "peak_attitude_error", "max": "8 deg", "share": 0.5, "window": "pointing"},
    {"metric": "attitude_angle", "max": "5 deg", "share": 0.5, "of": "mixed", "window": "pointing"},
    {"metric": "attitude_angle", "max": "5 deg", "share": 0.9, "of": "temporal", "of_runs": 0.5},
    {"metric": "settled", "min": 1, "share": 0.01},
    {
        "metric": "attitude_angle",
        "max": "3 deg",
        "share": 0.5,
        "relative": "1 s",
        "window": {"start": 5, "stop": 9},
    },
]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("required")
    path = folder / "c.yaml"
    path.write_text(yaml.safe_dump(BASE | {"require": REQUIRE}))
    eqt_cli.run(eqt_cli.load_experiment(path), folder / "r")
    return folder / "r"


def test_counts_are_those_of_the_samples(flown, invoke):
    records = json.loads(invoke("show", flown, "--json").stdout)["requirements"]
    assert len(records) == len(REQUIRE) * 2
    with open_result(flown) as result:
        t = result.times
        for law, label in enumerate(result.labels):
            seen = [record["seen"] for record in records if record["controller"] == label]
            angle = result.read("attitude_angle", controller=law)
            late = angle[:, t >= 6]
            assert seen[0] == f"{np.sum(late.max(axis=1) <= 8)}/40 runs"
            lines = np.stack([np.interp(np.linspace(6, 10, 80001), t, x) for x in angle])
            assert float(seen[1].split()[0]) == pytest.approx(100 * np.mean(lines <= 5), abs=0.3)
            lines = np.stack([np.interp(np.linspace(0, 10, 80001), t, x) for x in angle])
            within = np.mean(lines <= 5, axis=1)
            assert abs(int(seen[2].split("/")[0]) - np.sum(within >= 0.9)) <= 1
            assert seen[3] == f"{int(result.metric('settled')[law].sum())}/40 runs"


def test_an_exposure_is_about_its_mean(flown):
    from eqt_cli.extensions.requirements.errors import largest_changes, samples_of

    with open_result(flown) as result:
        R = result.read("desired_pose").swapaxes(-1, -2) @ result.read("pose", controller=0)[7]
        found = largest_changes(result, 0, samples_of(1.0, result.times))[7]
    angle = np.arccos(np.clip((np.trace(R, axis1=-2, axis2=-1) - 1) / 2, -1, 1))
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    e = np.degrees(angle / 2 / np.sin(angle))[:, None] * axis
    part = e[100:121]  # the second that ends at 6 s
    largest = np.linalg.norm(part - part.mean(0), axis=1).max()
    assert found[120] == pytest.approx(largest, rel=1e-7)  # poses leave the group by 1e-8
    assert (found[:20] == found[20]).all()  # no time before the first exposure counts as kept
    assert samples_of(1.02, np.arange(0, 10, 0.05)) == 21


def test_exposures_of_failed_runs():
    from types import SimpleNamespace

    from eqt_cli.extensions.requirements.errors import largest_changes

    poses = np.tile(np.eye(3), (2, 5, 1, 1))
    poses[1, 3:] = np.nan
    held = SimpleNamespace(read=lambda name, **_: poses if name == "pose" else poses[0])
    changes = largest_changes(held, 0, 2)
    assert (changes[0] == 0).all()
    assert np.isnan(changes[1, 3:]).all()


@pytest.mark.parametrize(
    ("sure", "possible", "words"), [(30, 40, "samples"), (28, 30, "% is shown")]
)
def test_samples_are_named_only_where_more_could_decide(sure, possible, words, flown, monkeypatch):
    from eqt_cli.extensions.requirements import answers
    from eqt_cli.extensions.requirements.keys import Requirement

    kept = [np.arange(40) < number for number in (sure, possible)]
    monkeypatch.setattr(
        answers, "_bounds_kept", lambda *_: ("deg", 5.0, *(x * 1.0 for x in kept), 1.0)
    )
    asked = Requirement(metric="attitude_angle", max="5 deg", share=0.8)
    with open_result(flown) as result:
        assert words in next(answers.findings(result, [asked], {})).why


def test_exposures_lie_within_the_window(flown):
    from eqt_cli.extensions.requirements.answers import findings
    from eqt_cli.extensions.requirements.errors import largest_changes, samples_of
    from eqt_cli.extensions.requirements.keys import NamedWindow, Requirement

    window = NamedWindow(start=4, stop=6)
    asked = Requirement(
        metric="attitude_angle", max="20 deg", share=0.5, relative=1.5, window=window
    )
    with open_result(flown) as result:
        finding = next(findings(result, [asked], {}))
        ends = result.times >= 5.5 - 1e-9
        changes = largest_changes(result, 0, samples_of(1.5, result.times))
    ends &= np.arange(201) <= 120
    kept = int(np.sum(changes[:, ends].max(axis=1) <= 20))
    assert abs(int(finding.seen.split("/")[0]) - kept) <= 1
    assert kept != np.sum(changes[:, 80:121].max(axis=1) <= 20)  # these begin before it


def test_a_peak_between_samples_is_not_shown():
    from eqt_cli.extensions.requirements.errors import between_samples, share_within

    coarse = np.cos(np.linspace(-2.5, 2.5, 6))[None]  # samples at ±0.5, the peak of 1 between
    assert coarse.max() < 0.88
    bound = (np.maximum(coarse[:, 1:], coarse[:, :-1]) + between_samples(coarse)).max()
    assert 1.0 < bound < 1.02
    line = np.array([[0.0, 1.0, 0.0]])
    assert share_within(line, 0.25, np.zeros((1, 2)), upper=True) == pytest.approx(0.25)
    assert share_within(line, 0.25, np.zeros((1, 2)), upper=False) == pytest.approx(0.75)


def test_words_are_those_of_the_file_now_and_looks_are_counted(tmp_path, invoke):
    wheel = {
        "group": "SO2", "inertia": 0.4, "gains": {"kp": 1.0, "kd": 0.8}, "controllers": ["eqt"],
        "reference": {"kind": "constant"}, "initial": {"velocity": "normal"},
        "ensemble": {"runs": 20}, "time": {"duration": 10, "samples": 51},
        "solver": {"engine": "solve_ivp", "cross_check": 0, "error_estimate": False},
        "require": [{"metric": "settled", "min": 1, "share": 0.9}],
    }  # fmt: skip
    path, out = tmp_path / "c.yaml", tmp_path / "r"

    def answer(**change):
        path.write_text(yaml.safe_dump(wheel | change))
        invoke("run", path, "--out", out, "--grow", "-q")
        [record] = json.loads(invoke("show", out, "--json").stdout)["requirements"]
        return record["share"], record["verdict"], record["needed"]

    assert answer() == (0.9, "not shown", 29)  # 0.9^29 < 0.05
    lower = [{"metric": "settled", "min": 1, "share": 0.8}]
    assert answer(require=lower) == (0.8, "meets", 0)
    assert answer(ensemble={"runs": 29}) == (0.9, "meets", 0)
    with open_result(out / "results.h5") as result:
        assert result.provenance["grown_from"] == [20]
    margin = [{"metric": "delay_margin", "min": "0.3 s"}]  # of this loop: 0.3043 s (eqt margins)
    path.write_text(yaml.safe_dump(wheel | {"require": margin}))
    invoke("run", path, "--out", tmp_path / "m", "-q")
    invoke("compare", tmp_path / "m", "--fail-on", "requirements")


@pytest.mark.parametrize(
    ("margins", "said"),
    [
        ({"delay_margin": None, "stable": None, "indicative": False}, "not shown"),
        ({"delay_margin": None, "stable": False, "indicative": False}, "fails"),
        ({"delay_margin": 0.5, "stable": True, "indicative": True}, "not shown"),
        ({"delay_margin": float("inf"), "stable": True, "indicative": False}, "meets"),
    ],
)
def test_a_loop_that_is_not_shown_to_be_stable_meets_no_margin(margins, said):
    result = SimpleNamespace(attributes={"margins": json.dumps({"gt": margins})}, out_of=0)
    requirement = Requirement(metric="delay_margin", min="0.3 s")
    assert answers._of_margin(result, requirement, "gt").statement.word == said


def test_a_link_beside_a_result_is_not_followed(flown, tmp_path):
    (tmp_path / "other.yaml").write_text("name: x\nrequire: []\n")
    (tmp_path / "results.h5").write_bytes((flown / "results.h5").read_bytes())
    (tmp_path / "config.yaml").symlink_to(tmp_path / "other.yaml")
    with open_result(tmp_path / "results.h5") as result:
        assert len(words_of(result)["require"]) == len(REQUIRE)


def test_a_gate_ends_with_4(flown, invoke):
    refused = invoke("compare", flown, "--fail-on", "requirements", code=4).stdout
    assert refused.startswith("FAILS")
    invoke("compare", flown, "--fail-on", "effort worse by 5 %", code=2)


def test_a_window_by_its_name(flown, invoke):
    by_name = invoke("compare", flown, "--window", "pointing", "--json").stdout
    assert (
        json.loads(by_name)["pairs"]
        == json.loads(invoke("compare", flown, "--window", "6:", "--json").stdout)["pairs"]
    )


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        ({"share": 1.0}, "require[0].share", "less than 1"),
        ({"share": 0.0}, "require[0].share", "greater than 0"),
        ({"share": None}, "require[0]", "share"),
        ({"max": "8 m"}, "require[0]", "rad"),
        ({"max": 8}, "require[0]", "'8 deg'"),
        ({"min": "1 deg"}, "require[0]", "one of max and min"),
        ({"max": None, "min": "1 deg"}, "require[0]", "`max`"),
        ({"metric": "peak_atitude_error"}, "require[0]", "peak_attitude_error"),
        ({"metric": "peak_position_error"}, "require[0]", "no 'peak_position_error'"),
        ({"window": "pointng"}, "require[0]", "pointing"),
        ({"window": {"start": 9.99}}, "require[0].window", "fewer than two samples"),
        ({"window": {"start": 20}}, "require[0].window", "expected 0 <= start < stop"),
        ({"of": "temporal"}, "require[0]", "of_runs"),
        ({"metric": "effort", "max": 5, "of": "mixed"}, "require[0]", "attitude_angle"),
        ({"metric": "delay_margin", "max": None, "min": "1 ms"}, "require[0]", "remove share"),
        ({"relative": "1 s"}, "require[0]", "attitude_angle"),
        ({"metric": "attitude_angle", "relative": "60 ms"}, "require[0]", "three samples"),
        ({"metric": "attitude_angle", "relative": "5 s"}, "require[0]", "no exposure of 5 s"),
        ({"metric": "settling_time", "max": "9 s"}, "require[0]", "a number of whole runs"),
        ({"metric": "saturated_share", "max": 1}, "require[0]", "no 'saturated_share'"),
        ({"of_runs": 0.5}, "require[0]", "of: temporal"),
        ({"looks": 0}, "require[0].looks", "at least 1, got 0"),
        ({"metrik": "x"}, "require[0]", "metric"),
    ],
)
def test_slips_are_told_before_a_run(change, place, words, tmp_path):
    entry = {key: x for key, x in (REQUIRE[0] | change).items() if x is not None}
    with pytest.raises(EqtError) as told:
        eqt_cli.load_experiment(BASE | {"require": [entry]})
    assert words in str(told.value)
    assert place in str(told.value)


def test_one_requirement_twice_and_no_samples():
    with pytest.raises(EqtError, match="is entry 0 again"):
        eqt_cli.load_experiment(BASE | {"require": [REQUIRE[0], REQUIRE[0]]})
    with pytest.raises(EqtError, match="set store\\.trajectories"):
        eqt_cli.load_experiment(BASE | {"require": REQUIRE[:1], "store": {"trajectories": "none"}})
