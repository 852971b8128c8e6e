"""The emergency stop of the page: always there, on a line of its own, and honest."""

from __future__ import annotations

import pytest

from robotctl.messages.control import EmergencyStop
from tests.web.page.served_robot import wait_for

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("how", ["pointer", "Enter", "space"])
def test_it_stops_at_once_and_shows_what_control_answered(robot, open_page, how):
    page = open_page()
    button = page.get_by_role("button", name="STOP")
    if how == "pointer":
        button.hover()
        page.mouse.down()  # as the finger comes down, not when it is lifted
    elif how == "Enter":
        button.press("Enter")
    else:
        page.get_by_role("button", name="Disarm").focus()
        page.keyboard.press("Space")
    wait_for(lambda: robot.requests(EmergencyStop), page)
    page.get_by_role("alert").get_by_text("Emergency stop after").wait_for()
    page.locator(".pill.state-EMERGENCY_STOP").wait_for()
    assert "Emergency stop (operator). When the way is clear, arm again." in " ".join(
        page.locator(".why").inner_text().split()
    )
    if how == "space":  # it pressed nothing else
        assert [type(each) for each in robot.asked] == [EmergencyStop]


def test_the_space_bar_stops_even_from_a_field_of_text(robot, open_page):
    page = open_page()
    page.get_by_role("tab", name="Plots").click()
    page.get_by_role("searchbox").type("v m")
    wait_for(lambda: robot.requests(EmergencyStop), page)
    assert page.get_by_role("searchbox").input_value() == "vm"


def test_it_says_when_control_does_not_answer(robot, open_page):
    page = open_page()
    robot.is_deaf = True
    page.keyboard.press("Space")
    page.get_by_role("alert").get_by_text("control has not answered").wait_for()
    robot.is_deaf = False  # the server repeats it
    page.get_by_role("alert").get_by_text("Emergency stop after").wait_for()
    assert len(robot.requests(EmergencyStop)) > 1


def test_it_works_while_everything_else_of_the_page_is_old(robot, open_page):
    page = open_page()
    robot.is_silent = True
    page.locator(".bar.stale").wait_for()
    page.keyboard.press("Space")
    wait_for(lambda: robot.requests(EmergencyStop), page)


def test_without_a_connection_it_says_so_and_stops_as_soon_as_there_is_one(robot, open_page):
    page = open_page()
    robot.stop()
    page.get_by_text("NO CONTACT").wait_for()
    page.keyboard.press("Space")
    page.get_by_role("alert").get_by_text("NOT sent").wait_for()
    assert robot.requests(EmergencyStop) == []
    robot.start()
    wait_for(lambda: robot.requests(EmergencyStop), page)
    page.get_by_role("alert").get_by_text("Emergency stop after").wait_for()
    page.get_by_text("works,").wait_for()
