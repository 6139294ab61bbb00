"""What the section `tune` is read as, and what is said where it is wrong."""

import pytest
from case_tables import from_yaml
from said import error_of, mentions

from eqt_cli.api.loading import document_from, load_experiment
from eqt_cli.base.errors import ConfigError
from eqt_cli.extensions.search.law_search import _slug
from eqt_cli.extensions.search.record import values_text
from eqt_cli.extensions.search.tune import Search


def read(config):
    return Search.read(document_from(config, {}))


def test_keys_of_a_controller_are_its_own_and_those_of_gains_everybodys(small):
    eqt, family = read(small).laws
    assert list(eqt.axes) == ["gains.kp"]
    assert list(family.axes) == ["gains.kp", "controllers[0].gyroscopic"]


def test_a_formula_sets_the_entries_that_a_range_names(small):
    small["gains"] = {"kp": [1.0, 1.0, 1.0], "kd": 0.5}
    small["tune"] |= {"over": {"w": [1, 3]}, "set": {"gains.kp[0:2]": "2 + w"}}
    law = read(small).laws[0]
    assert law.at({"w": 1.5}).data["gains"]["kp"] == [3.5, 3.5, 1.0]
    small["tune"]["set"] = {"gains.kp[2:2]": "2 + w"}
    assert mentions(error_of(read, small), "tune.set…gains.kp[0:3]…gains.kp[2:2]")


def test_gains_of_a_law_are_its_own_start_and_its_own_range(small):
    small["controllers"] = ["eqt", {"kind": "gt", "gains": {"kp": 2.0}}]
    small["tune"]["over"] = {"controllers[1].gains.kp": [1, 3], "gains.kp": [0.5, 1.5]}
    eqt, gt = read(small).laws
    assert gt.document.data["gains"] == {"kp": 2.0, "kd": 0.5}
    assert gt.values([0.5]) == {"gains.kp": 2.0}
    assert eqt.values([0.5]) == {"gains.kp": 1.0}
    assert (eqt.start, gt.start) == ((0.5,), (0.5,))


def test_a_cascade_keeps_its_gains_and_leaves_the_section_to_others(small):
    cascade = {
        "kind": "cascade",
        "attitude": "lee2010",
        "along": [0, 0, 1],
        "position": {"kx": 4.0, "kv": 3.0},
        "gains": {"kp": 1.0, "kd": 0.2},
    }
    small |= {
        "group": "SE3",
        "inertia": [2, 2, 2, 1, 1, 1],
        "model": {"forces": [{"kind": "restoring", "weight": 9.81}]},
        "reference": {"kind": "flat", "position": ["sin(t)", 0.0, 0.0], "along": [0, 0, 1]},
        "initial": {"pose": "fixed", "velocity": "normal"},
        "controllers": [cascade, "eqt"],
    }
    small["tune"]["over"] = {
        "gains.kp": [0.5, 5],
        "controllers[0].gains.kp": [0.5, 1.5],
        "controllers[0].position.kx": [2, 6],
    }
    of_cascade, eqt = read(small).laws
    assert list(eqt.axes) == ["gains.kp"]
    assert list(of_cascade.axes) == ["controllers[0].gains.kp", "controllers[0].position.kx"]
    assert of_cascade.start == (0.5, 0.5)
    tuned = of_cascade.at(of_cascade.values([1.0, 0.0])).data["controllers"][0]
    assert (tuned["gains"]["kp"], tuned["position"]["kx"]) == (1.5, 2.0)
    small["tune"]["subject_to"] = {"effort_rotation": 2}  # a part, where units are mixed
    assert [(b.metric, b.above) for b in read(small).bounds] == [("effort_rotation", True)]
    del small["gains"]  # where no law reads it
    small["controllers"], small["tune"]["over"] = [cascade], {"controllers[0].gains.kd": [0.1, 1]}
    assert read(small).laws[0].document.data["controllers"][0]["gains"] == {"kp": 1.0, "kd": 0.2}


def test_a_start_outside_of_the_ranges_is_no_point_of_the_search(small):
    small["tune"]["over"] = {"gains.kp": [2, 3]}
    assert [law.start for law in read(small).laws] == [None, None]


def test_whole_numbers_are_tuned_as_such(small):
    small["tune"]["over"] = {"gains.kp": {"low": 1, "high": 4, "integer": True}}
    law = read(small).laws[0]
    assert [law.values([share])["gains.kp"] for share in (0, 0.3, 0.6, 1)] == [1, 2, 3, 4]
    assert law.start is not None
    assert law.values(law.start)["gains.kp"] == 1


def test_one_number_for_several_entries(small):
    small["gains"] = {"kp": [1.0, 1.0, 2.0], "kd": 0.5}
    small["controllers"] = ["eqt", {"kind": "gt", "gains": {"kp": [3.0, 1.0, 2.0]}}]
    small["tune"]["over"] = {"gains.kp[0:2]": [0.5, 4], "controllers[1].gains.kp[2:3]": [1, 3]}
    eqt, gt = read(small).laws
    assert eqt.at({"gains.kp[0:2]": 4.0}).data["gains"]["kp"] == [4.0, 4.0, 2.0]
    assert list(gt.axes) == ["gains.kp[0:2]", "gains.kp[2:3]"]
    assert gt.written == ("gains.kp[0:2]", "controllers[1].gains.kp[2:3]")
    assert eqt.start == (1 / 7,)
    assert gt.start is None  # its entries differ, so that no one number is its start
    assert values_text({"gains.kp[0:2]": 4.0}) == "kp[0:2] 4"


def test_only_the_numbers_of_generations_and_searches_may_change_between_sessions(small):
    digest = read(small).digest
    small["tune"] |= {"budget": 7, "samples": 4}
    assert read(small).digest == digest
    small["tune"]["equal"] = {"effort": 7}
    assert read(small).digest != digest


def test_no_other_command_minds_sections_of_searches(small):
    without = {key: value for key, value in small.items() if key != "tune"}
    worst = {"over": small["tune"]["over"], "objective": "mean_pose_error"}
    digests = {load_experiment(c).digest for c in (small, without, without | {"worst": worst})}
    assert len(digests) == 1


@from_yaml
def test_what_is_wrong_is_said_at_its_place(small, changed, message):
    small["tune"] |= changed
    said = error_of(read, small, kind=ConfigError)
    assert mentions(said, message.replace('["effort"]', "['effort']"))


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        ("controllers[2].slope", "expected a number greater than 0, got -1.0"),
        ("controllers[1].gains.kp", "must be positive, got -1, else small errors"),
    ],
)
def test_a_key_is_named_as_it_is_written(small, key, wrong):
    law = small["controllers"][1]["kind"]
    small["controllers"] = [*small["controllers"], "slotine_li"]
    small["tune"]["over"] = {"gains.kd": [1, 2], key: [-1, 1]}
    with pytest.raises(ConfigError) as error:
        read(small)
    law = "slotine_li" if "slope" in key else law
    found = f"tune.over: at the lower ends, controller '{law}' alone: {key}: {wrong}"
    assert found in str(error.value)


def test_a_bound_of_the_mean_is_on_the_side_that_is_worse(small):
    small["tune"]["subject_to"] = {"effort": 3, "settled": 0.9, "peak_torque": {"max": 2}}
    assert [str(bound) for bound in read(small).bounds] == [
        "effort ≤ 3 in the mean",
        "peak_torque ≤ 2 in every run",
        "settled ≥ 0.9 in the mean",
    ]


def test_names_of_laws_do_not_differ_in_capitals_only():
    """A folder of `Lee-x` would be that of `lee-x` on some disks; numbers stay unique."""
    taken = []
    for label in ("lee x", "Lee-x", "LEE.x", "lee-x-2", "a-3", "a", "a!", "A?"):
        taken.append(_slug(label, taken))
    assert len({each.casefold() for each in taken}) == len(taken)


def test_a_name_that_follows_from_a_label_is_that_of_no_device():
    assert _slug("NUL", []) == "law-NUL"
