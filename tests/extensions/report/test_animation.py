"""The page that plays a run."""

import json
import re

import numpy as np
import pytest

from eqt_cli.api.loading import open_at
from eqt_cli.extensions.report.document import animation


@pytest.fixture(scope="module")
def text(paper_result):
    with open_at(paper_result) as results:
        return animation(results, 4)


def data(text):
    return json.loads(re.search(r'id="data"[^>]*>(.*?)</script>', text, re.DOTALL)[1])


def test_page_holds_the_run(text, paper_result):
    found = data(text)
    with open_at(paper_result) as results:
        pose = results.read("pose", controller=2, run=4)
    rotation = np.array(found["bodies"][2]["rotation"]).reshape(-1, 3, 3)
    # Four digits are kept.
    assert rotation == pytest.approx(pose, rel=5.1e-4)
    assert [look["title"] for look in found["controllers"]] == ["EqT", "GT", "nog", "asym"]


def test_names_are_escaped(make_result):
    # Nothing but escaping keeps a stranger's title out of the page's code.
    name = "</script><b>"
    values = make_result.constant([1.0] * 2)
    rotation = np.broadcast_to(np.eye(3), (1, 2, 41, 3, 3))
    signals = {"lyapunov": values, "pose_error": values, "torque_norm": values}
    results = make_result(
        ["eqt"], signals, title=name, more={"pose": rotation, "desired_pose": rotation[0, 0]}
    )
    text = animation(results, 0)
    assert name not in text


def test_command_writes_both(invoke, paper_result, tmp_path):
    brief = ["--seconds", 0.2, "--controller", "gt"]
    done = invoke("animate", paper_result, "--run", 2, *brief, "--out", tmp_path)
    assert [line.split()[1] for line in done.stdout.splitlines()] == [
        str(tmp_path / "run2.gif"),
        str(tmp_path / "run2.html"),
    ]
    assert (tmp_path / "run2.gif").read_bytes().startswith(b"GIF89a")
    assert len(data((tmp_path / "run2.html").read_text(encoding="utf-8"))["bodies"]) == 1
