"""The built documentation in headless Chromium: `make docs` first."""

from pathlib import Path

import pytest

BUILT = Path(__file__).parents[1] / "build" / "docs"

pytestmark = [
    pytest.mark.skipif(not (BUILT / "index.html").exists(), reason="needs make docs"),
    pytest.mark.slow("a browser draws the pages"),
]

PAGES = (
    "index gallery reference/api/index reference/commands experiments/flies "
    "explanation/glossary explanation/estimates explanation/theory howto/estimate howto/index"
).split()


@pytest.mark.parametrize(("width", "scheme"), [(375, "light"), (1280, "dark")])
@pytest.mark.parametrize("page", PAGES)
def test_axe_finds_nothing(violations, page, width, scheme):
    assert violations((BUILT / f"{page}.html").as_uri(), width, scheme) == []


def test_no_page_is_wider_than_a_phone(browser):
    screen = {"width": 375, "height": 812, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    wide = []
    for path in sorted({*BUILT.glob("*.html"), *BUILT.glob("[!_]*/**/*.html")}):
        browser.get(path.as_uri())
        if browser.execute_script("return document.documentElement.scrollWidth") > 375:
            wide.append(path.relative_to(BUILT).as_posix())
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert wide == []
