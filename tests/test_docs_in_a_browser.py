"""The built documentation in headless Chromium: `make docs` first."""

from pathlib import Path

import pytest

BUILT = Path(__file__).parents[1] / "build" / "docs"

pytestmark = [
    pytest.mark.skipif(not (BUILT / "index.html").exists(), reason="needs make docs"),
    pytest.mark.ci("a browser draws the pages"),
]

PAGES = (
    "index gallery reference/api/index reference/commands experiments/flies "
    "explanation/glossary explanation/certified explanation/estimates explanation/theory "
    "howto/estimate howto/index"
).split()


@pytest.mark.parametrize(("width", "scheme"), [(375, "light"), (1280, "dark")])
@pytest.mark.parametrize("page", PAGES)
def test_axe_finds_nothing(violations, page, width, scheme):
    assert violations((BUILT / f"{page}.html").as_uri(), width, scheme) == []


# What is wider than its place is clipped where it does not scroll, or where no shadow says so.
JUDGE = """
const found = { wide: document.documentElement.scrollWidth > innerWidth, code: [], tables: [],
                broken: [] };
const clipped = (box) => box.scrollWidth > box.clientWidth + 1;
const shaded = (box) => {
  const style = getComputedStyle(box);
  return style.overflowX === "auto" && style.backgroundAttachment.includes("local");
};
for (const pre of document.querySelectorAll("article pre")) {
  const columns = pre.closest(
    ".highlight-console, .highlight-output, .highlight-sh, .highlight-text");
  if (clipped(pre) && !(columns && shaded(pre))) found.code.push(pre.innerText.slice(0, 60));
}
for (const table of document.querySelectorAll("article table")) {
  const box = table.parentElement;
  if (clipped(box) && !shaded(box)) found.tables.push(table.innerText.slice(0, 60));
}
const range = document.createRange();
for (const place of document.querySelectorAll("article code, article dt.sig")) {
  const texts = document.createTreeWalker(place, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const text = texts.currentNode;
    for (const word of text.data.matchAll(/[A-Za-z0-9_]+/g)) {
      range.setStart(text, word.index);
      range.setEnd(text, word.index + word[0].length);
      const lines = new Set([...range.getClientRects()].map((line) => Math.round(line.top)));
      if (lines.size > 1) found.broken.push(word[0]);
    }
  }
}
return found;
"""


@pytest.fixture(scope="module")
def judged(browser):
    """Each page at the width of a screen and of a narrow phone."""
    found = {}
    pages = {*BUILT.glob("*.html"), *BUILT.glob("[!_]*/**/*.html")} - {BUILT / "genindex.html"}
    for path in sorted(pages):  # Sphinx's index has tables for layout
        if 'http-equiv="refresh"' in path.read_text(encoding="utf-8"):
            continue
        browser.get(path.as_uri())
        for width in (1280, 375):
            screen = {"width": width, "height": 812, "deviceScaleFactor": 1, "mobile": width < 600}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
            found[path.relative_to(BUILT).as_posix(), width] = browser.execute_script(JUDGE)
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    return found


@pytest.mark.parametrize("flaw", ["wide", "code", "tables", "broken"])
def test_no_page_is_wide_and_nothing_is_clipped_or_broken(judged, flaw):
    """Code, tables, and the identifiers in code."""
    assert len(judged) > 100
    assert {place: found[flaw] for place, found in judged.items() if found[flaw]} == {}


FOUND_FIRST = {
    "quickstart": "tutorials/paper.html",
    "units": "howto/change.html",
    "wind": "howto/vehicle.html",
    "docker": "install.html",
    "list of laws": "reference/laws.html",
    "quaternion": "reference/recordings.html",
    "current": "howto/marine.html",
    "PX4": "howto/autopilots.html",
}


@pytest.mark.parametrize(("words", "page"), FOUND_FIRST.items())
def test_a_search_finds_the_page_first(browser, words, page):
    """By an `{index}` directive of the page, which the search reads."""
    browser.get(f"{(BUILT / 'search.html').as_uri()}?q={words}")
    wait = pytest.importorskip("selenium.webdriver.support.wait")
    first = wait.WebDriverWait(browser, 20).until(
        lambda page: page.find_element("css selector", "#search-results ul.search li a")
    )
    assert first.get_attribute("href").partition("?")[0].partition("#")[0].endswith(page)
