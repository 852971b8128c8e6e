"""Frames lost at the worst moment: what counts and latches must not make of it; in lockstep."""

import math

import pytest

from robotctl.app.processes.robot import make_core
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.core.control_core import Inputs
from robotctl.drivers.can.nodes.motor import WheelFeedback
from robotctl.messages.control import (
    Arm,
    EmergencyStop,
    EmergencyStopSource,
    Feedback,
    SafetyState,
    VelocityCommand,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.state_machine import POWERED
from tests.native_frames import reports

MS = 1_000_000
MIDDLE = (3.0, 2.0, 0.0)


class Robot:
    """One robot in the empty room, armed."""

    def __init__(self, name="diff_drive", overrides=()):
        robot = find_file(name)
        options = StackOptions(
            "lost", str(robot), overrides, x_m=MIDDLE[0], y_m=MIDDLE[1], theta_rad=MIDDLE[2]
        )
        world = find_file("empty_room", "worlds")
        self.simulation = make_simulation(robot, world, 1, MIDDLE, overrides)
        self.stack = LockstepStack(options.load(), options, self.simulation)
        self.notices = []
        while self.state not in POWERED:
            self.tick(*(self.request(),) if self.stack.ticks % 100 == 99 else ())

    @property
    def state(self):
        return self.stack.snapshot().state

    @property
    def now_ns(self):
        return self.stack.clock.now_ns()

    def request(self):
        return Arm(self.now_ns, self.stack.ticks, arm=True)

    def tick(self, *requests):
        outputs = self.stack.tick(requests)
        self.notices += [notice.text for notice in outputs.notices]
        return outputs

    def idle(self, seconds):
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.tick()

    def drive(self, seconds, v_m_s, omega_rad_s=0.0):
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns and self.state in POWERED:
            self.tick(VelocityCommand(self.now_ns, self.now_ns + 300 * MS, v_m_s, omega_rad_s))

    def inject(self, fault):
        self.simulation.faults.inject(fault)

    @property
    def drive_state(self):
        (drive,) = (node for node in self.simulation.nodes if node.name == "drive")
        return drive.drive_state.name


@pytest.mark.parametrize("kind", ["frames_lost", "frames_corrupt"])
@pytest.mark.parametrize("duration_s", [0.3, 0.6, 1.03, 1.05, 1.06, 1.08, 2.1])
def test_arming_right_behind_a_gap_of_feedback_moves_nothing(kind, duration_s):
    """The drive's time stamp rolls over after 1.05 s: the way would seem that of milliseconds."""
    robot = Robot()
    robot.drive(1.5, 0.5)
    robot.inject(f"{kind} id=0x181 duration={duration_s}")
    began_ns = robot.now_ns
    robot.drive(1.0, 0.5)
    assert robot.state == SafetyState.FAULT
    robot.idle(duration_s - 0.3 - (robot.now_ns - began_ns) / 1e9)
    robot.tick(robot.request())
    while robot.state not in POWERED and robot.now_ns < began_ns + 4_000_000_000:
        robot.tick(*(robot.request(),) if robot.stack.ticks % 100 == 99 else ())
    assert robot.state == SafetyState.ARMED
    armed = robot.simulation.truth()
    assert abs(robot.stack.snapshot().v_ref_m_s) < 0.01
    robot.idle(0.5)
    after = robot.simulation.truth()
    assert after.distance_m - armed.distance_m < 1e-3
    assert robot.stack.snapshot().x_m == pytest.approx(after.x_m, abs=0.01)


@pytest.mark.parametrize("drives", [False, True])
def test_a_restart_whose_boot_up_is_lost_is_noticed_and_the_odometry_stays(drives):
    robot = Robot()
    robot.drive(2.0, 0.5, 0.3)
    if not drives:
        robot.tick(Arm(robot.now_ns, 1, arm=False))
        robot.idle(1.0)
    boots = robot.stack.snapshot().nodes[0].boots
    robot.inject("frames_lost id=0x701 duration=0.05")
    robot.inject("node_reset node=drive")
    robot.drive(0.5, 0.5, 0.3)
    robot.idle(2.0)
    end, true = robot.stack.snapshot(), robot.simulation.truth()
    assert end.nodes[0].boots == boots + 1
    assert robot.state == (SafetyState.FAULT if drives else SafetyState.STANDBY)
    # The way it rolls while the drive starts is counted by nobody.
    assert (end.x_m, end.y_m) == pytest.approx((true.x_m, true.y_m), abs=0.15 if drives else 0.02)


@pytest.mark.parametrize("on_the_bus", [False, True])
def test_no_wish_to_clear_faults_outlives_an_emergency_stop(on_the_bus):
    robot = Robot()
    robot.drive(1.0, 0.4)
    robot.inject("frames_lost id=0x201 duration=0.2")
    robot.drive(0.5, 0.4)
    robot.idle(0.5)
    assert robot.drive_state == "STOPPED"
    robot.inject("frames_lost id=0x601 duration=0.012")  # the first try
    asked = robot.request()
    assert robot.tick(asked).clear_faults
    robot.tick()
    if on_the_bus:
        robot.simulation.bus.attach("button", lambda _: None).send(0x001, b"\x01")
    else:
        robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.OPERATOR))
    states = set()
    robot.idle(0.02)
    for _ in range(100):
        robot.tick()
        states.add((robot.state.name, robot.drive_state))
    assert states == {("EMERGENCY_STOP", "EMERGENCY_STOP")}
    ack = robot.stack.snapshot().acks[-1]
    assert ack.request_id == asked.request_id
    assert not ack.accepted


@pytest.mark.parametrize(("robot", "limit_rad"), [("ackermann", 0.610865), ("tricycle", 0.610865)])
def test_a_robot_stands_and_is_armed_with_its_steering_at_a_limit_between_steps_of_the_wire(
    robot, limit_rad
):
    """0.610865 rad travels as 0.6109."""
    driven = Robot(robot, (f"drive.steering_max_rad={limit_rad}",))
    driven.drive(2.0, 0.3, 2.0)
    driven.tick(VelocityCommand(driven.now_ns, driven.now_ns + 300 * MS, 0.0, 0.0))
    driven.idle(2.0)
    assert driven.state == SafetyState.ARMED, driven.stack.snapshot().reason
    driven.tick(Arm(driven.now_ns, 1, arm=False))
    driven.idle(0.2)
    driven.tick(driven.request())
    driven.idle(1.0)
    assert driven.state == SafetyState.ARMED, driven.stack.snapshot().reason


def test_a_loop_held_up_for_nearly_ten_periods_drives_on_where_ten_are_allowed():
    """What comes first behind the pause is no older than the sender made it, and is believed."""
    robot = Robot(overrides=("safety.feedback_timeout_periods=10",))
    robot.drive(1.0, 0.4)
    period_ns = robot.stack.period_ns
    for _ in range(3):
        late_ns = robot.now_ns + 9 * period_ns
        robot.simulation.advance(late_ns)
        robot.stack.clock.sleep_until(late_ns)
        robot.drive(0.3, 0.4)
    assert robot.state == SafetyState.DRIVING, robot.stack.snapshot().reason


@pytest.mark.parametrize("name", ["diff_drive", "ackermann"])
def test_wheels_that_were_not_told_to_turn_back_are_not_blamed_on_an_encoder(name):
    faults = []
    for at_s in (0.25, 0.27, 0.31, 0.33):
        robot = Robot(name)
        robot.drive(1.0, 0.6)
        robot.drive(at_s, -0.6)
        robot.inject("frames_lost id=0x201 duration=0.08")
        robot.drive(0.5, -0.6)
        if robot.state == SafetyState.FAULT:
            faults.append(robot.stack.snapshot().fault)
    assert set(faults) == {FaultCode.COMMAND_LOSS}


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("name", ["diff_drive", "tricycle"])
def test_a_drive_that_hears_no_command_keeps_the_robot_from_arming_until_it_does(name, rate_hz):
    robot = Robot(name, (f"runtime.rate_hz={rate_hz}",))
    robot.idle(0.5)
    assert robot.state == SafetyState.ARMED
    robot.tick(Arm(robot.now_ns, 1, arm=False))
    robot.inject("frames_corrupt id=0x201 duration=1.6")
    robot.idle(0.3)
    asked = robot.request()
    robot.tick(asked)
    robot.idle(1.1)
    ack = robot.stack.snapshot().acks[-1]
    said = "the motor controller had no valid command for 255 ms"
    reasons = (Fault(FaultCode.COMMAND_LOSS, said, "drive"),)
    assert (ack.request_id, ack.accepted, ack.reasons) == (asked.request_id, False, reasons)
    robot.tick(robot.request())
    robot.idle(0.8)
    assert robot.state == SafetyState.ARMED
    assert robot.drive_state == "ENABLED"


def test_a_drive_that_hears_nothing_from_the_moment_of_arming_on_is_found_out():
    robot = Robot()
    robot.tick(Arm(robot.now_ns, 1, arm=False))
    robot.idle(0.1)
    robot.tick(robot.request())
    assert robot.state == SafetyState.ARMED
    robot.inject("frames_lost id=0x201 duration=1")
    robot.idle(0.1)
    assert robot.state == SafetyState.ARMED
    robot.idle(0.03)
    assert robot.stack.snapshot().fault == FaultCode.COMMAND_LOSS


def test_an_encoder_is_blamed_where_commands_came_through():
    robot = Robot()
    robot.inject("frames_lost id=0x201 duration=0.07")
    robot.drive(0.5, 0.4)
    robot.drive(1.0, 0.4)
    robot.inject("encoder_stuck wheel=left duration=1")
    robot.drive(0.5, 0.4)
    found = robot.stack.snapshot()
    assert (found.fault, found.fault_part) == (FaultCode.ENCODER_STUCK, "left")


@pytest.mark.parametrize("robot", ["diff_drive", "tricycle", "ackermann"])
@pytest.mark.parametrize("gap_ms", [100, 600])
@pytest.mark.parametrize(
    ("before", "after"),
    [(32500, 33000), (33000, 32500), (32768, 32768), (65500, 200), (200, 65500), (100, 600)],
)
def test_behind_a_gap_each_wheel_has_turned_by_its_own_counts(robot, gap_ms, before, after):
    """A drive with one motor leaves the second count at 0, which is none of its wheels."""
    options = StackOptions("lost", str(find_file(robot)))
    config = options.load()
    core = make_core(config, options)
    now_ns = 10_000 * MS

    def hear(count):
        nonlocal now_ns
        second = count if len(config.drive.wheel_names) == 2 else 0
        for _ in range(20):
            wheels = WheelFeedback(now_ns, now_ns // 1000 & 0xFFFFF, (count, second))
            told = reports(wheels, None, None, steers=bool(config.drive.joint_names))
            core.step(Inputs(Feedback(actuators=told)), now_ns)
            now_ns += 5 * MS
        return core.motion.odometry.pose_odom_base.x_m

    at_m = hear(before)
    now_ns += gap_ms * MS
    way_m = hear(after) - at_m
    counts = (after - before + 0x8000) % 0x10000 - 0x8000
    turned_rad = math.tau * counts / config.drive.counts_per_revolution
    assert way_m == pytest.approx(turned_rad * config.drive.wheel_radii_m[0], abs=1e-6)


def test_a_start_is_no_restart():
    assert not [text for text in Robot().notices if "restarted" in text]


def test_heartbeats_that_come_again_are_told_as_what_they_may_be():
    robot = Robot()
    robot.inject("frames_lost id=0x701 duration=0.6")
    robot.idle(1.5)
    text = "the drive restarted or was silent: its motion meanwhile is not in the pose"
    assert robot.notices.count(text) == 1
