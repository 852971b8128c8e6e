"""The panels Tune and Set up."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from scipy import signal

from robotctl.errors import ConfigError
from robotctl.messages.control import SafetyState
from robotctl.messages.tuning import SetParameter
from tests.web.page.node_program import node_program
from tests.web.page.served_robot import wait_for
from tests.web.page.test_driving import assert_stopped, press_until_it_drives, take_sticks

RESPONSE = """
function answer(line) {
  return JSON.stringify(part.coursesOf(JSON.parse(line)).map(part.figuresOf));
}
"""


def open_tab(page, name):
    page.get_by_role("tab", name=name).click()


def field(page, name):
    page.get_by_label("Find a parameter").fill(name)
    return page.get_by_role("textbox", name=name)


def value(robot, name):
    parameters = robot.parameters
    return parameters.value(parameters.parameters[parameters.index_of(name)])


@pytest.mark.browser
def test_a_value_is_set_by_enter_marked_and_undone(robot, open_page):
    page = open_page()
    open_tab(page, "Tune")
    kp = field(page, "CTL_L_KP")
    kp.fill("0.7")
    assert value(robot, "CTL_L_KP") == 0.65  # not before Enter
    kp.press("Enter")
    wait_for(lambda: value(robot, "CTL_L_KP") == 0.7, page)
    page.locator(".parameter.changed", has_text="CTL_L_KP").wait_for()
    assert tomllib.loads(page.locator(".patch").inner_text()) == {"control": {"left": {"kp": 0.7}}}
    kp.fill("0.8")
    kp.press("Enter")
    for back in (0.7, 0.65):
        page.get_by_role("button", name=f"Undo: CTL_L_KP back to {back}").click()
        wait_for(lambda back=back: value(robot, "CTL_L_KP") == back, page)
    assert page.get_by_role("button", name="Undo", exact=True).is_disabled()
    assert page.locator(".parameter.changed").count() == 0


@pytest.mark.browser
def test_keys_step_the_value_and_escape_gives_it_up(robot, open_page):
    page = open_page()
    open_tab(page, "Tune")
    kp = field(page, "CTL_L_KP")
    for key, shown in [("ArrowUp", "0.66"), ("ArrowUp", "0.67"), ("PageUp", "0.77")]:
        kp.press(key)
        wait_for(lambda shown=shown: kp.input_value() == shown, page)
    kp.press("Escape")
    wait_for(lambda: kp.input_value() == "0.65", page)
    kp.press("ArrowDown")
    kp.press("Enter")
    wait_for(lambda: value(robot, "CTL_L_KP") == 0.64, page)
    assert [each.value for each in robot.requests(SetParameter)] == [0.64]


@pytest.mark.browser
def test_what_is_refused_says_so_and_the_field_shows_the_value_in_force(robot, open_page):
    page = open_page()
    open_tab(page, "Tune")
    kp = field(page, "CTL_L_KP")
    kp.fill("200")
    kp.press("Enter")
    page.get_by_role("alert").get_by_text("0 to 100 allowed").wait_for()
    wait_for(lambda: kp.input_value() == "0.65", page)
    kp.fill("much")
    kp.press("Enter")
    page.get_by_role("alert").get_by_text("much is no number").wait_for()
    assert value(robot, "CTL_L_KP") == 0.65


@pytest.mark.browser
def test_what_a_ground_station_sets_appears_at_once_and_all_goes_back(robot, open_page):
    page = open_page()
    open_tab(page, "Tune")
    robot.set("CTL_R_KI", 5.0)
    robot.set("LIM_A_MAX", 2.6)
    page.get_by_role("button", name="Only changed (2)").click()
    assert page.get_by_role("textbox", name="CTL_R_KI").input_value() == "5"
    page.get_by_text("2.5 until a restart").wait_for()
    assert tomllib.loads(page.locator(".patch").inner_text()) == {
        "control": {"right": {"ki": 5.0}},
        "limits": {"a_max_m_s2": 2.6},
    }
    page.get_by_role("button", name="All back to the file's").click()
    wait_for(lambda: robot.parameters.changes() == {}, page)


@pytest.mark.browser
def test_the_patch_is_downloaded_and_the_file_written_after_a_question(robot, open_page):
    page = open_page()
    open_tab(page, "Tune")
    robot.set("CTL_L_KP", 1.0)
    robot.set("FS_GCS_HOLD", 1.0 - value(robot, "FS_GCS_HOLD"))
    page.get_by_role("button", name="Only changed (2)").wait_for()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download as TOML").click()
    found = tomllib.loads(download.value.path().read_text())
    assert found["control"]["left"] == {"kp": 1.0}
    assert type(found["control"]["left"]["kp"]) is float
    assert found["mavlink"] == {"hold_on_gcs_loss": bool(value(robot, "FS_GCS_HOLD"))}
    page.get_by_role("button", name="Save into the robot's file").click()
    page.get_by_text("Write 2 values into /etc/robotctl/tester.toml?").wait_for()
    assert robot.saved == []
    page.get_by_role("button", name="Write", exact=True).click()
    page.get_by_text("written into tester.toml; the old file is tester.toml.~1~").wait_for()
    assert robot.saved[0]["control.left.kp"] == 1.0
    robot.why_not_saved = ConfigError("tester.toml: has changed since the robot started")
    page.get_by_role("button", name="Save into the robot's file").click()
    page.get_by_role("button", name="Write", exact=True).click()
    page.get_by_role("alert").get_by_text("has changed since").wait_for()


@pytest.mark.browser
def test_a_step_asks_first_runs_while_held_and_ends_with_its_button(robot, open_page):
    page = open_page()
    open_tab(page, "Tune")
    begin = page.get_by_role("button", name="Step …")
    assert begin.is_disabled()  # who has no sticks moves nothing
    open_tab(page, "Drive")
    take_sticks(page)
    open_tab(page, "Tune")
    begin.click()
    page.get_by_text("The wheels will turn: is the robot on blocks").wait_for()
    page.wait_for_timeout(200)
    assert robot.sticks is None
    page.get_by_role("button", name="Cancel").click()

    def press() -> None:
        begin.click()
        page.get_by_role("button", name="Yes: hold to run").hover()
        page.mouse.down()

    press_until_it_drives(page, robot, press, page.mouse.up)
    assert robot.sticks == (0.3, 0.0)  # a share of the greatest speed
    page.mouse.up()
    assert_stopped(page, robot)
    begin.wait_for()
    figures = page.get_by_role("table", name="Figures of the step")
    for _ in range(8):  # where the machine stands meanwhile, the server lets go
        press()
        begin.wait_for()
        page.wait_for_timeout(500)
        if figures.is_visible():
            break
        page.mouse.up()
    figures.wait_for()
    assert_stopped(page, robot)  # by itself, though the button is still held
    page.get_by_role("img", name="Set-point and measured speed").wait_for()


@pytest.mark.browser
def test_the_key_that_holds_a_step_ends_it(robot, open_page):
    page = open_page()
    take_sticks(page)
    open_tab(page, "Tune")

    def press() -> None:
        page.get_by_role("button", name="Step …").press("Enter")
        page.get_by_role("button", name="Yes: hold to run").focus()
        page.keyboard.down("Enter")

    press_until_it_drives(page, robot, press, lambda: page.keyboard.up("Enter"))
    page.keyboard.press("Space")
    wait_for(lambda: robot.state is SafetyState.EMERGENCY_STOP, page)
    page.keyboard.up("Enter")
    assert_stopped(page, robot)


@pytest.mark.browser
def test_a_robot_that_is_not_armed_makes_no_step(robot, open_page):
    page = open_page()
    take_sticks(page)
    robot.state = SafetyState.STANDBY
    open_tab(page, "Tune")
    page.get_by_text("Arm first.").wait_for()
    assert page.get_by_role("button", name="Step …").is_disabled()


def second_order(zeta, omega=12.0, rate_hz=50.0):
    """Return times [s] and the unit step response of a second-order system, by scipy."""
    times = np.arange(0.0, 2.0, 1.0 / rate_hz)
    system = signal.TransferFunction([omega**2], [1.0, 2.0 * zeta * omega, omega**2])
    return signal.step(system, T=times)


@pytest.mark.node
@pytest.mark.parametrize("zeta", [0.3, 0.5, 0.7, 1.0])
@pytest.mark.parametrize("speed", [-3.0, 6.0])
def test_figures_are_those_of_a_second_order_system(tmp_path, zeta, speed):
    import json

    times, response = second_order(zeta)
    fine, finely = second_order(zeta, rate_hz=5000.0)
    still = [[0.0, 0.0]] * 25
    begin_ns = 7_000_000_000
    asked = {
        "stamp_ns": [begin_ns + round(20e6 * i) for i in range(25 + len(times) + 30)],
        "wheel_ref_rad_s": still + [[speed, speed]] * len(times) + [[0.0, 0.0]] * 30,
        "wheel_rad_s": still
        + [[speed * each, 0.9 * speed * each] for each in response]
        + [[0.0, 0.0]] * 30,
    }
    with node_program("tune/response.ts", RESPONSE, tmp_path) as program:
        first, second = program.ask(json.dumps(asked))
    rise_s = fine[np.argmax(finely >= 0.9)] - fine[np.argmax(finely >= 0.1)]
    overshoot = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)) if zeta < 1.0 else 0.0
    assert first["riseS"] == pytest.approx(rise_s, abs=0.01)
    assert first["overshoot"] == pytest.approx(overshoot, abs=0.02)
    assert first["steadyError"] == pytest.approx(0.0, abs=0.01 * abs(speed))
    assert second["steadyError"] == pytest.approx(0.1 * speed, abs=0.01 * abs(speed))
    assert second["overshoot"] == pytest.approx(max(0.0, 0.9 * (1 + overshoot) - 1), abs=0.02)


def begin_step(page, title):
    step = page.get_by_role("listitem", name=title)
    step.get_by_role("button", name="Begin").click()
    step.get_by_text("waiting for it").wait_for()
    return step


@pytest.mark.browser
def test_a_wheel_that_counts_forward_is_ok_and_one_that_counts_back_names_the_line(
    robot, open_page
):
    page = open_page()
    open_tab(page, "Set up")
    left = begin_step(page, "The left wheel counts forward")
    robot.wheel_distance_m = (0.1, 0.0)
    left.get_by_text("ok", exact=True).wait_for()
    assert "+0.100 m" in left.inner_text()
    right = begin_step(page, "The right wheel counts forward")
    robot.wheel_distance_m = (0.1, -0.1)
    right.get_by_text("wrong", exact=True).wait_for()
    assert "reversed = true" in right.inner_text()
    right.get_by_role("button", name="Again").click()
    robot.wheel_distance_m = (0.3, -0.1)
    right.get_by_text("Another wheel counted").wait_for()
    assert "ok" in left.inner_text()


@pytest.mark.browser
def test_ten_turns_that_are_eleven_give_the_counts_of_the_encoder(robot, open_page):
    page = open_page()
    open_tab(page, "Set up")
    step = begin_step(page, "Ten turns are ten turns")
    robot.wheel_distance_m = (11 * 2 * math.pi * 0.05, 0.0)
    step.get_by_text("11.00 turns").wait_for()
    step.get_by_role("button", name="Done").click()
    step.get_by_text("counts_per_revolution = 2640").wait_for()


@pytest.mark.browser
@pytest.mark.parametrize(
    ("gyro", "heading", "seen"), [(1, 1, "ok"), (-1, 1, "[imu]"), (1, -1, "[[motor]]")]
)
def test_left_is_left_for_gyro_and_wheels(robot, open_page, gyro, heading, seen):
    robot.imu_rate_rad_s = 0.0
    page = open_page()
    open_tab(page, "Set up")
    step = begin_step(page, "Left is left")
    robot.imu_rate_rad_s = gyro * 2.0
    for tenth in range(1, 15):
        x_m, y_m, _ = robot.pose
        robot.pose = (x_m, y_m, heading * 0.1 * tenth)
        page.wait_for_timeout(50)
    step.get_by_text(seen).wait_for()


@pytest.mark.browser
def test_a_hand_is_seen_by_its_sonar(robot, open_page):
    page = open_page()
    open_tab(page, "Set up")
    step = begin_step(page, "Sonar front")
    robot.sonar_m = (0.2,)
    step.get_by_text("ok", exact=True).wait_for()


@pytest.mark.browser
@pytest.mark.parametrize(("meter", "seen"), [("12.2", "ok"), ("24", "wrong")])
def test_the_battery_is_compared_with_a_meter(robot, open_page, meter, seen):
    page = open_page()
    open_tab(page, "Set up")
    step = begin_step(page, "Battery")
    step.get_by_label("Meter [V]").fill(meter)
    step.get_by_label("Meter [V]").press("Enter")
    step.get_by_text(seen, exact=True).wait_for()


@pytest.mark.browser
def test_the_stop_button_is_seen(robot, open_page):
    page = open_page()
    open_tab(page, "Set up")
    step = begin_step(page, "Emergency stop")
    robot.state = SafetyState.EMERGENCY_STOP
    step.get_by_text("ok", exact=True).wait_for()
