"""What the boxes of a diagram say of a configuration, and what stands on its arrows."""

import re

import pytest
from small_experiment import mapping

import eqt_cli
from eqt_cli.extend import EqtError
from eqt_cli.extensions.diagram import api

pytestmark = pytest.mark.needs("diagram")

SAMPLED = {"control": {"period": 0.1}}


def text(**sections):
    whole = mapping(**sections)
    return eqt_cli.diagram({key: x for key, x in whole.items() if x is not None}).text()


def test_the_options_of_a_part_that_are_not_the_default_are_shown_with_units():
    said = text(
        actuators=[{"kind": "lag", "time_constant": 0.072}, {"kind": "limit", "limit": [1, 2, 3]}]
    )
    assert "time constant 72 ms" in said
    assert "limit 1, 2, 3 N m" in said
    drag = {"kind": "drag", "linear": 0.1, "quadratic": 0.2}
    said = text(plant={"forces": [drag]})
    assert "linear 0.1 N m s" in said and "quadratic 0.2 N m s²/rad²" in said


def test_a_number_that_runs_draw_is_a_mean_and_a_deviation_or_two_ends():
    said = text(
        actuators=[{"kind": "lag", "time_constant": {"normal": [0.2, 0.01]}}],
        plant={"inertia": {"relative": {"uniform": [-0.1, 0.1]}}},
    )
    assert "time constant 0.2 ± 0.01 s" in said
    assert "relative −0.1 … 0.1" in said
    assert "normal with mean m and deviation s" in said
    assert "uniform between a and b" in said
    assert "drawn for each run" not in text()


def test_a_torque_has_its_unit_on_the_arrow_and_ideal_actuators_pass_it():
    drawn = r"─ law: one of 2 laws .*▼ τ, N m\n.*╌ actuators: ideal .*▼ τ, N m\n.*─ plant"
    assert re.search(drawn, text(), re.S)


def test_a_law_of_dipoles_commands_a_m2():
    said = eqt_cli.diagram("examples/effects/detumble.yaml").text()
    assert re.search(r"─ law: .*▼ m, A m²\n.*─ actuators.*▼ τ, N m\n.*─ plant", said, re.S)


def test_the_task_and_the_target_as_it_is_written():
    target = {"pose": {"rotvec": ["30 deg", 0, 0]}}
    said = text(task="stabilise", reference=None, controllers=["stabilising"], target=target)
    assert "task: stabilise" in said
    assert "30 deg" in said
    assert "task:" not in text()


def test_laws_that_differ_in_an_inner_law_alone_are_told_apart_there():
    position = {"kx": 4, "kv": 3, "limit": 6, "period": "10 ms"}
    cascade = {"kind": "cascade", "position": position, "gains": {"kp": 1e-3, "kd": 1e-3}}
    laws = [
        {**cascade, "attitude": "lee2010", "label": "A"},
        {**cascade, "attitude": "lee2012", "label": "B"},
    ]
    said = eqt_cli.diagram("crazyflie", {"controllers": laws}).text()
    outer, inner = re.search(r"─ law: (.*?)▼ Rc, Ωc(.*?)▼ τ", said, re.S).groups()
    assert "▸" not in outer
    assert "▸ A: Lee 2010" in inner and "▸ B: Lee 2012" in inner


def test_a_sampled_loop_says_its_periods_delays_and_losses():
    said = text(
        control={"period": 0.02, "delay": 2},
        sensors={"velocity": [{"kind": "noise", "std": 0.1, "period": 0.04, "dropout": 0.25}]},
    )
    assert "every 20 ms (50 Hz)" in said
    assert "arrives 40 ms later" in said
    assert re.search(r"─ .*velocity .*every 40 ms, 25 % lost.*noise: std 0.1 rad/s", said, re.S)
    assert "exact: pose" in said


def test_a_plugin_in_a_result_is_executed_on_request_alone(monkeypatch):
    trusted, read = [], api.document_from

    def document_from(config, settings, *, trust_plugins):
        trusted.append(trust_plugins)
        return read(config, settings, trust_plugins=trust_plugins)

    monkeypatch.setattr(api, "document_from", document_from)
    eqt_cli.diagram(mapping())
    eqt_cli.diagram(mapping(), trust_plugins=True)
    assert trusted == [False, True]


def test_the_swept_keys_stand_below_the_first_point_but_not_below_another():
    swept = mapping(
        actuators=[{"kind": "lag", "time_constant": 0.1}],
        sweep=[{"grid": {"actuators[0].time_constant": [0.1, 0.3]}}],
    )
    first, second = eqt_cli.diagram(swept).text(), eqt_cli.diagram(swept, point=1).text()
    assert "time constant 0.1 s" in first and "Swept: actuators[0].time_constant." in first
    assert "time constant 0.3 s" in second and "Swept" not in second


def test_a_file_has_the_ending_of_a_picture(tmp_path):
    loop = eqt_cli.diagram(mapping())
    assert loop.save(tmp_path / "loop.svg").read_text("utf-8") == loop.svg()
    page = loop.save(tmp_path / "loop.html").read_text("utf-8")
    assert page.count("<svg") == 2  # a narrow one for phones, too
    with pytest.raises(EqtError, match=r"\.svg or \.html"):
        loop.save(tmp_path / "loop.png")


def test_a_sensor_of_a_part_of_the_pose_names_the_part():
    sensors = {
        "pose": [{"kind": "noise", "of": "rotation", "std": 0.01}],
        "velocity": [{"kind": "noise", "std": 0.1}],
    }
    said = text(
        group="SE3",
        inertia=[1, 1, 1, 2, 2, 2],
        reference={"kind": "constant"},
        control={"period": 0.1},
        sensors=sensors,
    )
    assert "─ sensors: pose: rotation ─" in said
    assert "─ velocity ─" in said
    assert "exact: pose (translation)" in said


def test_a_law_with_gains_of_its_own_has_them_behind_its_name():
    said = text(controllers=["gt", {"kind": "eqt", "gains": {"kp": 2.0}}])
    assert "▸ GT: kp 1 N m" in said
    assert "▸ EqT: kp 2 N m" in said
    assert said.count("kd 0.5 N m s") == 1


def test_a_number_of_the_reference_keeps_the_unit_in_which_it_is_written():
    slew = {"kind": "slew", "to": {"rotvec": [0, 0.5, 0]}, "duration": "0.01 min"}
    assert "duration 0.01 min" in text(reference=slew)
