"""The page as text: what it may do, what is in it, and what has no page."""

import html
import re

import pytest
from plugin_sources import ESCAPE
from said import says
from small_experiment import configuration

from eqt_cli import api
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.live import wasm

HOSTILE = '</script><img src=x onerror="alert(1)">'


@pytest.fixture
def uncompiled(monkeypatch):
    """A page's programs are not compiled, but everything else is done."""
    monkeypatch.setattr(wasm, "command", lambda: ["cc"])
    monkeypatch.setattr(wasm, "compiled", lambda source, fused: b"\0asm")


def written(folder, text, **more):
    (folder / "c.yaml").write_text(text, encoding="utf-8")
    return api.live(folder / "c.yaml", folder / "page.html", **more).read_text(encoding="utf-8")


@pytest.mark.ci("runs an experiment and traces its laws")
def test_page_may_run_its_program_and_nothing_else(folder, uncompiled):
    page = written(folder, configuration())
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    assert policy == (
        "default-src 'none'; style-src 'unsafe-inline'; "
        "script-src 'unsafe-inline' 'wasm-unsafe-eval'; worker-src blob:; img-src data:"
    )
    assert "arXiv 2511.18800" in page  # a reader has the page alone
    assert not re.findall(r"(?:https?:)?//[\w.]+\.\w+/", page.replace("http://www.w3.org/", ""))


@pytest.mark.ci("runs an experiment and traces its laws")
def test_labels_are_text(folder, uncompiled):
    label = {"kind": "eqt", "label": HOSTILE}
    page = written(folder, configuration(controllers=[label]), title=HOSTILE)
    assert HOSTILE not in page and html.escape(HOSTILE, quote=False)[:12] in page


@pytest.mark.ci("traces laws")
@pytest.mark.parametrize(
    ("more", "keys", "said"),
    [
        ({}, {"time.duration": "1:3"}, "time.duration: no slider…"),
        ({}, {"ensemble.runs": "1:3:1"}, "ensemble.runs: no slider…gains.kp"),
        ({}, {"gains.kq": "1:3"}, "gains.kq: a slider moves a number…"),
        ({}, {"gains.kp": "-1:3"}, "gains.kp: at -1: must be positive…"),
        ({}, {"settling_threshold": "0.01:1"}, "settling_threshold: …changes the program…"),
        ({"live": "{gains.kq: [1, 3]}"}, {}, "…:…: live.gains.kq: a slider moves a number…"),
        ({"live": "{ensemble.runs: [1, 3]}"}, {}, "…:…: live.ensemble.runs: no slider…"),
        ({"failed_when": "{attitude: 170 deg}"}, {}, "failed_when: …--set failed_when=null"),
        (
            {"plugins": "[plugin.py]", "controllers": "[escape]"},
            {},
            "escape cannot run in a page: …is code of a plugin",
        ),
    ],
)
def test_what_cannot_go_live_is_refused_before_anything_runs(
    folder, uncompiled, monkeypatch, more, keys, said
):
    monkeypatch.setattr("eqt_cli.extensions.live.api.run", None)
    (folder / "plugin.py").write_text(ESCAPE, encoding="utf-8")
    with pytest.raises(EqtError) as caught:
        written(folder, configuration(settling_threshold=0.05, **more), keys=keys)
    assert says(str(caught.value), said)


@pytest.mark.ci("runs an experiment and traces its laws")
def test_configuration_and_result_name_the_sliders(folder, uncompiled):
    page = written(folder, configuration(live="{gains.kd: [0.2, 2, 0.3], gains.kp: }"))
    assert re.findall(r'"key": "([^"]*)"', page) == ["gains.kd", "gains.kp"]
    api.run(api.load_experiment(folder / "c.yaml"), folder / "r")
    api.live(folder / "r", folder / "again.html")
    again = (folder / "again.html").read_text(encoding="utf-8")
    assert re.findall(r'"key": "([^"]*)"', again) == ["gains.kd", "gains.kp"]
