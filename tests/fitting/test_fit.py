"""Numbers of a plant that are fitted to recordings of which the truth is known."""

import json
import re

import numpy as np
import pytest

import eqt_cli
from eqt_cli.core.errors import EqtError
from tests.fitting.conftest import DRAG, NOISE, RELATIVE, model, true_plant

INERTIA, ABOUT, ALONG = (
    "plant.inertia.relative",
    "plant.forces[0].linear[0:3]",
    "plant.forces[0].linear[3:6]",
)
TRUE = {INERTIA: RELATIVE, ABOUT: DRAG["SE3"][0], ALONG: DRAG["SE3"][3]}


def test_the_true_numbers_are_found(recorded):
    """Without noise, as exactly as derivatives by differences allow."""
    recorded(noise=0.0)
    found = eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA, ABOUT], horizon=0.6)
    assert [n.value for n in found.numbers] == pytest.approx([RELATIVE, 0.05], rel=1e-5)
    assert found.config.as_posix() == "results/model-fitted/fitted.yaml"
    written = eqt_cli.load_experiment(found.config).base.resolved
    assert written["plant"]["inertia"]["relative"] == found.numbers[0].value
    assert written["plant"]["forces"][0]["linear"] == [found.numbers[1].value] * 3


def test_noise_is_all_that_is_left(recorded):
    found = eqt_cli.fit(model("SO3"), recorded(), [INERTIA, ABOUT], horizon=0.6)
    assert all(n.low < TRUE[n.key] < n.high for n in found.numbers)
    rotation, rate = found.residuals
    for one, size in ((rotation, NOISE["rotation"]), (rate, NOISE["rate"])):
        # The deviation of 3·101 numbers is right to 1/√(2·3·101) = 4 %.
        assert [one.after, one.noise] == pytest.approx([size, size], rel=0.15)
    assert rate.before > 2 * rate.after


@pytest.mark.slow("fits ten recordings")
def test_intervals_hold_the_truth(recorded):
    """95 % intervals of ten recordings: fewer than 7 of them hold a number once in 970 times."""
    keys = [INERTIA, ABOUT, ALONG]
    held, values, widths = np.zeros(len(keys)), [], []
    for seed in range(10):
        recorded("SE3", duration=8.0, period=0.04, seed=seed)
        # The velocity of a run is that of the body.
        found = eqt_cli.fit(model("SE3"), "flight.csv", keys, {"velocity": "body"}, horizon=0.4)
        held += [n.low <= TRUE[n.key] <= n.high for n in found.numbers]
        values.append([n.value for n in found.numbers])
        widths.append([n.high - n.low for n in found.numbers])
    assert (held >= 7).all()
    # No bias beyond four standard errors, and intervals as wide as the spread asks for.
    spread = np.std(values, axis=0, ddof=1)
    truth = np.array([TRUE[key] for key in keys])
    assert (abs(np.mean(values, axis=0) - truth) < 4 * spread / np.sqrt(10)).all()
    np.testing.assert_allclose(np.mean(widths, axis=0) / (2 * 1.96), spread, rtol=0.5)


def test_first_velocities_that_were_not_recorded_are_found(recorded):
    recorded(columns="t qx qy qz qw tx ty tz", noise=0.1)
    found = eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA], horizon=0.6, out="found")
    (inertia,) = found.numbers
    assert inertia.low < RELATIVE < inertia.high
    assert [each.part for each in found.residuals] == ["rotation"]


MISTAKES = {
    "gains.kp: expected a number of the plant, such as plant.inertia.relative or "
    "plant.forces[0].linear, or delay": ["gains.kp"],
    "plant.mass: is not in the configuration; add it with a value to start at": ["plant.mass"],
    "plant.forces[0].linear: expected a key that holds a number, got [0.0, 0.0, 0.0]; give an "
    "entry, such as plant.forces[0].linear[0]": ["plant.forces[0].linear"],
    "plant.forces[0].kind: expected a key that holds a number, got 'drag'": [
        "plant.forces[0].kind"
    ],
    "expected different keys, got none": [],
    f"expected different keys, got {INERTIA}, {INERTIA}": [INERTIA, INERTIA],
    "inertia[0]: has no influence on the prediction of flight.csv; leave it out, give a "
    "recording in which it acts, or start at a value of its magnitude": [ABOUT, "inertia[0]"],
}


@pytest.mark.parametrize("message", MISTAKES)
def test_keys_that_cannot_be_fitted(recorded, message):
    recorded()
    config = model("SO3")
    if "inertia[0]" in MISTAKES[message]:
        config["plant"]["inertia"] = 0.3  # in the place of the one that a law believes in
    with pytest.raises(EqtError) as caught:
        eqt_cli.fit(config, "flight.csv", MISTAKES[message], horizon=0.6)
    assert str(caught.value) == message


def test_numbers_that_act_alike_are_named(recorded):
    recorded()
    drag = {"kind": "drag", "linear": 0.0}
    config = model("SO3", plant={"forces": [drag, drag]})
    keys = ["plant.forces[0].linear", "plant.forces[1].linear"]
    with pytest.raises(EqtError) as caught:
        eqt_cli.fit(config, "flight.csv", keys, horizon=0.6)
    assert str(caught.value).startswith(
        "plant.forces[0].linear and plant.forces[1].linear: flight.csv cannot distinguish them, "
        "because a change of one acts like a change of the others (smallest singular value "
    )
    assert str(caught.value).endswith("); leave one out")


def test_few_windows_give_no_interval(recorded):
    recorded()
    with pytest.raises(EqtError) as caught:
        eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA], horizon=1.0)
    assert str(caught.value) == (
        "flight.csv: has 3 windows of 1 s that share no row; intervals need at least 5, so give a "
        "shorter horizon"
    )


@pytest.mark.parametrize(
    ("is_link", "said"),
    [
        (False, "exists, and is no file that eqt wrote; choose another place with out=…"),
        (
            True,
            "is a symbolic link; expected a file that eqt wrote, or no such entry; rename or "
            "remove it",
        ),
    ],
)
def test_a_file_of_another_is_not_replaced(recorded, tmp_path, is_link, said):
    recorded()
    (tmp_path / "mine").mkdir()
    theirs = tmp_path / "theirs.yaml" if is_link else tmp_path / "mine" / "fitted.yaml"
    theirs.write_text("mine\n")
    if is_link:
        (tmp_path / "mine" / "fitted.yaml").symlink_to(theirs)
    with pytest.raises(EqtError) as caught:
        eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA], horizon=0.6, out="mine")
    assert str(caught.value) == f"mine/fitted.yaml: {said}"
    assert theirs.read_text() == "mine\n"


@pytest.mark.slow("fits a plant again")
def test_the_command_prints_what_the_function_finds(recorded, invoke, tmp_path):
    recorded()
    (tmp_path / "model.yaml").write_text(json.dumps(model("SO3")))
    words = f"fit model.yaml --measured flight.csv --over {INERTIA},{ABOUT} --horizon 0.6"
    printed, found = (
        invoke(*words.split(), "--json"),
        eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA, ABOUT], horizon=0.6),
    )
    document = json.loads(printed.stdout)
    assert document["numbers"] == [vars(each) for each in found.numbers]
    assert document["singular_values"] == found.singular_values
    assert document["config"] == "results/model-fitted/fitted.yaml"


@pytest.mark.slow("compiles a plant and fits three numbers")
def test_the_delay_of_a_wrench_is_found(recorded):
    recorded(late=1, noise=0.0)
    found = eqt_cli.fit(model("SO3"), "flight.csv", ["delay", ABOUT, INERTIA], horizon=0.6)
    assert [n.key for n in found.numbers] == [ABOUT, INERTIA, "delay"]
    assert [n.value for n in found.numbers] == pytest.approx([0.05, RELATIVE, 0.04], rel=1e-5)


def is_said_late(note):
    number = r"0\.0[34]\d*"
    return re.fullmatch(
        rf"The errors are smaller with the wrench of {number} s later \(95 % interval \[{number}, "
        rf"{number}\]\): it was recorded with another delay than the motion, or acts with one\. "
        r"Fit it: --over …,delay\.",
        note,
    )


def test_a_wrench_that_was_recorded_a_row_late_is_told(recorded):
    recorded(late=1)
    perfect, words = model("SO3", plant=true_plant("SO3")), {"horizon": 0.5, "windows": 20}
    assert is_said_late(eqt_cli.replay(perfect, "flight.csv", **words).notes[-1])
    assert not eqt_cli.replay(perfect, "flight.csv", **words, delay=0.04).notes


@pytest.mark.slow("fits a longer recording")
def test_a_delay_that_is_not_fitted_is_told_apart_from_drag(recorded):
    recorded(duration=8.0, late=1, noise=0.5)
    found = eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA, ABOUT])
    assert found.numbers[1].low > TRUE[ABOUT]
    assert is_said_late(found.notes[-1])


def test_slow_noise_is_told_from_white_noise(recorded):
    perfect = model("SO3", plant=true_plant("SO3"))
    recorded(slow=0.95)
    [said] = eqt_cli.replay(perfect, "flight.csv", horizon=0.5, windows=10).notes
    assert re.fullmatch(
        r"The errors are correlated from row to row: rotation \(0\.\d\d\), rotation rate "
        r"\(0\.\d\d\)\. Such errors come from the model, from slow errors of the sensors or from a "
        "wrench at another time; `noise` counts only what is independent from row to row.",
        said,
    )
    recorded()
    assert not eqt_cli.replay(perfect, "flight.csv", horizon=0.5, windows=10).notes


def test_what_takes_no_part_is_said(recorded):
    recorded()
    config = model("SO3", plant=true_plant("SO3"), control={"period": 0.01})
    found = eqt_cli.replay(config, "flight.csv", horizon=0.5, windows=1)
    assert found.notes == (
        "control of the configuration are left out: the recorded wrench acts when it was recorded.",
    )
