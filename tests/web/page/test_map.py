"""The map: what is drawn where, what is shown, and what a click asks of the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.messages.control import ExternalPose, PositionTarget
from tests.web.page.drawn_map import on_page, pixels, show_only
from tests.web.page.served_robot import wait_for

pytestmark = pytest.mark.browser


def test_the_robot_is_drawn_where_it_is_and_moves_with_it(robot, open_page):
    page = open_page()
    show_only(page, "Map", "Robot")
    for x_m, y_m in ((2.0, 3.0), (5.5, 1.5)):
        robot.pose = (x_m, y_m, 0.0)
        wanted = on_page(page, x_m, y_m)

        def is_there(wanted=wanted):
            seen = pixels(page, "robot")
            return math.hypot(seen.x - wanted[0], seen.y - wanted[1]) < 12  # of 790

        wait_for(is_there, page)


def test_all_particles_are_drawn_where_they_are(robot, open_page):
    page = open_page()
    show_only(page, "Map", "Particles")
    assert pixels(page, "particle").count == 0
    rng = np.random.default_rng(1)
    corners = np.array([[1.0, 1.0, 0.0], [3.0, 2.0, 0.0]], np.float32)
    inner = np.column_stack([rng.uniform(1, 3, 1998), rng.uniform(1, 2, 1998), np.zeros(1998)])
    robot.particles = np.vstack([corners, inner.astype(np.float32)])
    seen = wait_for(lambda: (found := pixels(page, "particle")).count > 4000 and found, page)
    left, bottom = on_page(page, 1.0, 1.0)
    right, top = on_page(page, 3.0, 2.0)
    assert (seen.left, seen.right) == pytest.approx((left, right), abs=4)
    assert (seen.top, seen.bottom) == pytest.approx((top, bottom), abs=4)


@pytest.mark.parametrize(
    ("name", "colour"), [("Lidar scan", "scan"), ("Plan", "plan"), ("Moving", "person")]
)
def test_a_layer_is_drawn_only_while_it_is_shown_and_stays_so_over_a_reload(
    open_page, name, colour
):
    page = open_page()
    show_only(page, name)
    wait_for(lambda: pixels(page, colour).count > 50, page)
    show_only(page)
    wait_for(lambda: pixels(page, colour).count == 0, page)
    page.reload()
    page.locator(".figure", has_text="Link").get_by_text("ms").wait_for()
    assert page.locator("button.layer[aria-pressed=true]").count() == 0


def test_zoom_keeps_what_is_under_the_pointer_in_its_place(open_page):
    page = open_page()
    show_only(page, "Map")
    before = pixels(page, "wall")
    page.mouse.move(before.left + 2, before.bottom - 2)  # the lower left corner
    page.mouse.wheel(0, -200)
    wait_for(lambda: pixels(page, "wall").top < before.top - 20, page)
    after = pixels(page, "wall")
    assert (after.left, after.bottom) == pytest.approx((before.left, before.bottom), abs=3)


def test_follow_keeps_the_robot_in_the_middle(robot, open_page):
    page = open_page()
    show_only(page, "Robot")
    page.get_by_role("button", name="Follow").click()
    robot.pose = (7.0, 5.0, 1.0)
    box = page.locator(".map canvas").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)

    def is_in_the_middle():
        seen = pixels(page, "robot")
        return math.hypot(seen.x - middle[0], seen.y - middle[1]) < 15

    wait_for(is_in_the_middle, page)


def test_a_click_on_the_map_asks_for_that_place_and_a_drag_for_a_heading(robot, open_page):
    page = open_page()
    show_only(page, "Map", "Goal")
    x, y = on_page(page, 6.0, 2.0)
    page.mouse.click(x, y)  # looking only: a click does nothing
    page.get_by_role("button", name="Go to").click()
    page.mouse.click(x, y)
    (target,) = wait_for(lambda: robot.requests(PositionTarget), page)
    assert (target.x_m, target.y_m) == pytest.approx((6.0, 2.0), abs=0.05)
    assert target.heading_rad is None
    goal = wait_for(lambda: (found := pixels(page, "goal")).count > 20 and found, page)
    assert (goal.x, goal.y) == pytest.approx((x, y), abs=3)

    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 40, y - 40)
    page.mouse.up()
    target = wait_for(lambda: robot.requests(PositionTarget)[1:], page)[0]
    assert (target.x_m, target.y_m) == pytest.approx((6.0, 2.0), abs=0.05)
    assert target.heading_rad == pytest.approx(3 * math.pi / 4, abs=0.02)


def test_the_robot_can_be_placed_once_by_press_and_drag(robot, open_page):
    page = open_page()
    show_only(page, "Map")
    page.get_by_role("button", name="Place robot").click()
    x, y = on_page(page, 2.5, 4.0)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 50)
    page.mouse.up()
    (placed,) = wait_for(lambda: robot.requests(ExternalPose), page)
    assert (placed.x_m, placed.y_m) == pytest.approx((2.5, 4.0), abs=0.05)
    assert placed.theta_rad == pytest.approx(-math.pi / 2, abs=0.02)
    page.locator("button[aria-pressed=true]", has_text="Look").wait_for()
    page.mouse.click(x, y)
    page.wait_for_timeout(200)
    assert len(robot.requests(ExternalPose)) == 1


def test_a_place_can_be_chosen_by_keys_alone(robot, open_page):
    page = open_page()
    show_only(page, "Map")
    page.get_by_role("button", name="Go to").press("Enter")
    page.locator(".map canvas").focus()
    page.keyboard.press("Enter")
    (target,) = wait_for(lambda: robot.requests(PositionTarget), page)
    assert (target.x_m, target.y_m) == pytest.approx((4.0, 3.0), abs=0.05)  # the middle


def test_two_fingers_zoom_the_map(open_page):
    page = open_page(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    show_only(page, "Map")
    before = pixels(page, "wall")
    box = page.locator(".map canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    devtools = page.context.new_cdp_session(page)

    def touch(kind, apart):
        points = [{"x": x - apart, "y": y, "id": 1}, {"x": x + apart, "y": y, "id": 2}]
        points = [] if kind == "touchEnd" else points
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", 60)
    for apart in (50, 40, 30):
        touch("touchMove", apart)
    touch("touchEnd", 30)

    def is_half():
        after = pixels(page, "wall")
        return (after.right - after.left) / (before.right - before.left) == pytest.approx(0.5, 0.1)

    wait_for(is_half, page)
