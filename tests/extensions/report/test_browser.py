"""The report in headless Chromium, from a file, without a network."""

import csv
import re
from pathlib import Path

import pytest

pytest.importorskip("selenium", reason="needs selenium")

from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

pytestmark = pytest.mark.ci("a browser draws the pages")


@pytest.fixture(scope="module")
def address(page_of, paper_result):
    return page_of(paper_result).as_uri()


@pytest.fixture
def page(browser, address):
    browser.get(address)
    WebDriverWait(browser, 20).until(lambda page: find(page, "#count").text)
    return browser


@pytest.fixture
def resize(browser):
    """Give the screen another width and height, which it has until the end of the test."""

    def resized(width, height):
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)

    yield resized
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


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
    figures = page.find_elements(By.CSS_SELECTOR, "#figures figure .paper svg")
    widths = [figure.size["width"] for figure in figures]
    assert widths and min(widths) > 800


def test_the_first_screen_has_the_answer_and_the_figure_beside_it(page, resize):
    resize(1280, 800)
    title, facts, answer, figure = (
        find(page, place).rect for place in ("h1", ".facts", ".intervals", "#figure1 svg")
    )
    assert facts["height"] < 2 * 16  # one line
    assert title["y"] < facts["y"] < answer["y"]
    assert answer["x"] + answer["width"] <= figure["x"]
    assert max(part["y"] + part["height"] for part in (answer, figure)) <= 800


def test_a_phone_shows_the_finding_and_its_intervals_on_its_first_screen(page, resize):
    resize(390, 844)
    page.refresh()
    answer = find(page, "table.interval")
    assert answer.get_property("scrollWidth") <= answer.get_property("clientWidth")
    assert answer.rect["y"] + answer.rect["height"] <= 844


def test_no_row_of_a_table_is_mostly_empty(page, resize):
    resize(1280, 800)
    # As of a cascade, which has many options.
    page.execute_script(
        """for (const row of document.querySelectorAll("#laws-table tr"))
          row.cells[row.cells.length - 2].textContent = "option 1.234, ".repeat(12)"""
    )
    assert max(row.size["height"] for row in page.find_elements(By.CSS_SELECTOR, "tr")) < 150


def test_next_run_is_drawn(page):
    before = curve(page)
    find(page, "#next").click()
    assert find(page, "#run-name").text == "1"
    assert curve(page) != before
    assert find(page, "#run-summary").text.startswith("Run 1. EqT: mean torque in the first 5 s")


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
        find(page, "#all thead th:nth-child(13) button").click()
        assert "–" not in cells(page, 13)


def test_table_is_filtered(page):
    Select(find(page, "#by-controller")).select_by_visible_text("GT")
    find(page, "#by-run").send_keys("3, 10-12")
    assert list(zip(cells(page, 1), cells(page, 2), strict=True)) == [
        ("GT", run) for run in ("3", "10", "11", "12")
    ]
    assert find(page, "#count").text == "4 of 240 rows"
    find(page, "#filters button[type=reset]").click()
    page.implicitly_wait(2)
    assert find(page, "#count").text == "240 of 240 rows"


def test_table_is_filtered_by_values(page):
    Select(find(page, "#by-column")).select_by_index(1)
    find(page, "#by-limit").send_keys("1.4")
    assert min(float(text) for text in cells(page, 4)) > 1.4
    Select(find(page, "#by-column")).select_by_visible_text("settling time")
    Select(find(page, "#by-relation")).select_by_value("missing")
    assert set(cells(page, 13)) == {"–"}


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
    for folded in page.find_elements(By.CSS_SELECTOR, "details"):
        page.execute_script("arguments[0].open = true", folded)
    controls = page.find_elements(
        By.CSS_SELECTOR, "button, input, select, svg[role=img], [role=region]"
    )
    # Of the two pictures of a loop, one is shown.
    assert all(control.accessible_name for control in controls if control.is_displayed())


def test_an_address_leads_to_a_run(browser, address):
    browser.get("about:blank")
    browser.get(f"{address}#run-17")
    assert find(browser, "#run-name").text == "17"


def test_the_link_to_a_run_follows_the_choice(page):
    find(page, "#next").click()
    find(page, "#run-link").click()
    assert page.current_url.endswith("#run-1")


def runs_by_pose_error(page, controller):
    """The numbers of its runs, the smallest mean pose error first, from the data of the page."""
    return page.execute_script(
        """const table = JSON.parse(document.getElementById("data-runs").textContent);
        const column = 3 + table.columns.findIndex((one) => one.metric === "mean_pose_error");
        return table.rows.filter((row) => row[0] === arguments[0])
          .sort((a, b) => a[column] - b[column]).map((row) => String(row[1]));""",
        controller,
    )


@pytest.mark.parametrize(("rank", "position"), [("best", 0), ("median", 29), ("worst", 59)])
def test_shortcuts_lead_to_extreme_runs(page, rank, position):
    Select(find(page, "#rank-controller")).select_by_visible_text("GT")
    Select(find(page, "#rank-column")).select_by_visible_text("mean ‖I − Q_E‖")
    find(page, f"[data-rank={rank}]").click()
    assert find(page, "#run-name").text == runs_by_pose_error(page, 1)[position]


def kept(page, button, name):
    """The text of a file that a button saves."""
    path = page.downloads / name
    path.unlink(missing_ok=True)
    page.execute_script("arguments[0].click()", find(page, button))
    WebDriverWait(page, 10).until(lambda _: path.exists() and path.stat().st_size)
    return path.read_text(encoding="utf-8")


def test_the_table_of_runs_is_saved_as_it_is_filtered(page):
    Select(find(page, "#by-controller")).select_by_visible_text("GT")
    head, *rows = csv.reader(kept(page, "#all-caption .download", "runs.csv").splitlines())
    assert head[:3] == ["law", "run", "status"] and "mean ‖τ‖, first 5 s (N m)" in head
    assert [row[:3] for row in rows] == [["gt", str(run), "ok"] for run in range(60)]


def test_a_table_is_saved(page):
    head, first, *_ = csv.reader(kept(page, "#answer-caption .download", "answer.csv").splitlines())
    assert (head[0], first[0]) == ("law", "EqT")


def test_the_configuration_is_saved(page):
    config = kept(page, "#config-caption .download", "config.yaml")
    assert config.startswith("# The paper's experiment") and "\nname: paper\n" in config


def test_a_figure_is_saved_with_a_size(page):
    svg = kept(page, "#figure1 .download", "figure1.svg")
    assert svg.startswith("<svg xmlns=") and 'pt"' in svg


@pytest.mark.parametrize("width", [375, 1280])
def test_headings_are_not_behind_the_bar(page, resize, width):
    resize(width, 800)
    hidden = page.execute_script(
        """return [...document.querySelectorAll("nav a")].filter((link) => {
          link.click();
          const bar = document.querySelector("nav").getBoundingClientRect().bottom;
          const heading = document.querySelector(`${link.getAttribute("href")} h2`);
          return heading.getBoundingClientRect().top < bar;
        }).map((link) => link.textContent)"""
    )
    assert hidden == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [375, 768, 1440])
def test_axe_finds_nothing(violations, address, width, scheme):
    assert violations(address, width, scheme) == []


def ground(page):
    return find(page, "body").value_of_css_property("background-color")


@pytest.mark.parametrize(("scheme", "dark"), [("light", False), ("dark", True)])
def test_appearance_follows_the_system_and_the_reader(page, scheme, dark):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    assert (ground(page) == "rgba(20, 24, 29, 1)") == dark
    Select(find(page, "#theme")).select_by_value("light" if dark else "dark")
    assert (ground(page) == "rgba(20, 24, 29, 1)") != dark


@pytest.mark.parametrize("drawn", ["figure .paper svg", ".panel svg", ".swatch"])
def test_curves_and_their_legends_are_turned_over_alike_in_the_dark(page, drawn):
    for theme, filter in (("dark", "invert(0.91) hue-rotate(180deg)"), ("light", "none")):
        Select(find(page, "#theme")).select_by_value(theme)
        assert find(page, drawn).value_of_css_property("filter") == filter


def test_a_law_is_hidden_and_stands_out_in_the_figures(page):
    def curves(law, condition=""):
        return page.find_elements(By.CSS_SELECTOR, f"#figure1 [id*='-law-{law}-']{condition}")

    law = (
        find(page, "tr[data-law] button").find_element(By.XPATH, "../..").get_attribute("data-law")
    )
    assert len(curves(law)) >= 4  # a curve in each panel
    find(page, f"tr[data-law='{law}'] button").click()
    assert len(curves(law, ".gone")) == len(curves(law)) and not curves("", ".dim")
    other = next(k for k in "0123" if k != law)
    ActionChains(page).move_to_element(find(page, f"tr[data-law='{other}']")).perform()
    assert len(curves(law, ".dim")) == len(curves(law)) and not curves(other, ".dim")


@pytest.mark.parametrize("width", [390, 1280])
def test_letters_of_figures_are_12_pixels_high(page, resize, width):
    resize(width, 844)
    for drawn in page.find_elements(By.CSS_SELECTOR, "figure .paper > svg"):
        wide = float(drawn.get_dom_attribute("viewBox").split()[2])
        assert 8 * drawn.size["width"] / wide >= 11.9  # set in 8 pt


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_letters_of_the_loop_and_of_single_runs_are_12_pixels_high(page, resize, width):
    resize(width, 844)
    page.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    sizes = page.execute_script(
        """return [...document.querySelectorAll("#loop svg text, .panel svg text")]
          .filter((text) => text.getClientRects().length)
          .map((text) => parseFloat(getComputedStyle(text).fontSize) * text.getScreenCTM().a)"""
    )
    assert len(sizes) > 40 and min(sizes) >= 11.9
    assert page.execute_script("return document.documentElement.scrollWidth") <= width


def test_narrow_screens_need_no_sideways_scrolling(page, resize):
    resize(390, 844)
    page.refresh()
    page.execute_script(  # as of a metric of a vehicle with wheels
        """for (const choice of document.querySelectorAll("#rank-column, #by-column"))
          choice.append(new Option("a long name of a metric ".repeat(4)))"""
    )
    assert page.execute_script("return document.documentElement.scrollWidth") <= 390


def test_on_a_phone_the_first_column_stays_while_a_table_scrolls(page, resize):
    resize(375, 812)
    moved = page.execute_script(
        """return [...document.querySelectorAll(".scroll")].filter((box) => box.clientWidth).map(
          (box) => {
            box.scrollLeft = 60;
            const first = box.querySelector("tbody th[scope=row]");
            const [left, edge] = [first, box].map((part) => part.getBoundingClientRect().left);
            return [box.scrollLeft, Math.round(left - edge), first.offsetWidth / box.clientWidth];
          })"""
    )
    assert any(scrolled for scrolled, _, _ in moved)
    assert [(off, share) for _, off, share in moved if off or share > 0.5] == []


def test_certificates_that_hold_are_folded_but_on_paper_and_pairs_are_open(page):
    assert find(page, "#pairs-table").is_displayed()
    assert not find(page, "#others-table").is_displayed()
    folded = find(page, "#certificates details")
    assert re.fullmatch(r"All \d+ statements and hypotheses", folded.text)
    page.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    assert folded.get_attribute("open") and find(page, "#all-certificates-table").is_displayed()


def test_a_phone_is_told_that_a_figure_scrolls(page, resize):
    def hinted(width):
        resize(width, 800)
        box = find(page, "#figures figure .paper")
        inside, room = (box.get_property(f"{what}Width") for what in ("scroll", "client"))
        return find(page, "#figures .hint").is_displayed(), inside > room

    assert [hinted(390), hinted(1280)] == [(True, True), (False, False)]


def test_tables_fit_a_usual_screen(page):
    tables = page.find_elements(By.CSS_SELECTOR, ".scroll")
    widths = [(t.get_property("scrollWidth"), t.get_property("clientWidth")) for t in tables]
    assert [pair for pair in widths if pair[0] > pair[1]] == []


def test_print_leaves_the_controls_out(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    shown = [e.is_displayed() for e in page.find_elements(By.CSS_SELECTOR, "nav, #pick, #filters")]
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "screen"})
    assert not any(shown)


def test_no_number_leaves_the_paper(page, resize):
    """Of A4 within its margins, 180 mm or 680 pixels."""
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    resize(680, 900)
    ends = page.execute_script(
        """const range = document.createRange(), out = [];
           for (const cell of document.querySelectorAll('table.interval td.number, #all td')) {
             range.selectNodeContents(cell);
             const right = range.getBoundingClientRect().right;
             if (right > document.documentElement.clientWidth + 1) out.push(cell.textContent);
           }
           return out;"""
    )
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "screen"})
    assert ends == []


def test_marks_of_intervals_are_borders_which_are_printed(page):
    """Browsers leave backgrounds out, and make borders whole pixels."""
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    marks = page.execute_script(
        """const size = e => { const s = getComputedStyle(e);
             const rest = parseFloat(s.width) - 2 * parseFloat(s.borderLeftWidth);
             return [rest < 2, s.borderTopWidth]; };
           const all = q => [...document.querySelectorAll(q)].map(size);
           return { filled: all('.strip .dot:is(.better *, .worse *, .base *)'),
                    hollow: all('tr:not(.better, .worse, .base) .strip .dot'),
                    lines: all('.strip .line') };"""
    )
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "screen"})
    assert all(full for full, _ in marks["filled"])
    assert not any(full for full, _ in marks["hollow"])
    assert marks["filled"]
    assert {width for _, width in marks["lines"]} == {"2px"}


def test_a_long_label_widens_no_phone(browser, resize, page_of, paper_result, tmp_path):
    page, long = page_of(paper_result).read_text(encoding="utf-8"), "kp=1_kd=0.5_" * 10
    page = re.sub(r'(?<=[>" ])EqT(?=[<" ,:])', long, page)
    (tmp_path / "long.html").write_text(page, encoding="utf-8")
    resize(390, 844)
    browser.get((tmp_path / "long.html").as_uri())
    assert browser.execute_script("return document.documentElement.scrollWidth") == 390


@pytest.fixture
def points(browser, page_of, swept_result):
    browser.get(page_of(swept_result).as_uri())
    WebDriverWait(browser, 20).until(lambda page: find(page, "#count").text)
    return browser


def test_the_points_of_a_sweep_are_sorted_by_their_swept_values(points):
    heading = points.find_elements(By.CSS_SELECTOR, "#all thead button")[3]
    assert heading.text == "gains.kp"
    heading.click()
    heading.click()
    assert find(points, "#all tbody tr td:nth-child(4)").text == "2.5"
    assert points.get_log("browser") == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [375, 1280])
def test_axe_finds_nothing_in_a_sweep(violations, points, width, scheme):
    assert violations(points.current_url, width, scheme) == []
