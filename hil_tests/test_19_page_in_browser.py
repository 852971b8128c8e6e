"""Bring-up, with eyes: a browser at the page drives the robot, tunes it and stops it."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from hil_tests.rig import PATIENT_S, Rig, is_exact
from robotctl.app.supervision.stack import NAVIGATION, TELEMETRY, WEB
from robotctl.messages.control import Mode, SafetyState
from robotctl.web.links import read_links
from tests.web.page.drawn_map import pixels, show_only

React = Callable[[str, float], None]

CHROMIUM = shutil.which(os.environ.get("ROBOTCTL_CHROMIUM") or "chromium")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="not run, no Chromium (Debian's package, or ROBOTCTL_CHROMIUM)"
)

AHEAD_PX, ASIDE_PX = 120, 60
"""Where the goal is from the robot, which looks to the right."""
NEAR_PX = 15
STOP_MS = 250.0
"""Time from the press of a key in the browser, which shares the processors with the robot."""


@pytest.fixture
def rig(make_rig: Callable[..., Rig], bus: str) -> Rig:
    """Firmware, control, navigation and the web page, disarmed."""
    if is_exact(bus):
        pytest.skip("not run, a browser knows no virtual time")
    rig = make_rig(override="web={enabled=true,port=0}")
    rig.start_firmware()
    rig.start()
    rig.start(NAVIGATION)
    rig.start(WEB)
    rig.wait_for_state(SafetyState.STANDBY)
    rig.wait(lambda: rig.navigation, PATIENT_S, "navigation works")
    rig.prefer(NAVIGATION, WEB)
    return rig


@pytest.fixture
def page(rig: Rig) -> Iterator[Any]:
    """The page in a browser, with nothing on its map but the robot."""
    from playwright.sync_api import sync_playwright

    rig.wait(lambda: read_links(rig.endpoints.web_links), PATIENT_S, "the page is served")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(read_links(rig.endpoints.web_links).address)
        show_only(page, "Robot")
        yield page
        browser.close()


def place(page: Any) -> tuple[float, float]:
    """Return where on the page the robot is drawn [px]."""
    seen = pixels(page, "robot")
    return seen.x, seen.y


def test_a_click_on_the_map_brings_the_robot_there_and_stop_cuts_its_power(
    rig: Rig, page: Any, reaction: React
) -> None:
    page.get_by_role("button", name="Arm", exact=True).click()
    rig.wait_for_state(SafetyState.ARMED)
    x, y = place(page)
    wanted = (x + AHEAD_PX, y - ASIDE_PX)
    page.get_by_role("button", name="Go to").click()
    page.mouse.click(*wanted)
    rig.wait(lambda: rig.navigation.goal_reached, 30.0, "the goal is reached")
    assert rig.navigation.mode == Mode.GUIDED
    seen = place(page)
    assert math.dist(seen, wanted) < NEAR_PX
    truth, goal = rig.fresh_truth(), (rig.control.x_m, rig.control.y_m)
    assert truth.distance_m > 0.5
    assert goal[1] > 0.2 * goal[0] > 0.0  # to the left of where it looked: up on the page

    page.mouse.click(x, y)
    rig.wait(lambda: rig.control.v_m_s > 0.2, PATIENT_S, "the robot drives back")
    asked_ns = time.monotonic_ns()
    page.keyboard.press("Space")
    rig.wait(lambda: rig.truth.power_off_ns > asked_ns, 2.0, "the wheels lose their power")
    taken_ms = (rig.truth.power_off_ns - asked_ns) / 1e6
    reaction("page in a browser, space bar: wheels without power", taken_ms)
    assert taken_ms < STOP_MS
    page.get_by_text("Emergency stop after").wait_for()
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)


def test_a_mission_drawn_on_the_map_is_driven_and_a_drawn_fence_is_kept_to(
    rig: Rig, page: Any
) -> None:
    def press(name: str) -> None:
        page.get_by_role("button", name=name, exact=True).click()

    press("Arm")
    rig.wait_for_state(SafetyState.ARMED)
    x, y = place(page)
    first, second = (x + AHEAD_PX, y), (x + AHEAD_PX, y - ASIDE_PX)
    page.get_by_role("tab", name="Mission").click()
    press("New")
    page.mouse.click(*first)
    page.mouse.click(*second)
    press("Send to robot")
    page.get_by_text("The robot has it").wait_for()
    press("Close")
    press("Start")
    passed: list[float] = []

    def is_driven() -> bool:
        passed.append(math.dist(place(page), first))
        return bool(rig.navigation.mission_completed)

    rig.wait(is_driven, 40.0, "the mission is completed")
    assert rig.navigation.items == 2
    assert min(passed) < NEAR_PX
    assert math.dist(place(page), second) < NEAR_PX

    # It stands within a fence now, and is sent beyond it.
    x, y = place(page)
    page.get_by_role("tab", name="Zones").click()
    press("Draw a polygon")
    page.get_by_label("It is").select_option(label="a fence to stay within")
    edge = y - ASIDE_PX
    for corner in ((x - 150, y + 150), (x + 100, y + 150), (x + 100, edge), (x - 150, edge)):
        page.mouse.click(*corner)
    press("Close")
    rig.wait(lambda: rig.navigation.fence.enabled, PATIENT_S, "the robot has the fence")
    page.get_by_role("button", name="Go to").click()
    page.mouse.click(x, edge - ASIDE_PX)
    rig.wait(lambda: "fence: the robot stops" in rig.navigation.message, 30.0, "it stops there")
    seen = pixels(page, "robot")
    assert edge < seen.top < y
    assert rig.navigation.fence.breaches == 0


def set_parameter(page: Any, name: str, value: float) -> None:
    """Type a value of a parameter and press Enter."""
    page.get_by_role("tab", name="Tune").click()
    page.get_by_label("Find a parameter").fill(name)
    field = page.get_by_role("textbox", name=name)
    field.fill(str(value))
    field.press("Enter")


def test_a_limit_and_a_gain_of_the_page_are_those_of_the_loop_until_they_are_undone(
    rig: Rig, page: Any
) -> None:
    rig.start(TELEMETRY)
    rig.prefer(NAVIGATION, WEB, TELEMETRY)
    page.get_by_role("button", name="Arm", exact=True).click()
    rig.wait_for_state(SafetyState.ARMED)
    page.get_by_role("button", name="Take the sticks").click()
    page.get_by_text("You have the sticks.").wait_for()
    page.get_by_role("tab", name="Tune").click()
    page.get_by_role("button", name="Only changed (0)").wait_for(timeout=1e3 * PATIENT_S)

    set_parameter(page, "LIM_V_MAX", 0.2)
    rig.wait(lambda: rig.control.tuning, PATIENT_S, "control has taken the limit")
    limited = run_step(rig, page)
    assert limited == pytest.approx(0.3 * 0.2, abs=0.005)
    set_parameter(page, "CTL_L_KP", 0.7)
    page.get_by_role("button", name="Undo: CTL_L_KP back to 0.65").click()
    page.get_by_role("button", name="Undo: LIM_V_MAX back to 0.8").click()
    rig.wait(lambda: rig.control.tuning == 0, PATIENT_S, "control has the file's values again")
    assert run_step(rig, page) == pytest.approx(0.3 * 0.8, abs=0.01)

    figures = page.get_by_role("table", name="Figures of the step")
    left = figures.get_by_role("row", name="left").get_by_role("cell").all_inner_texts()
    rise_ms, wanted_ms, overshoot, error = (float(each.split()[0]) for each in left)
    assert 0.0 < wanted_ms <= rise_ms + 40.0 < 600.0
    assert overshoot < 20.0
    assert abs(error) < 0.25


def run_step(rig: Rig, page: Any) -> float:
    """Run the step response of the page; return the greatest speed that it wanted [m/s].

    Where the machine stood for a while the robot has let go, and the step is tried again.
    """
    figures = page.get_by_role("table", name="Figures of the step")
    seen: list[float] = []
    for _ in range(8):
        page.get_by_role("button", name="Step …").click()
        page.get_by_role("button", name="Yes: hold to run").hover()
        page.mouse.down()
        seen.clear()
        for _ in range(150):
            page.wait_for_timeout(20)
            rig.listen()
            seen.append(rig.control.v_ref_m_s)
            if figures.is_visible():
                break
        page.mouse.up()
        if figures.is_visible():
            return max(seen)
    raise AssertionError("no step came to its end")
