"""What the page says about the robot: why it does not drive, how old all is, what was refused."""

from __future__ import annotations

import time

import msgspec
import pytest

from robotctl.messages.control import Arm, Notice, SafetyState, SetMode, StepBudget
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.mode import Mode
from robotctl.web.access import Role
from tests.web.page.served_robot import ServedRobot, wait_for

pytestmark = pytest.mark.browser


def why(page) -> str:
    return " ".join(page.locator(".why").inner_text().split())


def test_each_objection_to_arming_is_shown_with_its_remedy(robot, open_page):
    robot.state = SafetyState.STANDBY
    robot.against_arming = (
        Fault(FaultCode.BATTERY_LOW, "the battery is low"),
        Fault(FaultCode.NODE_SILENT, "drive (node 1): no heartbeat for 350 ms", "drive"),
    )
    page = open_page()
    wait_for(lambda: "The battery is low. Charge the battery." in why(page), page)
    assert "no heartbeat for 350 ms. Check the power and the cable of that node." in why(page)


def test_the_verdict_on_the_map_is_shown_while_there_is_one(robot, open_page):
    page = open_page()
    place, verdict = page.locator("#map-place"), page.locator(".map-verdict")
    place.get_by_text("mcl: localised").wait_for()
    assert verdict.count() == 0
    robot.verdict = "good"
    page.get_by_text("Map: good").wait_for()
    assert page.locator(".map-verdict.bad").count() == 0
    robot.verdict = "doubtful because 30 of 900 scans match nothing near"
    page.locator(".map-verdict.bad").wait_for()
    assert "Map: doubtful because 30 of 900 scans match nothing near" in verdict.inner_text()


def test_arming_that_is_refused_is_said_with_the_reason(robot, open_page):
    robot.state = SafetyState.STANDBY
    robot.against_arming = (Fault(FaultCode.BATTERY_LOW, "the battery is low"),)
    page = open_page()
    page.get_by_role("button", name="Arm", exact=True).click()
    page.get_by_role("alert").get_by_text("Arm: the battery is low").wait_for()
    assert robot.requests(Arm)[0].arm


def test_the_times_of_navigation_are_shown_by_part(robot, open_page):
    robot.budget = StepBudget(50.0, 400, 3, 9.0, 21.5, {"steer": 7.25}, {"steer": 17.0})
    page = open_page()
    page.get_by_role("tab", name="Nodes").click()
    table = page.locator("table", has_text="Steps of navigation every 50 ms; 3 of 400 took longer")
    table.wait_for()
    rows = [each.inner_text().split("\t") for each in table.locator("tbody tr").all()]
    assert rows == [["in all", "9.0", "21.5"], ["steer", "7.3", "17.0"]]


def test_the_computer_s_figures_are_shown_and_what_is_short_is_marked(robot, open_page):
    page = open_page()
    page.get_by_role("tab", name="Nodes").click()
    figures = page.get_by_label("The robot's computer")
    figures.get_by_text("23 %").wait_for()
    assert figures.locator("dd").all_inner_texts() == [
        "23 %",
        "54 °C",
        "1.2 GB left",
        "⚠ 100.0 MB left",
    ]
    assert figures.locator(".bad dt").all_inner_texts() == ["Disk"]


def test_modes_are_asked_for_and_the_present_one_is_marked(robot, open_page):
    page = open_page()
    page.get_by_role("button", name="Auto", exact=True).click()
    wait_for(lambda: [each.mode for each in robot.requests(SetMode)] == [Mode.AUTO], page)
    page.locator("button[aria-pressed=true]", has_text="Auto").wait_for()


def test_old_data_goes_grey_with_its_age_and_comes_back(robot, open_page):
    page = open_page()
    assert page.locator(".bar.stale").count() == 0
    robot.is_silent = True
    page.locator(".bar.stale .age").get_by_text("s old").wait_for()
    wait_for(lambda: "Nothing has come from control for" in why(page), page)
    robot.is_silent = False
    wait_for(lambda: page.locator(".bar.stale").count() == 0, page)


def test_a_robot_whose_clock_has_paused_is_not_old(robot, open_page):
    page = open_page()
    robot.paused_ns = 3_000_000_000
    page.wait_for_timeout(700)  # a pong tells
    wait_for(lambda: page.locator(".bar.stale").count() == 0, page, 2.0)


def test_it_connects_again_by_itself_and_shows_the_new_state(robot, open_page):
    page = open_page()
    page.evaluate("() => { window.sameDocument = true; }")
    robot.stop()
    wait_for(lambda: "No connection to the robot." in why(page), page)
    robot.state, robot.reason = SafetyState.FAULT, "wheel is blocked"
    robot.start()
    page.locator(".pill.state-FAULT").wait_for()
    assert page.evaluate("() => window.sameDocument")


def test_another_version_of_the_server_brings_its_own_page(robot, open_page):
    page = open_page()
    page.evaluate("() => { window.sameDocument = true; }")
    robot.stop()
    robot.outline = msgspec.structs.replace(robot.outline, version="1")
    robot.start()
    page.wait_for_function("() => window.sameDocument === undefined")


def test_notices_that_come_again_with_a_connection_are_listed_once(robot, open_page):
    page = open_page()
    notice = Notice(time.monotonic_ns(), 5, "only once")
    robot.publish(notice)
    page.get_by_text("only once").wait_for()
    robot.stop()
    wait_for(lambda: "No connection to the robot." in why(page), page)
    robot.start()
    robot.publish(notice)
    robot.notice(5, "another")
    page.get_by_text("another").wait_for()
    assert page.get_by_text("only once").count() == 1


def test_what_is_asked_without_a_connection_is_refused_at_once_and_never_done_later(
    robot, open_page
):
    page = open_page()
    robot.stop()
    wait_for(lambda: "No connection to the robot." in why(page), page)
    page.get_by_role("button", name="Auto", exact=True).click()
    page.get_by_role("alert").get_by_text("Auto: not sent: no connection").wait_for()
    robot.start()
    page.locator(".figure", has_text="Link").get_by_text("ms").wait_for()
    page.wait_for_timeout(300)
    assert robot.asked == []


def test_nothing_is_added_to_what_waits_in_a_slow_connection(robot, open_page):
    page = open_page()
    page.evaluate(
        "() => Object.defineProperty(WebSocket.prototype, 'bufferedAmount', { get: () => 1e5 })"
    )
    page.get_by_role("button", name="Auto", exact=True).click()
    page.get_by_role("alert").get_by_text("Auto: not sent").wait_for()
    assert robot.asked == []


def test_notices_are_kept_with_their_time_the_newest_first(robot, open_page):
    page = open_page()
    robot.notice(5, "an old notice")
    page.get_by_text("an old notice").wait_for()
    robot.notice(2, "a critical one")
    page.get_by_text("a critical one").wait_for()
    lines = page.locator(".notices li")
    assert [lines.nth(i).locator(".text").inner_text() for i in range(2)] == [
        "a critical one",
        "an old notice",
    ]
    assert page.get_by_label("critical").count() == 1
    assert ":" in lines.nth(0).locator("time").inner_text()


def test_the_token_leaves_the_address_bar_and_roles_are_kept(open_page, robot):
    guarded = ServedRobot({Role.LOOK: "l" * 32, Role.DRIVE: "d" * 32})
    try:
        page = open_page(url=f"{guarded.url}#token={'l' * 32}")
        assert page.url == guarded.url
        page.get_by_text("This link may look, and stop the robot").wait_for()
        assert page.get_by_role("button", name="Go to").is_disabled()
        page.keyboard.press("Space")
        wait_for(lambda: guarded.asked, page)
    finally:
        guarded.stop()


def test_without_a_token_the_page_says_what_is_missing(browser, robot):
    guarded = ServedRobot({Role.LOOK: "l" * 32, Role.DRIVE: "d" * 32})
    context = browser.new_context()
    try:
        page = context.new_page()
        page.goto(guarded.url)
        page.get_by_text("This page has no access to the robot.").wait_for()
    finally:
        context.close()
        guarded.stop()
