"""Laws that have no key of the search: they take part as they are."""

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.results.result import open_result

PUBLISHED = {"kind": "gt", "label": "published", "gains": {"kp": 4.0, "kd": 3.0}}
CONFIG = mapping(
    name="fixed",
    controllers=["eqt", PUBLISHED],
    ensemble={"runs": 3, "seed": 1},
    time={"duration": 1, "samples": 11},
    tune={
        "over": {"controllers[0].gains.kp": {"log": [0.5, 5]}},
        "objective": "mean_pose_error",
        "equal": {"effort": 9.0},
        "budget": 12,
        "samples": 3,
        "confirm": {"runs": 12, "seed": 77},
    },
)


@pytest.fixture(scope="session")
def tuned(made_once):
    return made_once("a fixed law", lambda folder: api.tune(dict(CONFIG), folder / "t")) / "t"


@pytest.mark.ci("searches to the end")
def test_a_fixed_law_flies_the_held_out_runs_as_without_a_search(tuned, tmp_path, invoke):
    plain = {key: value for key, value in CONFIG.items() if key != "tune"}
    plain |= {"controllers": [PUBLISHED], "ensemble": {"runs": 12, "seed": 77}}
    api.run(plain, out=tmp_path / "plain")
    with open_result(tuned) as held_out, open_result(tmp_path / "plain") as result:
        assert held_out.labels.count("published") == 1
        assert "published, start" not in held_out.labels
        for name in ("mean_pose_error", "effort"):
            of_law = held_out.metric(name, held_out.labels.index("published"))
            np.testing.assert_allclose(of_law, result.metric(name, 0), rtol=1e-12)


@pytest.mark.ci("searches to the end")
def test_a_fixed_law_is_named_and_judged(tuned, invoke):
    said = " ".join(invoke("show", tuned).stdout.split())
    assert "published as it is" in said
    assert "As it is, since tune.over has no key of it: published." in said
    assert "published spends" in said  # of the effort that others were tuned to
    assert "published against EqT" in " ".join(invoke("compare", tuned).stdout.split())


def test_all_laws_may_not_be_fixed(tmp_path, invoke):
    import yaml

    front = CONFIG["tune"] | {"objectives": ["mean_pose_error", "effort"]}
    front = {
        key: value for key, value in front.items() if key not in ("objective", "equal", "samples")
    }
    (tmp_path / "front.yaml").write_text(yaml.safe_dump(CONFIG | {"tune": front}))
    said = invoke("tune", tmp_path / "front.yaml", "--dry-run", code=2).stderr
    assert "has no key of controller 'published'" in said
