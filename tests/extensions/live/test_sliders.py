"""Keys that a reader moves, their values, and the numbers that follow them."""

import numpy as np
import pytest
from said import says
from small_experiment import configuration

from eqt_cli.api.loading import load_experiment
from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.config.document import read_config
from eqt_cli.extensions.live import sliders, wasm
from eqt_cli.extensions.live.section import check
from eqt_cli.extensions.live.sliders import Slider
from eqt_cli.extensions.live.units import unit_of


def test_values_are_round_and_have_the_ends_and_the_configured_one():
    slider = Slider.of("gains.kp", 0.824, "0.2:1.3:0.25")
    assert slider.values == [0.2, 0.45, 0.7, 0.824, 0.95, 1.2, 1.3]


def test_values_over_more_than_two_decades_have_equal_ratios():
    values = np.array(sliders.Slider.of("gains.kp", 20, "0.01:1000").values)
    assert values[0] == 0.01 and values[-1] == 1000 and 20.0 in values
    ratios = np.diff(np.log(values)) / (np.log(1e5) / 100)
    assert np.abs(ratios - 1).max() < 0.05  # three digits
    assert all(x.is_integer() for x in sliders.Slider.of("gains.kp", 20, "1:1000").values)


def test_values_are_the_doubles_that_a_configuration_would_have():
    values = Slider.of("gains.kp", 1.0, "0.1:10").values
    assert 0.7 in values and 0.30000000000000004 not in values
    assert 100 <= len(values) <= 250


def test_number_with_a_unit_moves_in_that_unit():
    slider = Slider.of("gains.kp", "2 mN m", "1:4:1")
    assert slider.values == [1.0, 2.0, 3.0, 4.0] and slider.setting(3.0) == "3.0 mN m"
    assert list(sliders.usual_keys({"gains": {"kp": "2 mN m", "kd": "pi"}})) == ["gains.kp"]


@pytest.mark.parametrize(
    ("base", "range_", "said"),
    [
        ("cos(t)", "0:1", "'cos(t)'"),
        (None, "0:1", "absent"),
        (True, "0:1", "True"),
        (1.0, "2:1", "'2:1'"),
        (1.0, "0:inf", "'0:inf'"),
        (1.0, "0:nan", "'0:nan'"),
        (1.0, "0:2:0", "'0:2:0'"),
        (1.0, "0:2:1:1", "'0:2:1:1'"),
        (1.0, "two", "'two'"),
        (3.0, "0:2", "outside"),
        (0.0, "", "--key"),
        (1.0, "0:2:1e-9", "steps"),
    ],
)
def test_wrong_range_is_refused_with_key_and_value(base, range_, said):
    with pytest.raises(EqtError) as caught:
        Slider.of("gains.kp", base, range_)
    assert str(caught.value).startswith("gains.kp: ") and said in str(caught.value)


@pytest.mark.parametrize(
    ("range_", "said"),
    [
        ("gains.kp: [2, 1]", "3:3: live.gains.kp: expected [LOW, HIGH]…, got [2, 1]"),
        ("gains.kp: 3", "3:3: live.gains.kp: expected…, got 3"),
        ("gains.kq: [0, 1]", "3:3: live.gains.kq: …absent…"),
        ("initial.std: [1 deg, 2 deg]", "3:3: live.initial.std: …in deg, got…"),
        ("time.duration: [1, 2]", "3:3: live.time.duration: no slider…shapes…"),
        ("ensemble.runs: [1, 2]", "3:3: live.ensemble.runs: no slider…gains.kp"),
        ("solver.rtol: [1e-9, 1e-6]", "3:3: live.solver.rtol: no slider…"),
        ("name: [1, 2]", "3:3: live.name: no slider…"),
        ("a.: [1, 2]", "3:3: live.a.: expected a key…"),
    ],
)
def test_wrong_section_is_refused_at_its_place(tmp_path, range_, said):
    text = (
        f"gains: {{kp: 1.5}}\nlive:\n  {range_}\ninitial: {{std: 1 deg}}\ntime: {{duration: 1}}\n"
    )
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        check(read_config(tmp_path / "c.yaml"))
    assert says(str(caught.value), f"{tmp_path / 'c.yaml'}:{said}")


@pytest.mark.ci("traces laws")
@pytest.mark.parametrize(
    ("live", "said"),
    [
        ("{gains.kp: [-1, 3], gains.kd: }", "live.gains.kp: at -1: must be positive…"),
        ("{control.delay: [0, 2, 1]}", "live.control.delay: …changes the program…"),
        ("{gains.kp: }\nfailed_when: {attitude: 1}", "live: failed_when: …"),
    ],
)
def test_check_tries_what_sliders_do(tmp_path, live, said):
    text = configuration(control="{period: 20 ms, delay: 1}", live=live)
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        check(read_config(tmp_path / "c.yaml"))
    assert says(str(caught.value), f"…:…: {said}")


UNITS = {
    "controllers[0].gains.kp": "N m",  # of a cascade: of its attitude alone
    "controllers[0].gains.kd[2]": "N m s",
    "controllers[0].position.kx": "1/s²",
    "inertia[1]": "kg m²",
    "inertia[3]": "kg",
    "plant.forces[1].linear[3]": "N s/m",
    "actuators[0].thrust_constant": "N s²/rad²",
    "sensors.pose[0].std": "rad",
    "sensors.pose[1].std": "m",
    "sensors.velocity[0].std": "rad/s",
    "sensors.velocity[1].value[0].normal[1]": "rad/s",
    "sensors.accelerometer[0].std": "m/s²",
    "initial.pose.std[5]": "m",
    "initial.pose.std": "",  # of angles and lengths
    "control.period": "s",
    "ensemble.seed": "",
}


def test_unit_of_a_bare_number_is_that_of_its_key():
    study = load_experiment("configs/quadrotor_gnss.yaml")
    assert {key: unit_of(study, key) for key in UNITS} == UNITS


def test_usual_keys_are_gains_moments_and_start():
    data = {
        "name": "x",
        "gains": {"kp": 1.0, "kd": [1, 0]},
        "inertia": [[1.0, 0.1], [0.1, 2.0]],
        "controllers": [{"kind": "pid", "ki": 0.1, "along": [0, 0, 1]}],
        "initial": {"velocity": {"kind": "normal", "std": 1.0}},
        "time": {"duration": 3},
    }
    expected = "gains.kp gains.kd[0] controllers[0].ki inertia[0][0] inertia[1][1]"
    assert list(sliders.usual_keys(data)) == [*expected.split(), "initial.velocity.std"]


def test_numbers_follow_a_key_by_a_factor_or_by_a_table():
    slider = Slider.of("k", 1.0, "0.5:1.5:0.25")

    def numbers(setting):
        k = setting["k"]
        return {"a": np.array([[7.0, 3.0 * k, k * k]])}

    factor, table = sliders.effects(slider, numbers, numbers({"k": 1.0}), [])
    assert (factor.at, factor.by) == ([1], [3.0])
    assert (table.at, table.table) == ([2], [[x * x] for x in slider.values])
    moved = sliders.applied(
        {"k": 1.25}, [(slider, [factor, table])], [], {"a": np.array([[7.0, 3.0, 1.0]])}
    )
    assert moved["a"].tolist() == [[7.0, 3.75, 1.5625]]


def test_keys_that_move_numbers_together_are_refused():
    of_keys, base = [], {"a": np.array([[1.0, 1.0]])}

    def numbers(setting):
        k, j = setting.get("k", 1.0), setting.get("j", 1.0)
        return {"a": np.array([[k, j if k == 1.0 else j + k]])}

    for key in ("k", "j"):
        slider = Slider.of(key, 1.0, "0.5:1.5")
        place = "kj".index(key)
        of_keys.append((slider, [sliders.Effect("a", [place], [1.0])]))
    with pytest.raises(EqtError, match="k, j"):
        sliders.checked(of_keys, [], numbers, base)


def test_without_a_compiler_a_page_says_what_to_install(monkeypatch):
    monkeypatch.setattr(wasm, "find_spec", lambda name: None)
    monkeypatch.setenv("CC", "/nowhere/clang")
    with pytest.raises(EqtError) as caught:
        wasm.command()
    assert ".[live]" in str(caught.value.remedies[0])
