"""Missions, zones, the fence, the SLAM graph and the camera's picture at the page."""

from __future__ import annotations

import time
import tomllib

import numpy as np
import pytest

from robotctl.messages.control import SetMode
from robotctl.messages.estimation import SlamGraph
from robotctl.messages.fence import SetFence
from robotctl.messages.mission import JumpToItem, LoadMission
from robotctl.messages.mode import Mode
from robotctl.messages.plans import SetZones
from robotctl.web.wire import CameraPicture
from tests.web.page.drawn_map import on_page, pixels, show_only
from tests.web.page.served_robot import press, wait_for

pytestmark = pytest.mark.browser

MISSION = """\
name = "rounds"   # of the guard
start = { x_m = 1.0, y_m = 1.0 }

[[item]]
kind = "goto"
name = "door"
x_m = 2.0
y_m = 2.0

[[item]]
kind = "wait"
duration_s = 3.0
"""


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def draw_mission(page, *points):
    page.get_by_role("tab", name="Mission").click()
    button(page, "New").click()
    for point in points:
        page.mouse.click(*on_page(page, *point))


def send(robot, page, count=1):
    """Send the mission, and return what navigation was given, as an independent reader has it."""
    # The first one loads what checks missions.
    press(page, "Send to robot", lambda: len(robot.requests(LoadMission)) == count, 20.0)
    return tomllib.loads(robot.requests(LoadMission)[-1].content.decode())


def places(mission):
    return [(each["x_m"], each["y_m"]) for each in mission["item"] if each["kind"] == "goto"]


def test_a_mission_of_two_points_is_drawn_sent_and_started(robot, open_page):
    page = open_page()
    draw_mission(page, (3.0, 2.0), (6.0, 4.0))
    mission = send(robot, page)
    assert np.allclose(places(mission), [(3.0, 2.0), (6.0, 4.0)], atol=0.03)
    assert mission["start"]["x_m"] == pytest.approx(2.0)  # where the robot stands
    page.get_by_text("The robot has it").wait_for()
    button(page, "Close").click()
    page.get_by_text("page: not under way").wait_for()
    press(page, "Start", lambda: [each.mode for each in robot.requests(SetMode)] == [Mode.AUTO])
    page.get_by_text("page: under way").wait_for()
    press(page, "Jump to item 2", lambda: [each.item for each in robot.requests(JumpToItem)] == [2])
    page.locator("li[aria-current=step]", has_text="2  ").wait_for()


def test_a_drag_gives_a_heading_and_moves_a_point_and_each_step_can_be_undone(robot, open_page):
    page = open_page()
    draw_mission(page)
    page.mouse.move(*on_page(page, 3.0, 2.0))
    page.mouse.down()
    page.mouse.move(*on_page(page, 3.0, 4.0))
    page.mouse.up()
    page.mouse.click(*on_page(page, 5.0, 2.0))
    page.mouse.move(*on_page(page, 5.0, 2.0))
    page.mouse.down()
    page.mouse.move(*on_page(page, 6.0, 3.0))
    page.mouse.up()
    button(page, "Earlier").click()
    mission = send(robot, page)
    assert np.allclose(places(mission), [(6.0, 3.0), (3.0, 2.0)], atol=0.05)
    assert mission["item"][1]["heading_deg"] == pytest.approx(90.0, abs=1.0)
    for _ in range(2):  # the order, and the motion
        button(page, "Undo").click()
    assert np.allclose(places(send(robot, page, 2)), [(3.0, 2.0), (5.0, 2.0)], atol=0.05)
    page.get_by_role("button", name="goto").first.click()
    button(page, "Delete").click()
    page.get_by_label("Add an item").select_option("wait")
    page.get_by_label("duration_s").fill("7.5")
    page.get_by_label("duration_s").press("Tab")
    mission = send(robot, page, 3)
    assert [each["kind"] for each in mission["item"]] == ["goto", "wait"]
    assert mission["item"][1]["duration_s"] == 7.5


@pytest.mark.parametrize(
    ("kind", "key", "value"), [("circle", "radius_m", 1.5), ("keep_distance", "distance_m", 0.8)]
)
def test_an_item_that_is_added_is_one_that_the_robot_takes(robot, open_page, kind, key, value):
    page = open_page()
    draw_mission(page, (3.0, 2.0))
    page.get_by_label("Add an item").select_option(kind)
    page.get_by_label(key).fill(str(value))
    page.get_by_label(key).press("Tab")
    item = send(robot, page)["item"][1]
    assert (item["kind"], item[key]) == (kind, value)


def test_what_is_wrong_with_a_mission_is_said_with_its_line(robot, open_page):
    page = open_page()
    draw_mission(page, (3.0, 2.0))
    page.get_by_label("speed_m_s").fill("-1")
    page.get_by_label("speed_m_s").press("Tab")
    button(page, "Send to robot").click()
    page.get_by_role("alert").get_by_text("mission.toml:8: item[0].speed_m_s").wait_for()
    assert robot.requests(LoadMission) == []


def test_a_file_is_opened_and_saved(robot, open_page, tmp_path):
    page = open_page()
    page.get_by_role("tab", name="Mission").click()
    page.get_by_label("Open file").set_input_files(
        {"name": "bad.toml", "mimeType": "", "buffer": b'name = "x"\nitem = = 3'}
    )
    page.get_by_role("alert").get_by_text("not valid TOML").filter(has_text="line 2").wait_for()
    page.get_by_label("Open file").set_input_files(
        {"name": "rounds.toml", "mimeType": "", "buffer": MISSION.encode()}
    )
    page.get_by_role("button", name="door goto 2, 2").wait_for()
    with page.expect_download() as download:
        button(page, "Save as file").click()
    download.value.save_as(tmp_path / "saved.toml")
    assert download.value.suggested_filename == "rounds.toml"
    assert tomllib.loads((tmp_path / "saved.toml").read_text()) == tomllib.loads(MISSION)


def test_the_robots_mission_is_drawn_wherever_it_is_from(robot, open_page):
    robot.mission = LoadMission(0, "/etc/rounds.toml", MISSION.encode())
    page = open_page()
    show_only(page, "Map", "Mission")
    seen = wait_for(lambda: (found := pixels(page, "mission")).count > 20 and found, page)
    at = on_page(page, 2.0, 2.0)
    assert seen.left - 3 <= at[0] <= seen.right
    assert seen.top <= at[1] <= seen.bottom


def draw_polygon(page, kind, *points, name="", speed=""):
    page.get_by_role("tab", name="Zones").click()
    button(page, "Draw a polygon").click()
    page.get_by_label("It is").select_option(label=kind)
    if name:
        page.get_by_label("Name").fill(name)
    if speed:
        page.get_by_label("Speed [m/s]").fill(speed)
        page.get_by_label("Speed [m/s]").press("Tab")
    for point in points:
        page.mouse.click(*on_page(page, *point))


TRIANGLE = ((4.0, 2.0), (6.0, 2.0), (5.0, 4.0))
AROUND = ((1.0, 2.0), (3.0, 2.0), (2.0, 4.5))
"""A triangle around the robot."""


def test_zones_are_drawn_kept_and_removed(robot, open_page):
    page = open_page()
    show_only(page, "Map", "Zones")
    draw_polygon(page, "a keep-out zone", *TRIANGLE, name="stairs")
    press(page, "Close", lambda: robot.requests(SetZones))
    (zone,) = robot.requests(SetZones)[-1].zones
    assert (zone.name, zone.speed_m_s, zone.origin) == ("stairs", 0.0, "map")
    assert np.allclose(zone.corners, TRIANGLE, atol=0.03)
    wait_for(lambda: pixels(page, "keepout").count > 100, page)
    draw_polygon(page, "a slow zone", *AROUND, name="kitchen", speed="0.15")
    press(page, "Close", page.get_by_text("kitchen: 0.15 m/s").is_visible)
    press(page, "Remove stairs", lambda: pixels(page, "keepout").count == 0)
    assert [each.name for each in robot.requests(SetZones)[-1].zones] == ["kitchen"]


def test_a_fence_is_drawn_and_who_stands_beyond_it_is_told_what_the_robot_does(robot, open_page):
    page = open_page()
    draw_polygon(page, "a fence to stay within", *TRIANGLE)
    page.get_by_text("The robot stands beyond this fence").wait_for()
    for _ in TRIANGLE:
        button(page, "Undo").click()
    for point in AROUND:
        page.mouse.click(*on_page(page, *point))
    page.get_by_text("3 corners").wait_for()
    press(page, "Close", lambda: robot.requests(SetFence))
    (polygon,) = robot.requests(SetFence)[-1].fence.polygons
    assert polygon.keeps_in
    assert np.allclose(polygon.corners, AROUND, atol=0.03)
    remove = "Remove Fence: stay within 3 corners"
    press(page, remove, lambda: robot.requests(SetFence)[-1].fence.is_empty)


def test_a_zone_around_the_robot_says_what_the_robot_does(open_page):
    page = open_page()
    draw_polygon(page, "a keep-out zone", *AROUND)
    page.get_by_text("leaves it first, by the shortest way").wait_for()


def test_the_graph_of_slam_is_drawn_with_its_loops(robot, open_page):
    page = open_page()
    show_only(page, "Map", "SLAM graph")
    poses = np.array([[1, 1, 0], [4, 1, 0], [4, 4, 0], [1, 4, 0]], np.float32)
    links = np.array([[0, 1], [1, 2], [2, 3]], "<i4").tobytes()
    loops = np.array([[3, 0]], "<i4").tobytes()
    robot.publish(SlamGraph(time.monotonic_ns(), poses.tobytes(), links, loops))
    loop = wait_for(lambda: (found := pixels(page, "loop")).count > 50 and found, page)
    assert loop.x == pytest.approx(on_page(page, 1.0, 2.5)[0], abs=3)
    assert pixels(page, "link").count > 50
    assert pixels(page, "keyframe").count >= 4 * 9


class Pictures:
    """A camera of a page, which counts who looks."""

    def __init__(self, jpeg):
        self.jpeg = jpeg
        self.asked_s = []
        self.is_open = False

    def picture(self, _view):
        self.is_open = True
        self.asked_s.append(time.monotonic())
        ends = ((10.0, 40.0), (50.0, 30.0), None, (70.0, 30.0))
        return CameraPicture(time.monotonic_ns(), 80, 60, self.jpeg, boundary=ends)

    def close(self):
        self.is_open = False


def test_the_cameras_picture_comes_at_most_five_times_a_second_while_its_panel_is_open(
    robot, open_page
):
    cv2 = pytest.importorskip("cv2")
    _, jpeg = cv2.imencode(".jpg", np.full((60, 80, 3), (200, 30, 30), np.uint8))
    robot.stop()
    robot.camera = camera = Pictures(jpeg.tobytes())
    robot.start()
    page = open_page()
    assert camera.asked_s == []
    page.get_by_role("tab", name="Camera").click()
    wait_for(lambda: len(camera.asked_s) > 10, page, 10.0)
    intervals = np.diff(camera.asked_s)
    assert intervals.mean() >= 0.199
    colour = page.evaluate("""() => {
      const canvas = document.querySelector(".camera canvas");
      return [...canvas.getContext("2d").getImageData(5, 55, 1, 1).data];
    }""")
    assert np.allclose(colour[:3], (30, 30, 200), atol=12)
    page.get_by_role("tab", name="Drive").click()
    wait_for(lambda: not camera.is_open, page)
    count = len(camera.asked_s)
    page.wait_for_timeout(600)
    assert len(camera.asked_s) == count
