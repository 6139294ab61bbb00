"""A law in C runs in the loop as a law of eqt does, and is kept with the result."""

import json
from pathlib import Path

import numpy as np
import pytest
from case_tables import in_ci, refusal
from said import says

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base import yaml_source
from eqt_cli.base.errors import ConfigError

# Two arrangements of one formula, over a run of twenty periods; measured 3e-16.
ROUNDING = 1e-13


def _pair(found, name="pose"):
    with open_at(found.path) as result:
        return result.read(name, controller=0), result.read(name, controller=1)


@pytest.mark.parametrize("engine", [in_ci("calls it at any time below", "solve_ivp"), "native"])
def test_every_engine_calls_it_at_instants(engine, written, config, tmp_path):
    written()
    over = {"solver": {"engine": engine, "cross_check": 0}}
    found = eqt_cli.run(config("lee2010", over=over), out=tmp_path / "r")
    for name in ("pose", "velocity", "torque", "command", "lyapunov"):
        np.testing.assert_allclose(*_pair(found, name), rtol=0, atol=ROUNDING)


def test_solve_ivp_calls_it_at_any_time(written, config, tmp_path):
    written()
    found = eqt_cli.run(config("lee2010", over={"control": None}), out=tmp_path / "r")
    np.testing.assert_allclose(*_pair(found), rtol=0, atol=ROUNDING)


def test_numbers_that_are_not_given_are_the_defaults_of_the_file(written, config):
    written(
        more="const lee_numbers lee_defaults = {3.0, 5.0, {0}};",
        body="torque[0] = n->kR * n->kW; torque[1] = torque[2] = 0;",
    )
    loop = eqt_cli.load_experiment(config(numbers={"kR": 7.0})).base.loops["ours"]
    assert _torque(loop)[0, 0] == 35.0


def test_without_defaults_they_are_0(written, config):
    written(body="torque[0] = n->kR + n->kW; torque[1] = torque[2] = 0;")
    loop = eqt_cli.load_experiment(config(numbers={"kR": 7.0})).base.loops["ours"]
    assert _torque(loop)[0, 0] == 7.0


def test_the_period_of_control_is_set(written, config):
    written(("J[3]", "J[3], period"), body="torque[0] = n->period; torque[1] = torque[2] = 0;")
    loop = eqt_cli.load_experiment(config()).base.loops["ours"]
    assert _torque(loop)[0, 0] == 0.02


def test_memory_starts_as_the_file_says_and_goes_on_by_itself(written, config):
    start = "void lee_start(const lee_numbers *n, lee_memory *m, const lee_input *in)"
    written(
        ("real unused;", "real count[3];"),
        more=f"{start}\n{{ m->count[1] = 5; }}",
        body="torque[0] = torque[2] = 0; torque[1] = m->count[1]; m->count[1] += 1;",
    )
    own = {"as": None, "memory": ["count"]}
    loop = eqt_cli.load_experiment(config(**own)).base.loops["ours"]
    state = _state(loop)
    assert loop.memory(state)["count"][0].tolist() == [0.0, 5.0, 0.0]
    for expected in (5.0, 6.0):
        told, memory = loop.law_input(0.0, state), loop.memory(state)
        torque, memory = loop.answer(told, memory, 0.02)
        assert torque[0, 1] == expected
        state = loop.after_answer(0.0, state, torque, memory)


def _state(loop):
    G = loop.group
    zero = np.zeros((1, G.dimension))
    return loop.initial_state(G.exp(zero), zero, G.exp(zero), zero)


def _torque(loop):
    state = _state(loop)
    assert loop.vehicle.control is not None
    period = loop.vehicle.control.period
    return loop.answer(loop.law_input(0.0, state), loop.memory(state), period)[0]


# Its source -------------------------------------------------------------------------------------


def test_a_result_holds_the_source_and_runs_it_only_on_request(
    written, config, forget_plugins, tmp_path
):
    written()
    found = eqt_cli.run(config(), out=tmp_path / "r")
    for name in ("lee.c", "lee.h"):
        Path(name).unlink()
    assert eqt_cli.load_experiment(found.path).base.plugins  # its user has run both files before
    forget_plugins()
    assert refusal(ConfigError, eqt_cli.load_experiment, found.path).endswith(
        "controllers[0].file: the result contains the source of lee.c, which eqt executes only on "
        "request; read it with `eqt show --plugins`, then add trust_plugins=True"
    )
    again = eqt_cli.load_experiment(found.path, trust_plugins=True)
    kept = again.base.plugins["lee.c"]
    assert "typedef struct" in kept  # the header, too
    assert "lee_torque" in kept
    other = eqt_cli.run(again, out=tmp_path / "s")
    with open_at(found.path) as a, open_at(other.path) as b:
        np.testing.assert_array_equal(a.read("pose"), b.read("pose"))
        assert a.attributes["digest"] == b.attributes["digest"]


def test_the_text_is_what_the_preprocessor_reads(written, config):
    """A header that a macro names is in the digest; one that a comment names is not read."""
    found = {}
    for gain in (1.0, 9.0):
        written(
            more='#define F "sub/gain.h"\n#include F\n/* off:\n#include "old.h"\n*/',
            body="torque[0] = torque[1] = torque[2] = GAIN;",
        )
        Path("sub").mkdir(exist_ok=True)
        Path("sub/gain.h").write_text('#include "../unit.h"\n', encoding="utf-8")
        Path("unit.h").write_text(f"#define GAIN {gain}\n", encoding="utf-8")
        Path("old.h").write_text("/* */\n#undef GAIN\n#define GAIN 5\n/*", encoding="utf-8")
        study = eqt_cli.load_experiment(config())
        kept = study.base.plugins["lee.c"]
        assert f"#define GAIN {gain}" in kept and "#undef" not in kept
        found[study.digest] = _torque(study.base.loops["ours"])[0, 0]
    assert sorted(found.values()) == [1.0, 9.0]


def test_a_folder_that_is_packed_is_the_same_experiment(written, config, eqt, forget_plugins):
    written()
    Path("c.yaml").write_text(yaml_source.dump(config()), encoding="utf-8")
    for share in ("1/2", "2/2"):
        assert eqt("run", "c.yaml", "--shard", share, "--out", "r", "--quiet").code == 0
    forget_plugins()
    said = eqt("pack", "r").err
    assert "which eqt executes only on request" in said
    done = eqt("pack", "r", "--trust-plugins", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["failed"] == 0


def test_its_numbers_are_swept_and_solved_together(written, config, eqt):
    written()
    Path("c.yaml").write_text(yaml_source.dump(config()), encoding="utf-8")
    done = eqt(
        "sweep", "c.yaml", "--grid", "controllers[0].numbers.kR=1,2", "--out", "r", "--quiet"
    )
    assert done.code == 0, done.err
    with open_at("r") as result:
        one, two = (result.point(k).read("pose", controller=0) for k in range(2))
    assert np.abs(one - two).max() > 1e-3


def test_its_numbers_are_tuned(written, config):
    written()
    tune = {
        "over": {"controllers[0].numbers.kR": [0.5, 10]},
        "objective": "mean_pose_error",
        "budget": 5,
        "samples": 1,
        "confirm": {"runs": 2},
    }
    found = eqt_cli.tune(config(over={"tune": tune}), out="t")
    text = Path("t/tuned/ours.yaml").read_text(encoding="utf-8")
    tuned = yaml_source.load(text, "tuned").data["controllers"][0]["numbers"]
    assert found is not None
    assert 0.5 <= tuned["kR"] <= 10
    assert tuned["kR"] != 2.0


def test_it_is_not_exported(written, config, eqt):
    written()
    Path("c.yaml").write_text(yaml_source.dump(config()), encoding="utf-8")
    assert says(
        eqt("export", "c.yaml").err, "eqt: error: ours: the law is code in lee.c, not a formula…\n"
    )
