"""The page as text: what it may do, what is in it, and what has no page."""

import html
import json
import re
import shlex

import pytest
from plugin_sources import ESCAPE, component
from said import says
from small_experiment import configuration

from eqt_cli import api
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.extensions.live import document, wasm
from eqt_cli.extensions.live.api import ranges

SLOW = component("""
slow(eqt_cli.components.forces.Force):
    departs: ClassVar[str] = "drag of a plugin"

    def acting(self, G, t, Q, V):
        return -0.1 * V
""")
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
def test_a_page_of_some_of_the_runs_says_so_and_its_command_gives_them(
    folder, uncompiled, monkeypatch
):
    monkeypatch.setattr(document, "MOST_RUNS", 2)
    with pytest.warns(EqtWarning, match="has the first 2 of 3 runs"):
        page = written(folder, configuration(), overrides={"ensemble.runs": 3})
    assert "The first 2 of 3 runs of each law" in page
    data = json.loads(page.split('type="application/json">')[1].split("</script>")[0])
    words = shlex.split(data["command"])
    assert words[:2] == ["eqt", "run"] and words[3:] == [
        "--engine",
        "native",
        "--set=ensemble.runs=2",
    ]


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
            {"plugins": "[plugin.py]", "plant": "{forces: [{kind: slow}]}"},
            {},
            "eqt cannot run in a page: …slow…is code, no formula",
        ),
    ],
)
def test_what_cannot_go_live_is_refused_before_anything_runs(
    folder, uncompiled, monkeypatch, more, keys, said
):
    monkeypatch.setattr("eqt_cli.extensions.live.api.run", None)
    (folder / "plugin.py").write_text(SLOW, encoding="utf-8")
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


@pytest.mark.ci("runs an experiment and traces its laws")
def test_a_law_of_a_plugin_that_is_a_formula_runs_in_a_page(folder, uncompiled):
    law = ESCAPE.replace("20 * s.V", "s.relative.cancelling_feedforward - 20 * s.V")
    (folder / "plugin.py").write_text(law, encoding="utf-8")
    more = {"plugins": "[plugin.py]", "controllers": "[eqt, escape]"}
    assert '"escape"' in written(folder, configuration(**more))


def test_two_sliders_of_one_key_are_refused():
    assert ranges(["gains.kp=1:2", "gains.kd"]) == {"gains.kp": "1:2", "gains.kd": ""}
    with pytest.raises(EqtError, match=r"gains\.kp = 1:3: gains\.kp has a slider already"):
        ranges(["gains.kp=1:2", "gains.kp = 1:3"])


def test_keys_are_checked_before_a_compiler_is_wanted(folder, monkeypatch):
    monkeypatch.setattr(wasm, "find_spec", lambda name: None)
    monkeypatch.setenv("CC", "/nowhere/clang")
    for keys, said in {"gains.kq": "gains.kq: a slider…", "gains.kp": "…compiler…"}.items():
        with pytest.raises(EqtError) as caught:
            written(folder, configuration(), keys={keys: "1:3"})
        assert says(str(caught.value), said)
