"""The adapter: which requests of other processes reach the navigator."""

import math
from pathlib import Path

import msgspec
import pytest

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, find_file, load_robot
from robotctl.core.navigation_adapter import STATE_MAX_AGE_NS
from robotctl.core.station_watch import PRESENCE_MAX_AGE_NS
from robotctl.messages.control import (
    GroundStationPresence,
    LoopStatistics,
    ManualControl,
    Mode,
    NavigationRequest,
    NavigationState,
    PositionTarget,
    SafetyState,
    SetMode,
    VelocityCommand,
    VelocityTarget,
)
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.fence import SetFence
from robotctl.messages.requests import REQUEST_LIFE_NS
from robotctl.model.fence import Fence, FencePolygon
from robotctl.model.geometry.localisation import LocalisationStatus

CONFIG = load_robot(find_file("diff_drive"))
STATE = make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics())
MISSION = """
name = "ahead"
world = "flat"
start = { x_m = 0.0, y_m = 0.0 }
[[item]]
kind = "drive"
waypoints = [[0.0, 0.0], [9.0, 0.0]]
"""
LATE_NS = REQUEST_LIFE_NS + 1
HANG_NS = 4_500_000_000


class Armed:
    """A adapter of an armed robot that stands on a free floor."""

    def __init__(self, mission: Path, config: RobotConfig = CONFIG) -> None:
        mission.write_text(MISSION)
        self.adapter = make_navigation(config, StackOptions("x", "", mission=str(mission)))
        self.now_ns = 10**12
        self.armings = 1
        self.enabled = True
        self.front_m = math.inf
        self.stamp_ns: int | None = None
        self.theta_rad = 0.0
        self.step()

    def step(
        self,
        *requests: NavigationRequest,
        pause_ns: int = 0,
        age_ns: int = 0,
        late_ns: int = 0,
        localisation: LocalisationState | None = None,
    ) -> tuple[VelocityCommand, NavigationState]:
        """Step once, `pause_ns` later than is due, by a state of control of this age."""
        self.now_ns += self.adapter.period_ns + pause_ns
        control = msgspec.structs.replace(
            STATE,
            stamp_ns=self.now_ns - age_ns,
            state=SafetyState.ARMED if self.enabled else SafetyState.STANDBY,
            armings=self.armings,
            v_m_s=0.0,
            omega_rad_s=0.0,
            vy_m_s=0.0,
            sonar_m=(self.front_m, *(math.inf,) * (len(CONFIG.sonar) - 1)),
            sonar_stamp_ns=(self.stamp_ns or self.now_ns,) * len(CONFIG.sonar),
            theta_rad=self.theta_rad,
        )
        return self.adapter.step(control, localisation, requests, self.now_ns, late_ns=late_ns)

    def next_ns(self) -> int:
        """Return the time of the next step that is in time."""
        return self.now_ns + self.adapter.period_ns


@pytest.fixture
def armed(tmp_path: Path) -> Armed:
    return Armed(tmp_path / "mission.toml")


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED, Mode.MANUAL])
def test_a_mode_that_waited_for_longer_than_its_life_is_dropped(armed: Armed, mode: Mode) -> None:
    _, state = armed.step(SetMode(armed.next_ns() - LATE_NS, mode))
    assert state.mode is Mode.HOLD
    _, state = armed.step(SetMode(armed.next_ns() - REQUEST_LIFE_NS, mode))
    assert state.mode is mode
    assert armed.adapter.take_notices() == ["1 request for a mode or position dropped: 1.0 s old"]


def test_hold_is_taken_however_old_it_is(armed: Armed) -> None:
    command, state = armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    assert command.v_m_s > 0.0
    command, state = armed.step(SetMode(1, Mode.HOLD))
    assert (command.v_m_s, state.mode) == (0.0, Mode.HOLD)
    assert armed.adapter.take_notices() == []


def test_a_position_that_waited_for_longer_than_its_life_is_dropped(armed: Armed) -> None:
    armed.step(SetMode(armed.next_ns(), Mode.GUIDED))
    command, _ = armed.step(PositionTarget(armed.next_ns() - LATE_NS, 3.0, 0.0))
    assert command.v_m_s == 0.0
    command, _ = armed.step(PositionTarget(armed.next_ns() - REQUEST_LIFE_NS, 3.0, 0.0))
    assert command.v_m_s > 0.0


def test_what_was_asked_for_while_navigation_hung_does_not_move_the_robot(armed: Armed) -> None:
    """Telemetry has answered "temporarily rejected" long before navigation goes on."""
    asked_ns = armed.next_ns()
    guided = (SetMode(asked_ns, Mode.GUIDED), PositionTarget(asked_ns + 1, 3.0, 0.0))
    command, state = armed.step(SetMode(asked_ns, Mode.AUTO), *guided, pause_ns=HANG_NS)
    for _ in range(3):
        assert (command.v_m_s, command.omega_rad_s, state.mode) == (0.0, 0.0, Mode.HOLD)
        command, state = armed.step()
    assert armed.adapter.take_notices() == ["3 requests for a mode or position dropped: 4.5 s old"]
    assert armed.adapter.take_notices() == []


@pytest.mark.parametrize(
    ("pause_ns", "late_ns", "cause"),
    [
        (0, 0, "no messages from control for 0.2 s"),
        (0, 80_000_000, "navigation was kept from the processor (80 ms late) for 0.2 s"),
        (
            2_000_000_000,
            2_000_000_000,
            "navigation was held up (kept from the processor, or stopped) for 6.2 s",
        ),
    ],
)
def test_while_nothing_is_heard_of_control_the_robot_stands_and_says_why(
    armed: Armed, pause_ns: int, late_ns: int, cause: str
) -> None:
    command, state = armed.step(SetMode(armed.next_ns(), Mode.AUTO), age_ns=STATE_MAX_AGE_NS)
    assert command.v_m_s > 0.0
    for _ in range(3):
        command, state = armed.step(pause_ns=pause_ns, age_ns=STATE_MAX_AGE_NS + 1, late_ns=late_ns)
        assert (command.v_m_s, command.omega_rad_s) == (0.0, 0.0)
    for _ in range(20):
        command, state = armed.step()
        assert (command.v_m_s, command.omega_rad_s) == (0.0, 0.0)
    goes_on = not pause_ns
    assert state.message == f"{'waits' if goes_on else 'hold'}: {cause}"
    command, state = armed.step()
    assert state.mode is (Mode.AUTO if goes_on else Mode.HOLD)
    assert (command.v_m_s > 0.0) == goes_on
    told = f"{cause}; the robot goes on" if goes_on else f"hold: {cause}"
    assert told in armed.adapter.take_notices()


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_a_mode_that_was_asked_for_before_a_stop_is_not_taken_behind_it(
    armed: Armed, mode: Mode
) -> None:
    armed.enabled = False
    _, state = armed.step(SetMode(armed.now_ns + 1, mode))
    assert (state.mode, state.message) == (Mode.HOLD, "refused: the robot was stopped")
    _, state = armed.step(SetMode(armed.next_ns(), mode))  # who asks now knows of the stop
    assert state.mode is mode


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED])
@pytest.mark.parametrize("armed_again", [False, True])
def test_a_mode_of_before_a_stop_that_arrives_later_than_the_stop_is_not_taken(
    armed: Armed, mode: Mode, armed_again: bool
) -> None:
    asked_ns = armed.next_ns()
    armed.step()
    armed.enabled = False
    armed.step()
    if armed_again:
        armed.enabled, armed.armings = True, armed.armings + 1
        armed.step()
    command, state = armed.step(SetMode(asked_ns, mode))
    assert (state.mode, state.message) == (Mode.HOLD, "refused: the robot was stopped")
    assert (command.v_m_s, command.omega_rad_s) == (0.0, 0.0)
    _, state = armed.step(SetMode(armed.now_ns, mode))
    assert state.mode is mode


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.MANUAL])
def test_modes_in_which_the_operator_drives_are_taken_however_old_the_stop(
    armed: Armed, mode: Mode
) -> None:
    asked_ns = armed.next_ns()
    armed.enabled = False
    armed.step()
    _, state = armed.step(SetMode(asked_ns, mode))
    assert state.mode is mode


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_a_mode_asked_for_between_a_stop_and_an_arming_that_showed_in_no_state_is_not_taken(
    armed: Armed, mode: Mode
) -> None:
    armed.armings += 1
    command, state = armed.step(SetMode(armed.now_ns + 1, mode))
    assert (command.v_m_s, state.mode) == (0.0, Mode.HOLD)


def test_a_stop_while_the_place_is_no_number_ends_the_mode_too(armed: Armed) -> None:
    command, _ = armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    assert command.v_m_s > 0.0
    armed.theta_rad = math.nan
    _, state = armed.step()
    assert (state.mode, state.message) == (Mode.AUTO, "no valid pose or velocity")
    armed.enabled = False
    armed.step()
    armed.theta_rad, armed.enabled, armed.armings = 0.0, True, armed.armings + 1
    command, state = armed.step()
    assert (command.v_m_s, state.mode) == (0.0, Mode.HOLD)


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_a_robot_stopped_and_armed_again_between_two_states_does_not_drive_on(
    armed: Armed, mode: Mode
) -> None:
    armed.step(SetMode(armed.next_ns(), mode))
    if mode is Mode.GUIDED:
        armed.step(PositionTarget(armed.next_ns(), 3.0, 0.0))
    armed.armings += 1
    for _ in range(3):
        command, state = armed.step()
        assert (command.v_m_s, command.omega_rad_s, state.mode) == (0.0, 0.0, Mode.HOLD)
    assert state.message == "hold: the robot was stopped"
    command, _ = armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    assert command.v_m_s > 0.0


@pytest.fixture
def attended(tmp_path: Path) -> Armed:
    """A robot that drives by itself only while a ground station is there."""
    overrides = ("mavlink.hold_without_gcs=true", 'mavlink.link=[{url="udpin:127.0.0.1:0"}]')
    return Armed(tmp_path / "mission.toml", load_robot(find_file("diff_drive"), overrides))


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_without_the_ground_station_that_it_needs_a_robot_holds(
    attended: Armed, mode: Mode
) -> None:
    _, state = attended.step(SetMode(attended.next_ns(), mode))
    assert (state.mode, state.message) == (Mode.HOLD, "refused: no ground station is connected")
    last_ns = attended.next_ns()
    wish = SetMode(last_ns, mode)
    _, state = attended.step(wish, GroundStationPresence(last_ns))
    assert state.mode is mode
    while attended.next_ns() - last_ns <= PRESENCE_MAX_AGE_NS:
        _, state = attended.step()
        assert state.mode is mode
    for _ in range(3):
        command, state = attended.step()
        assert (command.v_m_s, command.omega_rad_s, state.mode) == (0.0, 0.0, Mode.HOLD)
    assert state.message == "hold: no ground station is connected"
    _, state = attended.step(GroundStationPresence(attended.next_ns()))
    assert state.mode is Mode.HOLD  # nothing goes on by itself


def test_a_robot_that_needs_a_ground_station_is_driven_by_hand_without(attended: Armed) -> None:
    attended.step(SetMode(attended.next_ns(), Mode.MANUAL))
    for _ in range(2 * PRESENCE_MAX_AGE_NS // attended.adapter.period_ns):
        now_ns = attended.next_ns()
        sticks = ManualControl(now_ns, now_ns + 10**8, 0.5, 0.0)
        command, state = attended.step(sticks)
    assert state.mode is Mode.MANUAL
    assert command.v_m_s > 0.0


def test_a_mode_chosen_before_does_not_begin_when_a_robot_is_armed_unattended(
    attended: Armed,
) -> None:
    now_ns = attended.next_ns()
    attended.enabled = False
    attended.step(SetMode(now_ns, Mode.AUTO), GroundStationPresence(now_ns))
    attended.enabled = True
    command, state = attended.step(pause_ns=PRESENCE_MAX_AGE_NS)
    assert (command.v_m_s, state.mode) == (0.0, Mode.HOLD)


def hear(armed: Armed, heard_ns: int) -> GroundStationPresence:
    return GroundStationPresence(armed.next_ns(), heard_ns)


TIMEOUT_NS = round(CONFIG.mavlink.gcs_timeout_s * 1e9)


@pytest.mark.parametrize("telemetry_lives", [True, False])
def test_a_robot_holds_once_when_a_ground_station_that_was_there_is_lost(
    armed: Armed, telemetry_lives: bool
) -> None:
    heard_ns = armed.next_ns()
    armed.step(SetMode(heard_ns, Mode.AUTO), hear(armed, heard_ns))
    while armed.next_ns() - heard_ns <= TIMEOUT_NS:
        command, state = armed.step(*[hear(armed, heard_ns)] * telemetry_lives)
        assert state.mode is Mode.AUTO
    command, state = armed.step()
    assert (command.v_m_s, state.mode) == (0.0, Mode.HOLD)
    assert armed.adapter.take_notices() == ["hold: the ground station is lost"]
    # Somebody else may drive on, whatever telemetry still says of the lost one.
    command, state = armed.step(SetMode(armed.next_ns(), Mode.AUTO), hear(armed, heard_ns))
    assert state.mode is Mode.AUTO
    assert command.v_m_s > 0.0
    # It comes back, and is lost again.
    heard_ns = armed.next_ns()
    armed.step(hear(armed, heard_ns))
    while armed.next_ns() - heard_ns <= TIMEOUT_NS:
        assert armed.step()[1].mode is Mode.AUTO
    assert armed.step()[1].mode is Mode.HOLD


def test_the_loss_of_a_station_stops_nobody_who_is_told_so_or_has_the_stick(tmp_path: Path) -> None:
    overrides = ("mavlink.hold_on_gcs_loss=false",)
    config = load_robot(find_file("diff_drive"), overrides)
    for mode, robot in ((Mode.AUTO, config), (Mode.MANUAL, CONFIG)):
        armed = Armed(tmp_path / "mission.toml", robot)
        heard_ns = armed.next_ns()
        armed.step(SetMode(heard_ns, mode), hear(armed, heard_ns))
        while armed.next_ns() - heard_ns <= TIMEOUT_NS + 10**9:
            assert armed.step()[1].mode is mode


def test_a_robot_that_never_heard_a_ground_station_needs_none(armed: Armed) -> None:
    begin_ns = armed.next_ns()
    armed.step(SetMode(begin_ns, Mode.AUTO))
    while armed.next_ns() - begin_ns <= TIMEOUT_NS + 10**9:
        assert armed.step()[1].mode is Mode.AUTO


def test_a_command_of_sticks_or_a_set_point_is_void_when_they_are(armed: Armed) -> None:
    now_ns = armed.next_ns()
    command, _ = armed.step(
        SetMode(now_ns, Mode.MANUAL), ManualControl(now_ns, now_ns + 70_000_000, 0.5, 0.0)
    )
    assert command.expires_ns == now_ns + 70_000_000
    now_ns = armed.next_ns()
    command, _ = armed.step(
        SetMode(now_ns, Mode.GUIDED), VelocityTarget(now_ns, now_ns + 60_000_000, 0.3, 0.0)
    )
    assert (command.v_m_s, command.expires_ns) == (0.3, now_ns + 60_000_000)
    command, _ = armed.step(PositionTarget(armed.next_ns(), 3.0, 0.0))
    assert command.expires_ns == armed.now_ns + 4 * armed.adapter.period_ns


def test_a_reading_that_control_tells_of_twice_counts_once(armed: Armed) -> None:
    armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    for _ in range(3):
        command, _ = armed.step()
    free_m_s = command.v_m_s
    armed.front_m = 0.05
    command, _ = armed.step()
    armed.stamp_ns = armed.now_ns  # nothing new comes: it was one wrong reading
    for _ in range(5):
        command, _ = armed.step()
        assert command.v_m_s == free_m_s
    armed.stamp_ns = None
    command, state = armed.step()
    assert command.v_m_s == 0.0
    assert "front measures 0.05 m" in state.message


def test_a_robot_that_looks_around_goes_by_its_odometry_and_not_by_guesses(armed: Armed) -> None:
    """The guess jumps by a radian with each step; the robot has to turn once round all the same."""
    turned_rad, step_rad, looked = 0.0, 0.1, 0
    armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    while turned_rad < 2 * math.pi - step_rad:
        armed.theta_rad = turned_rad
        guess = LocalisationState(
            stamp_ns=armed.next_ns(),
            method="mcl",
            status=LocalisationStatus.LOST,
            x_m=float(looked),
            y_m=0.0,
            theta_rad=float(looked % 6),
            covariance=(0.0,) * 6,
        )
        _, state = armed.step(localisation=guess)
        assert state.message == "looking around"
        turned_rad += step_rad
        looked += 1


def believed(armed: Armed, *, status: LocalisationStatus, tracked: bool) -> LocalisationState:
    """Return that the robot is where odometry has it."""
    return LocalisationState(
        armed.next_ns(), "mcl", status, 0.0, 0.0, 0.0, (0.2, 0.0, 0.0, 0.2, 0.0, 0.01),
        tracked=tracked,
    )  # fmt: skip


@pytest.mark.parametrize("tracked", [True, False])
@pytest.mark.parametrize("fenced", [True, False])
def test_a_place_that_is_only_tracked_is_driven_by_but_not_within_a_fence(
    armed: Armed, *, tracked: bool, fenced: bool
) -> None:
    if fenced:
        around = ((-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0))
        armed.adapter.bound_by([SetFence(0, Fence((FencePolygon(around, True),)), 5)])
    armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    sure = LocalisationStatus.LOCALISED
    for _ in range(5):
        command, _ = armed.step(localisation=believed(armed, status=sure, tracked=True))
    assert command.v_m_s > 0.0
    unsure = LocalisationStatus.SEARCHING
    for _ in range(5):
        command, state = armed.step(localisation=believed(armed, status=unsure, tracked=tracked))
    assert (state.message == "looking around") is not (tracked or fenced)
    drives = (command.v_m_s, command.omega_rad_s) != (0.0, 0.0)
    assert drives is not fenced


def test_where_the_robot_drives_is_told(armed: Armed) -> None:
    assert armed.step()[1].goal is None
    _, state = armed.step(SetMode(armed.next_ns(), Mode.AUTO))
    assert state.goal == (9.0, 0.0)
    _, state = armed.step(SetMode(armed.next_ns(), Mode.GUIDED))
    assert state.goal is None
    _, state = armed.step(PositionTarget(armed.next_ns(), 2.0, 1.0))
    assert state.goal == (2.0, 1.0)
    _, state = armed.step(SetMode(armed.next_ns(), Mode.HOLD))
    assert state.goal is None
