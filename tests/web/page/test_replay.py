"""A recording in the page: the bar, the map, plots and notices of the time that is shown."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest

from tests.web.page.drawn_map import pixels
from tests.web.page.served_robot import wait_for
from tests.workbench.view.recorded import FAULT_S, SPEED_M_S, ServedReplay, pose_at, write_run

pytestmark = pytest.mark.browser
SECONDS = 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run") / "drive", SECONDS, files=2)


@pytest.fixture
def open_replay(browser):
    """Return a function that serves recordings and opens their page."""
    opened, errors = [], []

    def open_it(*paths, **settings):
        served = ServedReplay(*paths).__enter__()
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | settings)
        opened.append((served, context))
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
        page.goto(served.url)
        page.wait_for_function(
            "count => document.querySelectorAll('.replay-states:has(rect)').length === count",
            arg=len(paths),
        )
        return page

    yield open_it
    for served, context in opened:
        context.close()
        served.__exit__()
    assert errors == []


def scrub(page, at_s: float) -> None:
    """Move the slider, as a hand does, and wait until that time is shown."""
    slider = page.get_by_role("slider", name="Time of the recording")
    slider.fill(f"{at_s:.1f}")
    clock = page.locator(".replay-clock")
    wait_for(lambda: clock.inner_text().startswith(f"0:{at_s:04.1f}"), page)


def robot_x(page) -> float:
    """Return where the robot is drawn [m], by the walls of the room, 8 m apart."""
    # The scan is drawn about the robot: its beams are 1 m and some long all around.
    wall, robot = pixels(page, "wall"), pixels(page, "robot")
    return 8.0 * (robot.x - wall.left) / (wall.right - wall.left)


def test_a_scrub_shows_robot_path_state_and_notices_of_that_time(folder, open_replay):
    page = open_replay(folder)
    for name in ("Layers",):
        page.locator(".map-layers summary", has_text=name).click()
    for layer in ("Plan", "Path driven", "Particles", "Sonar", "Lidar scan", "Covariance", "Costs"):
        button = page.locator(".map-layers button", has_text=layer)
        if layer != "Path driven" and button.get_attribute("aria-pressed") == "true":
            button.click()
    page.locator(".map-layers summary").click()
    for at_s in (8.0, 19.0, 5.0):
        scrub(page, at_s)
        wanted = pose_at(at_s)[0]
        wait_for(lambda wanted=wanted: abs(robot_x(page) - wanted) < 0.15, page)
        trail = pixels(page, "trail")
        wall = pixels(page, "wall")
        length_m = 8.0 * (trail.right - trail.left) / (wall.right - wall.left)
        assert length_m == pytest.approx(wanted - pose_at(0.0)[0], abs=0.4)
        notices = page.locator(".notices li .text").all_inner_texts()
        state = "Fault" if at_s >= FAULT_S else "Driving"
        assert page.locator(".bar .pill").first.inner_text().endswith(state)
        told = ["Fault: the motor is hot", "the motor is hot"] if at_s >= FAULT_S else []
        assert sorted(notices) == sorted([*told, "it begins"])


def test_nothing_commands_a_robot_that_is_not_there(folder, open_replay):
    page = open_replay(folder)
    for name in ("Go to", "Place robot", "Arm", "Take the sticks"):
        assert page.get_by_role("button", name=name).count() == 0
    assert page.locator(".stop").count() == 0
    assert page.get_by_role("tab", name="Drive").count() == 0
    assert page.get_by_role("tab", name="Plots").count() == 1


def test_plots_are_of_the_whole_run_though_nothing_of_it_was_played(folder, open_replay):
    page = open_replay(folder)
    page.get_by_role("searchbox").fill("distance_m")
    page.get_by_role("button", name="Add ControlState.distance_m", exact=True).click()
    page.wait_for_timeout(500)  # until it is fetched
    with page.expect_download() as download:
        page.get_by_role("button", name="Save as CSV").click()
    with Path(download.value.path()).open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == SECONDS * 20
    for row in rows[::37]:
        at_s = float(row["robot_s"])
        assert float(row["ControlState.distance_m"]) == pytest.approx(at_s, abs=1e-4)
        assert float(row["ControlState.v_ref_m_s"]) == pytest.approx(math.sin(at_s), abs=1e-4)
        drives = 2.0 <= at_s < FAULT_S
        assert float(row["ControlState.v_m_s"]) == pytest.approx(SPEED_M_S if drives else 0.0)


def test_by_keys_alone_it_plays_pauses_and_moves(folder, open_replay):
    page = open_replay(folder)
    slider = page.get_by_role("slider", name="Time of the recording")
    slider.focus()
    page.keyboard.press("Home")
    wait_for(lambda: page.locator(".replay-clock").inner_text().startswith("0:00.0"), page)
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    wait_for(lambda: page.locator(".replay-clock").inner_text().startswith("0:00.3"), page)
    page.keyboard.press("End")
    wait_for(lambda: page.locator(".replay-clock").inner_text().startswith("0:19.9"), page)
    page.keyboard.press("PageDown")
    page.get_by_label("Speed").select_option("50 ×")
    slider.focus()
    page.keyboard.press("Space")
    wait_for(lambda: page.locator(".replay-clock").inner_text().startswith("0:19.9"), page)
    page.keyboard.press("Home")
    page.get_by_label("Speed").select_option("1 ×")
    slider.focus()
    page.keyboard.press("Space")
    page.get_by_role("button", name="Pause").wait_for()
    page.keyboard.press("Space")
    page.get_by_role("button", name="Play").wait_for()


def test_two_runs_beside_each_other_move_with_one_bar(folder, tmp_path, open_replay):
    short = write_run(tmp_path / "short", 10)
    page = open_replay(folder, short)
    frames = [page.frame_locator(f"iframe[title='Recording {number}']") for number in (1, 2)]
    for frame, name in zip(frames, ("drive", "short"), strict=True):
        frame.locator("h1", has_text=name).wait_for()
    scrub(page, 15.0)
    frames[0].locator(".pill.state-FAULT").wait_for()
    frames[1].locator(".pill.state-DRIVING").wait_for()  # its last state
    scrub(page, 1.0)
    frames[0].locator("h1").click()
    page.keyboard.press("Space")  # within a frame, which has no bar
    page.get_by_role("button", name="Pause").click()
    frames[0].get_by_role("searchbox").fill("charge")
    frames[0].get_by_role("button", name="Add ControlState.battery.charge").click()
    for frame in frames:  # fields are chosen for both
        frame.get_by_role("button", name="Remove ControlState.battery.charge").wait_for()


def test_on_a_phone_the_bar_is_in_reach_and_all_of_it_fits(folder, open_replay):
    page = open_replay(folder, viewport={"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    bar = page.locator(".replay").bounding_box()
    assert bar["y"] + bar["height"] == pytest.approx(844, abs=1)
    scrub(page, 12.0)
