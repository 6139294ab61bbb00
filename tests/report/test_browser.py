"""The report in headless Chromium, from a file, without a network."""

import os
import shutil
from pathlib import Path

import pytest

webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium")

from selenium.webdriver.chrome.service import Service  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

DRIVER = shutil.which("chromedriver")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)

pytestmark = pytest.mark.skipif(
    DRIVER is None or BROWSER is None, reason="needs Chromium and its driver (chromedriver)"
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    profile = tmp_path_factory.mktemp("profile")
    for argument in (
        "--headless=new",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--window-size=1200,1000",
        "--host-resolver-rules=MAP * ~NOTFOUND",  # no name has an address
        f"--user-data-dir={profile}",
        *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []),
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def address(invoke, paper_result, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    invoke("report", paper_result, "--out", path)
    return path.as_uri()


@pytest.fixture
def page(browser, address):
    browser.get(address)
    WebDriverWait(browser, 20).until(lambda page: find(page, "#count").text)
    return browser


def find(page, selector):
    return page.find_element(By.CSS_SELECTOR, selector)


def cells(page, column):
    return [
        c.text for c in page.find_elements(By.CSS_SELECTOR, f"#all tbody tr > :nth-child({column})")
    ]


def curve(page, panel=0):
    return find(page, f".panel[data-panel='{panel}'] path.curve").get_attribute("d")


def test_nothing_goes_wrong(page):
    assert page.get_log("browser") == []


def test_nothing_is_requested_but_the_page_itself(browser, address):
    browser.get_log("performance")
    browser.get(address)
    messages = [entry["message"] for entry in browser.get_log("performance")]
    requested = [m for m in messages if '"Network.requestWillBeSent"' in m]
    assert all(Path(address).name in message for message in requested)


def test_figures_are_as_wide_as_the_page_allows(page):
    widths = [s.size["width"] for s in page.find_elements(By.CSS_SELECTOR, "figure .paper svg")]
    assert widths and min(widths) > 800


def test_next_run_is_drawn(page):
    before = curve(page)
    find(page, "#next").click()
    assert find(page, "#run-name").text == "1"
    assert curve(page) != before
    assert find(page, "#run-summary").text.startswith("Run 1. eqt: mean torque in the first 5 s")


def test_slider_is_moved_by_the_keyboard(page):
    find(page, "#slider").send_keys(Keys.ARROW_RIGHT * 3)
    assert find(page, "#run").get_attribute("value") == "3"
    assert find(page, "#slider").get_attribute("aria-valuetext") == "run 3"


def test_run_is_typed(page):
    box = find(page, "#run")
    box.clear()
    box.send_keys("42", Keys.ENTER)
    assert find(page, "#run-name").text == "42"


def test_run_that_is_not_there_leaves_all_as_it_was(page):
    box = find(page, "#run")
    box.clear()
    box.send_keys("4711", Keys.ENTER)
    assert box.get_attribute("value") == "0"


def test_controllers_can_be_hidden(page):
    find(page, "#shown input").click()
    assert len(page.find_elements(By.CSS_SELECTOR, ".panel[data-panel='0'] path.curve")) == 3


def test_logarithmic_scale(page):
    before = curve(page), curve(page, 2)
    find(page, "#log").click()
    assert curve(page) != before[0]
    assert curve(page, 2) == before[1]  # torque does not converge to 0


def test_table_is_sorted_by_its_headings(page):
    heading = find(page, "#all thead th:nth-child(4)")
    heading.find_element(By.TAG_NAME, "button").click()
    rising = [float(text) for text in cells(page, 4)]
    assert rising == sorted(rising) and heading.get_attribute("aria-sort") == "ascending"
    heading.find_element(By.TAG_NAME, "button").send_keys(Keys.ENTER)
    falling = [float(text) for text in cells(page, 4)]
    assert falling == sorted(falling, reverse=True) and falling[0] > rising[0]


def test_runs_without_a_value_come_last(page):
    for _ in range(2):
        find(page, "#all thead th:nth-child(10) button").click()
        assert "–" not in cells(page, 10)


def test_table_is_filtered(page):
    Select(find(page, "#by-controller")).select_by_visible_text("gt")
    find(page, "#by-run").send_keys("3, 10-12")
    assert list(zip(cells(page, 1), cells(page, 2), strict=True)) == [
        ("gt", run) for run in ("3", "10", "11", "12")
    ]
    assert find(page, "#count").text == "4 of 240 rows"
    find(page, "#filters button[type=reset]").click()
    page.implicitly_wait(2)
    assert find(page, "#count").text == "240 of 240 rows"


def test_table_is_filtered_by_values(page):
    Select(find(page, "#by-column")).select_by_index(1)
    find(page, "#by-limit").send_keys("2.5")
    assert min(float(text) for text in cells(page, 4)) > 2.5
    Select(find(page, "#by-column")).select_by_visible_text("settling time")
    Select(find(page, "#by-relation")).select_by_value("missing")
    assert set(cells(page, 10)) == {"–"}


def test_pages_of_the_table(page):
    assert find(page, "#page").text == "page 1 of 10"
    find(page, "#forth").click()
    assert (find(page, "#page").text, cells(page, 2)[0]) == ("page 2 of 10", "25")


def test_a_row_draws_its_run(page):
    page.find_elements(By.CSS_SELECTOR, "#all td button")[5].click()
    assert find(page, "#run-name").text == "5"
    assert page.switch_to.active_element.get_attribute("id") == "run"


def test_keyboard_reaches_the_content_first(page):
    page.switch_to.active_element.send_keys(Keys.TAB)
    assert page.switch_to.active_element.text == "Skip to the content"
    page.switch_to.active_element.send_keys(Keys.ENTER)
    assert page.switch_to.active_element.get_attribute("id") == "content"


def test_every_control_has_a_name(page):
    controls = page.find_elements(
        By.CSS_SELECTOR, "button, input, select, svg[role=img], [role=region]"
    )
    assert all(control.accessible_name for control in controls)


def ground(page):
    return find(page, "body").value_of_css_property("background-color")


@pytest.mark.parametrize(("scheme", "dark"), [("light", False), ("dark", True)])
def test_appearance_follows_the_system_and_the_reader(page, scheme, dark):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    assert (ground(page) == "rgba(20, 24, 29, 1)") == dark
    Select(find(page, "#theme")).select_by_value("light" if dark else "dark")
    assert (ground(page) == "rgba(20, 24, 29, 1)") != dark


def test_ink_is_legible_in_the_dark(page):
    Select(find(page, "#theme")).select_by_value("dark")
    colour = find(page, "figure .paper svg").value_of_css_property("fill")
    assert colour == "rgb(228, 232, 236)"


def test_narrow_screens_need_no_sideways_scrolling(page):
    metrics = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    page.refresh()
    width = page.execute_script("return document.documentElement.scrollWidth")
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert width <= 390


def test_tables_fit_a_usual_screen(page):
    tables = page.find_elements(By.CSS_SELECTOR, ".scroll")
    widths = [(t.get_property("scrollWidth"), t.get_property("clientWidth")) for t in tables]
    assert all(needed <= there for needed, there in widths)


def test_print_leaves_the_controls_out(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    shown = [e.is_displayed() for e in page.find_elements(By.CSS_SELECTOR, "nav, #pick, #filters")]
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "screen"})
    assert not any(shown)


@pytest.fixture
def player(browser, invoke, paper_result, tmp_path):
    invoke("animate", paper_result, "--run", 1, "--format", "html", "--out", tmp_path)
    browser.get((tmp_path / "run1.html").as_uri())
    return browser


def test_animation_plays_and_pauses(player):
    find(player, "#play").click()
    WebDriverWait(player, 20).until(lambda page: find(page, "#time").get_attribute("value") > "0")
    find(player, "#play").click()
    assert find(player, "#play").get_attribute("aria-pressed") == "false"
    assert find(player, "#state").text.startswith("At 0.")
    assert player.get_log("browser") == []


def test_animation_is_moved_and_turned_by_the_keyboard(player):
    def body():
        return find(player, ".bodies svg").get_attribute("innerHTML")

    first = body()
    find(player, "#time").send_keys(Keys.ARROW_RIGHT * 20)
    moved = body()
    assert find(player, "#clock").text == "t = 0.40 s"
    find(player, ".bodies svg").send_keys(Keys.ARROW_LEFT)
    assert len({first, moved, body()}) == 3


@pytest.fixture
def points(browser, invoke, swept_result, tmp_path):
    invoke("report", swept_result, "--out", tmp_path / "report.html")
    browser.get((tmp_path / "report.html").as_uri())
    WebDriverWait(browser, 20).until(lambda page: find(page, "#count").text)
    return browser


def test_the_points_of_a_sweep_are_sorted_by_their_swept_values(points):
    heading = points.find_elements(By.CSS_SELECTOR, "#all thead button")[3]
    assert heading.text == "gains.kp"
    heading.click()
    heading.click()
    assert find(points, "#all tbody tr td:nth-child(4)").text == "2.5"
    assert points.get_log("browser") == []
