"""Pages that compute, in headless Chromium, against runs by eqt."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
from small_experiment import configuration

from eqt_cli import api

pytest.importorskip("selenium", reason="needs selenium")
pytest.importorskip("ziglang", reason="needs ziglang, a compiler for WebAssembly")

from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

pytestmark = pytest.mark.ci("compiles a page and opens it in a browser")

SOLVER = "{engine: native, rtol: 1.0e-8, cross_check: 0}"
LATE = "{period: 50 ms, delay: 1}"
NOISE = "{pose: [{kind: noise, std: 0.01}], velocity: [{kind: noise, std: [0.01, 0.02, 0.01]}]}"
LIMITS = "[{kind: limit, limit: 1.5}, {kind: lag, time_constant: 0.1}]"
KINDS = {
    "continuous": {},
    "several spans": {"reference": '{torque: ["where(t > 0.5, 1.5, 0.3)", "sin(t)", "0"]}'},
    "sampled": {"control": LATE, "sensors": NOISE},
    "limits": {"actuators": LIMITS},
}
KEYS = {"gains.kp": "0.5:3", "gains.kd": "0.2:2", "inertia[0]": "2:2.8"}


def opened(browser, page, fragment="", query=""):
    browser.get("about:blank")
    browser.get(page.as_uri() + query + fragment)
    return settled(browser)


def settled(browser):
    done = "return Boolean(window.eqtLive && eqtLive.done && eqtLive.shown)"
    WebDriverWait(browser, 60).until(lambda page: page.execute_script(done))
    return browser


def text(page, selector):
    return page.find_element(By.CSS_SELECTOR, selector).text


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    made, folder = {}, tmp_path_factory.mktemp("live")

    def page_of(kind):
        if kind not in made:
            config = folder / f"{kind}.yaml"
            config.write_text(configuration(solver=SOLVER, **KINDS[kind]), encoding="utf-8")
            made[kind] = config, api.live(config, config.with_suffix(".html"), keys=KEYS)
        return made[kind]

    return page_of


@pytest.fixture
def page(browser, pages):
    return opened(browser, pages("continuous")[1])


@pytest.mark.parametrize("kind", KINDS)
def test_moved_sliders_give_the_bits_of_eqt(browser, pages, kind, tmp_path):
    config, file = pages(kind)
    page = opened(browser, file)
    assert "All 18 configured numbers equal" in text(page, "#live-check")
    setting = {"gains.kp": 1.6, "gains.kd": 1.2, "inertia[0]": 2.2}
    page.execute_script(
        "for (const [k, v] of Object.entries(arguments[0])) eqtLive.fields[k](v); eqtLive.moved()",
        setting,
    )
    got = settled(page).execute_script(
        "return [[...eqtLive.all], eqtLive.shown.kept.map((x) => [...x])]"
    )
    result = api.run(api.load_experiment(config, setting), tmp_path / "r")
    names = [
        column["metric"]
        for column in json.loads(
            page.execute_script("return document.getElementById('live-data').textContent")
        )["columns"]
    ]
    numbers = np.array([np.inf if x is None else x for x in got[0]], float).reshape(2, 3, -1)
    for place, name in enumerate(names):
        expected = np.array(result[name])
        assert (
            np.where(np.isfinite(expected), expected, np.inf).tolist()
            == numbers[..., place].tolist()
        )
    assert numbers[..., len(names) + 1].tolist() == np.array(result["steps"], float).tolist()
    for law, kept in enumerate(got[1]):
        samples = np.array(kept).reshape(11, -1)
        assert samples[:, :9].tolist() == np.array(result["pose"])[law, 0].reshape(11, 9).tolist()


PLUGIN = """
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Controller, exp


@dataclass(frozen=True)
class Stiffening(Controller):
    name: ClassVar[str] = "stiffening"
    title: ClassVar[str] = "Stiffening"

    def torque(self, s):
        r = s.relative
        return r.cancelling_feedforward - 2 * r.gradient - exp(-s.V_tilde[..., :1]) * r.body_damping
"""
CASCADE = {
    "group": "SE3",
    "inertia": "[0.01, 0.01, 0.02, 1, 1, 1]",
    "gains": None,
    "reference": '{kind: flat, position: ["sin(t)", "0", "0"]}',
    "controllers": "[{kind: cascade, attitude: stiffening, position: {kx: 2, kv: 2}, "
    "gains: {kp: 0.2, kd: 0.1}, along: [0, 0, 1]}]",
    "initial": "{pose: {kind: exp_normal, std: 0.1}, velocity: fixed}",
    "model": "{forces: [{kind: restoring, weight: 9.80665}]}",
    "plant": "{forces: [{kind: restoring, weight: 9.80665}]}",
}


@pytest.mark.parametrize(("more", "key", "value"), [
    ({"controllers": "[eqt, stiffening]"}, "gains.kp", 1.6),
    (CASCADE, "controllers[0].gains.kp", 0.3),
])  # fmt: skip
def test_a_law_of_a_plugin_computes_in_a_page(browser, tmp_path, more, key, value):
    config = tmp_path / "c.yaml"
    (tmp_path / "law.py").write_text(PLUGIN, encoding="utf-8")
    config.write_text(configuration(solver=SOLVER, plugins="[law.py]", **more), encoding="utf-8")
    page = opened(browser, api.live(config, tmp_path / "c.html", keys={key: f"0.1:{2 * value}"}))
    assert re.fullmatch(r"All \d+ configured numbers equal.*", text(page, "#live-check"), re.DOTALL)
    page.execute_script("eqtLive.fields[arguments[0]](arguments[1]); eqtLive.moved()", key, value)
    numbers = settled(page).execute_script("return [...eqtLive.all]")
    of_runs = np.array([np.inf if x is None else x for x in numbers], float)
    steps = np.array(api.run(api.load_experiment(config, {key: value}), tmp_path / "r")["steps"])
    of_runs = of_runs.reshape(*steps.shape, -1)
    assert any(np.array_equal(steps, of_runs[..., k]) for k in range(of_runs.shape[-1]))


def test_without_fused_multiply_add_the_page_says_by_how_much_it_differs(browser, pages):
    page = opened(browser, pages("continuous")[1], query="?fused=no")
    said = text(page, "#live-check")
    assert "rounds a·b + c twice" in said and "largest relative difference is" in said
    assert float(said.split("difference is ")[1].split(" ")[0].rstrip(".")) < 1e-10


def test_page_that_is_not_eqts_shows_no_table(browser, pages, tmp_path):
    whole = pages("continuous")[1].read_text(encoding="utf-8")
    changed = tmp_path / "changed.html"
    rtol = json.loads(whole.split('type="application/json">')[1].split("</script>")[0])["solver"][
        "rtol"
    ]
    changed.write_text(whole.replace(f'"rtol": {rtol}', '"rtol": 0.001'), encoding="utf-8")
    page = opened(browser, changed)
    assert "is not the experiment" in text(page, "#live-check") and not text(page, "#live-all")


def test_nothing_goes_wrong_and_nothing_is_requested(browser, pages):
    browser.get_log("performance"), browser.get_log("browser")
    opened(browser, pages("continuous")[1])
    requested = [
        json.loads(entry["message"])["message"]["params"]["request"]["url"]
        for entry in browser.get_log("performance")
        if '"Network.requestWillBeSent"' in entry["message"]
    ]
    assert not [url for url in requested if url.startswith(("http", "ws", "ftp"))]
    assert browser.get_log("browser") == []


def axe(page):
    page.execute_script((Path(__file__).parents[2] / "axe/axe.min.js").read_text("utf-8"))
    found = "axe.run().then((found) => arguments[0](found.violations.map((each) => each.id)))"
    return page.execute_async_script(found)


def test_axe_finds_nothing(page):
    assert axe(page) == []


def test_keyboard_moves_a_slider_and_the_link_holds_it(page, pages, browser):
    slider = page.find_element(By.CSS_SELECTOR, "#live-sliders input[type=range]")
    slider.send_keys(Keys.ARROW_RIGHT * 4)
    value = settled(page).execute_script("return eqtLive.setting['gains.kp']")
    assert value > 1 and slider.get_attribute("aria-valuetext") == f"gains.kp {value:g} N m"
    assert text(page, "#live-command").endswith(f"--set 'gains.kp={value:g}'")
    assert "better" in text(page, "#live-all") or "worse" in text(
        page, "#live-all"
    )  # not by colour alone
    table, link = (
        text(page, "#live-all"),
        page.find_element(By.ID, "live-link").get_attribute("href"),
    )
    opened(browser, pages("continuous")[1], fragment="#" + link.split("#")[1])
    assert text(page, "#live-all") == table


def test_a_typed_number_between_values_says_which_is_taken(page):
    page.execute_script("eqtLive.fields['gains.kp'](1.2345)")
    taken = page.execute_script("return eqtLive.setting['gains.kp']")
    assert text(page, "#live-sliders .nearest") == f"nearest to 1.2345: {taken:g}"


def test_an_inertia_of_no_rigid_body_is_told(page):
    """2, 1, 3 kg m² are those of a plate, and 1.9, 1, 3 of nothing."""
    for moment, told in ((1.9, "No rigid body has this inertia"), (2.0, "")):
        page.execute_script(f"eqtLive.setting['inertia[0]'] = {moment}; eqtLive.moved()")
        said = page.find_element(By.ID, "live-body").get_property("textContent")
        assert said.startswith(told) and bool(said) == bool(told)


def test_a_link_to_a_setting_shows_what_is_configured_too(browser, pages):
    page = opened(browser, pages("continuous")[1], fragment="#gains.kp=1.6")
    seen = "return document.querySelector('#live-panels path.was').getAttribute('d')"
    WebDriverWait(browser, 20).until(lambda page: page.execute_script(seen))
    assert "Thin lines: as configured" in text(page, "#live-moment")


def test_paper_has_the_command_of_the_setting(browser, pages):
    page = opened(browser, pages("continuous")[1], fragment="#gains.kp=1.6")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert text(page, "#live-command").endswith("--set 'gains.kp=1.6'")
        assert not page.find_element(By.ID, "live-play").is_displayed()
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_blocked_scripts_and_workers_are_told(browser, pages, tmp_path):
    page = pages("continuous")[1].read_text(encoding="utf-8")
    for policy, said in (
        (("script-src 'unsafe-inline' 'wasm-unsafe-eval'; ", ""), "If it stays"),
        (("worker-src blob:", "worker-src 'none'"), "blocks workers"),
    ):
        file = tmp_path / "blocked.html"
        file.write_text(page.replace(*policy), encoding="utf-8")
        browser.get(file.as_uri())
        assert said in text(browser, "#live-check")
    browser.get_log("browser")


def test_a_long_label_widens_no_phone(browser, pages, tmp_path):
    page, long = pages("continuous")[1].read_text(encoding="utf-8"), "kp=1_kd=0.5_" * 10
    file = tmp_path / "long.html"
    file.write_text(page.replace(">EqT<", f">{long}<").replace('"EqT"', f'"{long}"'), "utf-8")
    screen = {"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    try:
        page = opened(browser, file)
        assert long in text(page, "#live-all") and long in text(page, "#live-terms")
        assert page.execute_script("return document.documentElement.scrollWidth") == 390
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_law_is_hidden(page):
    page.find_element(By.CSS_SELECTOR, "#live-all input").click()
    curve = page.find_element(By.CSS_SELECTOR, "#live-panels path.curve")
    assert (
        curve.get_attribute("d") == ""
        and len(page.find_elements(By.CSS_SELECTOR, "#live-moment .entry")) == 1
    )


def test_a_run_of_too_many_steps_fails_and_says_so(browser, folder):
    solver = SOLVER.replace("}", ", max_steps: 400}")
    (folder / "c.yaml").write_text(configuration(solver=solver), encoding="utf-8")
    page = opened(browser, api.live("c.yaml", "c.html", keys={"gains.kd": "0.5:5000"}).absolute())
    page.find_element(By.CSS_SELECTOR, "#live-sliders input[type=range]").send_keys(Keys.END)
    assert text(settled(page), "#live-all").count("3 failed: too many steps") == 2


def test_stored_bytes_are_doubles(pages):
    data = pages("continuous")[1].read_text(encoding="utf-8").split('type="application/json">')[1]
    numbers = json.loads(data.split("</script>")[0])["numbers"]
    assert base64.b64decode(numbers)[:2] == b"\x1f\x8b"


def test_a_report_begins_with_the_sliders(browser, pages, tmp_path):
    result = api.run(api.load_experiment(pages("continuous")[0]), tmp_path / "r")
    file = api.report(
        result, tmp_path / "r.html", figures=["torque", "pose"], live=True, quick=True
    )
    page = opened(browser, file, fragment="#gains.kp=1.6")
    assert "All 18 configured numbers equal" in text(page, "#live-check")
    assert text(page, "#live-command") == "eqt run config.yaml --set 'gains.kp=1.6'"
    first = page.execute_script("return document.querySelector('main h2').textContent")
    assert first == "3 runs of each law" and text(page, "#summary-title") == "What was found"
    page.find_element(By.CSS_SELECTOR, "nav [href='#figures']").click()  # of another part
    assert page.execute_script("return eqtLive.setting['gains.kp']") == 1.6
    assert axe(page) == [] and page.get_log("browser") == []
