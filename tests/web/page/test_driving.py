"""Driving by sticks: the dead man's handle, and everything that must let go."""

from __future__ import annotations

import time

import pytest

from robotctl.messages.control import ManualControl
from robotctl.messages.mode import Mode
from tests.web.page.served_robot import wait_for

pytestmark = pytest.mark.browser

PAD = """
window.virtualPad = { connected: true, id: "virtual pad", index: 0, mapping: "standard",
  timestamp: 0, axes: [0, 0, 0, 0],
  buttons: Array.from({ length: 16 }, () => ({ pressed: false, touched: false, value: 0 })) };
window.padLives = true;
navigator.getGamepads = () => {
  if (window.padLives) window.virtualPad.timestamp = performance.now();
  return [window.virtualPad, null, null, null];
};
"""
DEAD_MAN, STICK_UP = 5, 1


def take_sticks(page) -> None:
    page.get_by_role("button", name="Take the sticks").click()
    page.get_by_text("You have the sticks.").wait_for()


def press_until_it_drives(page, robot, press, release) -> None:
    """Press the dead-man key, and again as a person would where the machine stood meanwhile."""
    for _ in range(8):
        press()
        for _ in range(50):
            if robot.sticks:
                return
            page.wait_for_timeout(20)
        release()
        page.wait_for_timeout(200)
    raise AssertionError("it does not drive")


def drive(page, robot) -> None:
    """Drive ahead by keys."""
    page.keyboard.down("ArrowUp")
    keys = page.keyboard
    press_until_it_drives(page, robot, lambda: keys.down("Shift"), lambda: keys.up("Shift"))


def press_pad(page, robot) -> None:
    """Drive ahead by the virtual pad."""

    def hold(held: str) -> None:
        page.evaluate(f"() => {{ virtualPad.buttons[{DEAD_MAN}].pressed = {held}; }}")

    page.evaluate(f"() => {{ virtualPad.axes[{STICK_UP}] = -1; }}")
    press_until_it_drives(page, robot, lambda: hold("true"), lambda: hold("false"))


def assert_stopped(page, robot) -> None:
    """Wait until the robot has no sticks, and see that they do not come back by themselves."""
    wait_for(lambda: robot.sticks is None, page, 1.0)
    count = len([each for each in robot.requests(ManualControl) if each.forward])
    page.wait_for_timeout(400)
    assert len([each for each in robot.requests(ManualControl) if each.forward]) == count


def test_keys_drive_only_while_the_dead_man_key_is_held(robot, open_page):
    page = open_page()
    take_sticks(page)
    page.keyboard.down("w")
    assert_stopped(page, robot)
    drive(page, robot)
    assert robot.sticks == (0.5, 0.0)  # the share that Speed says
    assert robot.mode is Mode.MANUAL
    page.keyboard.up("Shift")
    wait_for(lambda: robot.sticks is None, page)
    page.keyboard.down("a")
    drive(page, robot)
    assert robot.sticks == (0.5, 0.5)
    begin_s = time.monotonic()
    page.keyboard.up("Shift")
    wait_for(lambda: robot.sticks is None, page)
    assert time.monotonic() - begin_s < 0.3


def test_nobody_drives_without_having_taken_the_sticks(robot, open_page):
    page = open_page()
    page.keyboard.down("Shift")
    page.keyboard.down("ArrowUp")
    page.wait_for_timeout(300)
    assert robot.requests(ManualControl) == []


def test_the_key_must_be_pressed_anew_after_the_sticks_were_taken(robot, open_page):
    page = open_page()
    page.keyboard.down("Shift")
    page.keyboard.down("ArrowUp")
    take_sticks(page)
    assert_stopped(page, robot)
    assert robot.requests(ManualControl) == [] or not robot.requests(ManualControl)[-1].forward


HIDE = """() => {
  Object.defineProperty(document, "hidden", { configurable: true, get: () => true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


@pytest.mark.parametrize(
    ("interrupt", "said"),
    [(HIDE, "the page was hidden"), ("() => dispatchEvent(new Event('blur'))", "lost the focus")],
)
def test_a_hidden_tab_and_a_lost_focus_let_go(robot, open_page, interrupt, said):
    page = open_page()
    take_sticks(page)
    drive(page, robot)
    page.evaluate(interrupt)
    assert_stopped(page, robot)
    page.get_by_text(said).wait_for()


def test_a_frozen_tab_lets_go(robot, open_page):
    page = open_page()
    take_sticks(page)
    drive(page, robot)
    page.evaluate("() => { const end = Date.now() + 1000; while (Date.now() < end); }")
    newest = [each for each in robot.requests(ManualControl) if each.forward][-1]
    assert time.monotonic_ns() - newest.expires_ns > 0.3e9


def test_a_key_that_is_held_over_a_reconnect_does_not_drive(robot, open_page):
    page = open_page()
    take_sticks(page)
    drive(page, robot)
    robot.stop()
    page.get_by_text("No connection to the robot.").wait_for()
    robot.asked.clear()
    robot.start()
    page.locator(".figure", has_text="Link").get_by_text("ms").wait_for()
    take_sticks(page)
    assert_stopped(page, robot)
    assert not any(each.forward for each in robot.requests(ManualControl))


def test_driving_locks_while_the_state_of_the_robot_is_old(robot, open_page):
    page = open_page()
    take_sticks(page)
    drive(page, robot)
    robot.is_silent = True
    page.get_by_text("Driving is locked").first.wait_for()
    assert_stopped(page, robot)


def test_a_pad_drives_while_its_samples_live(robot, open_page):
    page = open_page(PAD)
    take_sticks(page)
    page.evaluate(f"() => {{ virtualPad.axes[{STICK_UP}] = -1; }}")
    page.wait_for_timeout(100)
    assert robot.sticks is None
    press_pad(page, robot)
    assert robot.sticks == (0.5, 0.0)
    for _ in range(8):  # for three times as long as a pad may stand still, unless the machine stood
        page.wait_for_timeout(600)
        if robot.sticks:
            break
        page.evaluate(f"() => {{ virtualPad.buttons[{DEAD_MAN}].pressed = false; }}")
        press_pad(page, robot)
    else:
        raise AssertionError("it does not go on driving")
    page.evaluate(f"() => {{ virtualPad.buttons[{DEAD_MAN}].pressed = false; }}")
    wait_for(lambda: robot.sticks is None, page)


def test_a_pad_whose_sample_stands_still_lets_go(robot, open_page):
    page = open_page(PAD)
    take_sticks(page)
    press_pad(page, robot)
    begin_s = time.monotonic()
    page.evaluate("() => { padLives = false; }")
    wait_for(lambda: robot.sticks is None, page)
    assert time.monotonic() - begin_s < 0.6
    page.get_by_text("the gamepad sends the same over and over").wait_for()
    page.evaluate("() => { padLives = true; }")  # back, and still held: not without a fresh edge
    assert_stopped(page, robot)


def test_the_mapping_of_the_pad_is_shown_learnt_kept_and_reset(robot, open_page):
    page = open_page(PAD)
    page.locator(".pad summary").click()
    row = page.locator(".pad tr", has_text="Dead-man key")
    assert "button 5" in row.inner_text()
    row.get_by_role("button").click()
    page.evaluate("() => { virtualPad.buttons[7].pressed = true; }")
    row.get_by_text("button 7").wait_for()
    page.reload()
    page.locator(".pad summary").click()
    row.get_by_text("button 7").wait_for()
    page.get_by_role("button", name="Reset the mapping").click()
    row.get_by_text("button 5").wait_for()


def test_a_finger_on_the_joystick_drives(robot, open_page):
    page = open_page(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    take_sticks(page)
    stick = page.get_by_label("Joystick: hold and move to drive")
    stick.scroll_into_view_if_needed()
    box = stick.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    devtools = page.context.new_cdp_session(page)

    def touch(kind, *points):
        points = [{"x": x, "y": y} for x, y in points]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def press():
        touch("touchStart", (x, y - 50))
        touch("touchMove", (x, y - 120))

    press_until_it_drives(page, robot, press, lambda: touch("touchEnd"))
    wait_for(
        lambda: robot.requests(ManualControl)[-1].forward == pytest.approx(0.5, abs=0.01), page
    )
    touch("touchEnd")
    wait_for(lambda: robot.sticks is None, page)


def test_two_clients_hand_the_sticks_over_by_asking(robot, open_page):
    first, second = open_page(), open_page()
    take_sticks(first)
    drive(first, robot)
    second.get_by_role("button", name="Ask for the sticks").click()
    first.get_by_text("asks for the sticks").wait_for()
    first.get_by_role("button", name="Give them to").click()
    second.get_by_text("You have the sticks.").wait_for()
    assert_stopped(second, robot)
