"""What a search may not depend on: names, order, language, other laws, workers."""

from copy import deepcopy

import pytest
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.api.loading import document_from
from eqt_cli.extend import Local
from eqt_cli.extensions.search.tune import Search

CONFIG = mapping(
    name="named",
    controllers=["eqt", "gt"],
    ensemble={"runs": 3, "seed": 1},
    time={"duration": 0.5, "samples": 6},
    solver={"rtol": 1.0e-6, "cross_check": 0, "error_estimate": False},
    tune={
        "over": {"gains.kp": {"log": [0.1, 10]}, "gains.kd": {"log": [0.05, 5]}},
        "objective": "mean_pose_error",
        "equal": {"effort": 3.0},
        "samples": 2,
        "budget": 22,
        "confirm": {"runs": 2},
    },
)


def gains(config, out, **more):
    """The gains of each law on each sample, by its position and the last parts of the keys."""
    record = api.tune(deepcopy(config), out, **more).record
    return [
        [
            {key.rpartition(".")[2]: value for key, value in search["values"].items()}
            for search in law["searches"]
        ]
        for law in record["laws"]
    ]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return gains(CONFIG, tmp_path_factory.mktemp("plain") / "t")


def changed(**more):
    return {**CONFIG, **more}


def over(**ranges):
    return changed(tune=CONFIG["tune"] | {"over": ranges})


LOG = {"kp": {"log": [0.1, 10]}, "kd": {"log": [0.05, 5]}}


@pytest.mark.ci("searches once more")
@pytest.mark.parametrize(
    ("config", "order"),
    [
        (changed(name="other", controllers=[{"kind": "eqt", "label": "zulu"}, "gt"]), [0, 1]),
        (changed(controllers=["gt", "eqt"]), [1, 0]),
        (changed(controllers=["eqt", "nog", "gt"]), [0, 2]),
        (over(**{"gains.kd": LOG["kd"], "gains.kp": LOG["kp"]}), [0, 1]),
        (
            over(**{f"controllers[{k}].gains.{key}": LOG[key] for key in LOG for k in (1, 0)}),
            [0, 1],
        ),
    ],
    ids=["renamed", "in another order", "beside another law", "keys in another order", "own keys"],
)
def test_gains_do_not_depend_on_names_order_or_other_laws(plain, tmp_path, config, order):
    again = gains(config, tmp_path / "other-file")
    assert [again[k] for k in order] == plain


def test_neither_label_nor_order_nor_another_key_moves_a_point():
    """The searches of all laws begin at the same points, and laws with equal numbers go on so."""
    config = changed(
        controllers=["gt", {"kind": "eqt", "label": "zulu"}],
        tune=CONFIG["tune"] | {"over": {"gains.kd": LOG["kd"], "gains.kp": LOG["kp"]}},
    )
    eqt, gt = Search.read(document_from(CONFIG, {})).laws
    moved, zulu = Search.read(document_from(config, {})).laws
    assert [law.order for law in (eqt, gt, moved, zulu)] == [("gains.kp", "gains.kd")] * 4
    assert eqt.values((0.2, 0.7)) == moved.values((0.2, 0.7)) == zulu.values((0.2, 0.7))


@pytest.mark.ci("searches with two workers")
def test_gains_do_not_depend_on_workers(plain, tmp_path):
    assert gains(CONFIG, tmp_path / "t", workers=2) == plain


@pytest.mark.ci("starts processes")
def test_gains_do_not_depend_on_the_executor(plain, tmp_path):
    assert gains(CONFIG, tmp_path / "t", executor=Local(2)) == plain


@pytest.mark.ci("searches twice")
def test_a_search_goes_on_from_its_batches_bit_for_bit(plain, tmp_path):
    few = changed(tune=CONFIG["tune"] | {"budget": 18, "samples": 1})
    gains(few, tmp_path / "t")
    assert gains(CONFIG, tmp_path / "t") == plain
