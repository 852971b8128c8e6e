"""A browser, and a robot behind the page in it; tests are left out by name where there is none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator

import pytest

from tests.web.page.served_robot import STATIC, ServedRobot

CHROMIUM = shutil.which(os.environ.get("ROBOTCTL_CHROMIUM") or "chromium")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out tests marked `browser` or `node` where they cannot run."""
    for item in items:
        if item.get_closest_marker("browser") and CHROMIUM is None:
            reason = "browser missing: chromium (Debian's package, or ROBOTCTL_CHROMIUM)"
            item.add_marker(pytest.mark.skip(reason=reason))
        if item.get_closest_marker("node"):
            packages = STATIC.parent / "page" / "node_modules"
            if shutil.which("node") is None:
                item.add_marker(pytest.mark.skip(reason="node missing: see make page"))
            elif not packages.is_dir():
                item.add_marker(pytest.mark.skip(reason=f"packages missing: {packages}; make page"))


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Chromium without a screen; tests that need it are marked `browser`.

    Playwright has an event loop that runs until it ends: no test that needs one of its own may run
    meanwhile.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def robot() -> Iterator[ServedRobot]:
    served = ServedRobot()
    yield served
    served.stop()


@pytest.fixture
def open_page(browser, robot):
    """Return a function that opens the page of the robot and waits until it is connected."""
    contexts, errors = [], []

    def open_it(script: str = "", url: str = "", **settings):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | settings)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda line: errors.append(line.text) if _is_policy(line) else None)
        if script:
            page.add_init_script(script)
        page.goto(url or robot.url)
        page.get_by_text("tester").first.wait_for()
        page.locator(".figure", has_text="Link").get_by_text("ms").wait_for()
        return page

    yield open_it
    for context in contexts:
        context.close()
    assert errors == []


def _is_policy(line) -> bool:
    """Whether the browser says that the page broke the server's security policy."""
    return "Content Security Policy" in line.text
