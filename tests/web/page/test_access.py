"""The page for everybody: small, without other hosts, on phones, by keys, for the colour-blind."""

from __future__ import annotations

import itertools
import math
import re

import pytest

from tests.web.page.served_robot import STATIC, wait_for

pytestmark = pytest.mark.browser

FIRST_LOAD_BYTES = 400_000
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


def test_the_first_load_is_small_and_asks_no_other_host(browser, robot):
    context = browser.new_context()
    page = context.new_page()
    asked, bodies = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("websocket", lambda socket: asked.append(socket.url))
    page.on("response", lambda response: bodies.append(response))  # noqa: PLW0108 - it is marked
    page.goto(robot.url)
    page.get_by_text("works,").wait_for()
    page.get_by_role("tab", name="Plots").click()
    size = sum(len(each.body()) for each in bodies)
    context.close()
    assert {re.match(r"\w+://([^/]+)", url)[1] for url in asked} == {f"127.0.0.1:{robot.port}"}
    assert {url.partition("://")[0] for url in asked} == {"http", "ws"}
    assert 50_000 < size <= FIRST_LOAD_BYTES


@pytest.mark.parametrize("settings", [{}, {"color_scheme": "dark"}, PHONE])
def test_axe_finds_no_serious_fault(open_page, settings):
    from axe_playwright_python.sync_playwright import Axe

    page = open_page(**settings)
    page.get_by_role("button", name="Take the sticks").click()
    page.locator(".map-layers summary").click()
    page.locator(".pad summary").click()
    found = []
    for tab in page.get_by_role("tab").all():
        tab.click()
        found += Axe().run(page).response["violations"]
    serious = [each for each in found if each["impact"] in {"serious", "critical"}]
    assert [(each["id"], [node["html"] for node in each["nodes"]]) for each in serious] == []


def test_a_phone_shows_all_without_scrolling_sideways_and_stop_in_reach(open_page):
    page = open_page(**PHONE)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 390
    stop = page.get_by_role("button", name="STOP")
    for _ in range(2):
        box = stop.bounding_box()
        assert box["y"] + box["height"] <= 844
        assert box["width"] > 300
        assert box["height"] >= 44
        page.evaluate("() => scrollTo(0, document.body.scrollHeight)")
    canvas = page.locator(".map canvas").bounding_box()
    assert canvas["height"] > 250


def test_everything_is_reached_by_keys(robot, open_page):
    page = open_page()
    names = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        names.add(page.evaluate("() => document.activeElement.textContent.trim()"))
    assert {"Look", "Go to", "Place robot", "Follow", "Arm", "Disarm", "Hold"} - names <= {"Arm"}
    assert any(name.startswith("STOP") for name in names)
    page.get_by_role("button", name="Take the sticks").press("Enter")
    page.get_by_text("You have the sticks.").wait_for()
    page.get_by_role("tab", name="Drive").press("ArrowRight")
    page.get_by_role("searchbox").wait_for()


def test_the_theme_follows_the_system_until_it_is_chosen_and_stays(open_page):
    page = open_page(color_scheme="dark")
    ground = lambda: page.evaluate("() => getComputedStyle(document.body).backgroundColor")  # noqa: E731
    dark = ground()
    page.get_by_role("button", name="Light or dark").click()
    light = ground()
    assert sum(map(int, re.findall(r"\d+", light)[:3])) > 600
    assert sum(map(int, re.findall(r"\d+", dark)[:3])) < 150
    page.reload()
    wait_for(lambda: ground() == light, page)


def _linear(colour: str) -> list[float]:
    """Return red, green, blue in linear light (IEC 61966-2-1)."""
    values = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values]


# Simulation of colour blindness in linear RGB (Machado, Oliveira and Fernandes, 2009, severity 1).
BLINDNESS = {
    "none": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "protanopia": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
    "deuteranopia": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
}


def _lab(linear: list[float]) -> tuple[float, float, float]:
    """Return CIE L*a*b* for D65 of linear sRGB."""
    to_xyz = (
        (0.4124564, 0.3575761, 0.1804375),
        (0.2126729, 0.7151522, 0.0721750),
        (0.0193339, 0.1191920, 0.9503041),
    )
    white = (0.95047, 1.0, 1.08883)
    f = []
    for row, w in zip(to_xyz, white, strict=True):
        t = max(0.0, sum(a * b for a, b in zip(row, linear, strict=True))) / w
        f.append(t ** (1 / 3) if t > 216 / 24389 else (24389 / 27 * t + 16) / 116)
    return 116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])


@pytest.mark.parametrize("blindness", BLINDNESS)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_of_what_lies_side_by_side_on_the_map_can_be_told(theme, blindness):
    """A CIE76 difference of 2.3 is just noticed; points of a few pixels need several times that."""
    css = (STATIC / "page.css").read_text()
    blocks = css.split(":root[data-theme=dark]")
    colours = dict(re.findall(r"--map-([\w-]+):\s*(#[0-9a-f]{3,6})\b", blocks[0]))
    if theme == "dark":
        colours |= dict(re.findall(r"--map-([\w-]+):\s*(#[0-9a-f]{3,6})\b", blocks[1]))
    names = ("free", "robot", "particle", "scan", "plan", "arc", "person", "wall")
    seen = {}
    for name in names:
        colour = colours[name]
        colour = colour if len(colour) == 7 else "#" + "".join(2 * c for c in colour[1:])
        linear = _linear(colour)
        rows = BLINDNESS[blindness]
        seen[name] = _lab([sum(a * b for a, b in zip(row, linear, strict=True)) for row in rows])
    near = {
        pair: round(math.dist(seen[pair[0]], seen[pair[1]]), 1)
        for pair in itertools.combinations(names, 2)
        if math.dist(seen[pair[0]], seen[pair[1]]) < 12
    }
    assert near == {}
