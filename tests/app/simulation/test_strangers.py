"""Other senders on the bus of a driving robot, in lockstep: told by their frames, in time."""

import pytest

from robotctl.messages.control import SafetyState, StrangerKind
from robotctl.messages.faults import FaultCode
from robotctl.safety.state_machine import POWERED
from tests.app.simulation.test_lost_frames import MS, Robot

LIMIT_MS = 200.0
BAD_COMMAND = bytes.fromhex("0010E803E8030000")
WRITE_TIMEOUT = bytes.fromhex("2B002000D0070000")


class Bus:
    """A driving robot, and a stranger on its bus."""

    def __init__(self):
        self.robot = Robot()
        self.bus = self.robot.simulation.bus
        self.stranger = self.bus.attach("stranger", lambda _: None)
        self.captured = []
        self.bus.attach("tap", self._capture)
        self.capturing = False
        self.first_ns = None
        self.robot.drive(1.0, 0.4, 0.4)
        self.robot.notices.clear()

    def _capture(self, frame):
        if self.capturing:
            self.captured.append((frame.stamp_ns, frame.arbitration_id, bytes(frame.data)))

    def send(self, number, data, count=1, every_ms=5.0):
        now_ns = self.bus.now_ns
        for n in range(count):
            # Not with the host's own frame: two devices that send the same bits are one.
            self._at(now_ns + round((2.5 + n * every_ms) * MS), number, data)

    def _at(self, time_ns, number, data):
        self.first_ns = time_ns if self.first_ns is None else self.first_ns
        self.bus.schedule(time_ns, lambda: self.stranger.send(number, data))

    def record(self, seconds, *numbers):
        """Return the frames of some identifiers in the next time, with their times."""
        self.capturing = True
        self.robot.drive(seconds, 0.4, 0.4)
        self.capturing = False
        return [each for each in self.captured if each[1] in numbers]

    def replay(self, frames):
        later_ns = self.bus.now_ns + 700_000 - frames[0][0]
        for time_ns, number, data in frames:
            self._at(time_ns + later_ns, number, data)

    def drive(self, seconds, v_m_s=0.4):
        self.robot.drive(seconds, v_m_s, 0.4)
        return self.robot.stack.snapshot()

    def stopped(self, v_m_s=0.4):
        """Return the fault that the robot stopped for, and how long after the first frame [ms]."""
        state = self.drive(2.0, v_m_s)
        assert state.state is SafetyState.FAULT, "it drove on"
        return state.fault, state.fault_part, (self.robot.now_ns - self.first_ns) / MS


@pytest.fixture
def bus():
    return Bus()


@pytest.mark.parametrize(
    ("name", "number", "data"),
    [
        ("MotorCommand", 0x201, BAD_COMMAND),
        ("MotorCommand", 0x201, b""),
        ("Sync", 0x080, b""),
        ("NmtControl", 0x000, b"\x01\x00"),
        ("NmtControl", 0x000, b"\x02\x05"),
        ("NmtControl", 0x000, bytes(8)),
    ],
)
def test_one_frame_that_only_the_host_sends_stops_the_robot_and_is_named(bus, name, number, data):
    bus.send(number, data)
    code, part, taken_ms = bus.stopped()
    assert (code, part) == (FaultCode.BUS_STRANGER, name)
    assert taken_ms <= 10.0


def test_valid_commands_of_before_are_told_at_the_first_frame(bus):
    bus.replay(bus.record(0.5, 0x201))
    code, part, taken_ms = bus.stopped()
    assert (code, part) == (FaultCode.BUS_STRANGER, "MotorCommand")
    assert taken_ms <= 10.0


@pytest.mark.parametrize(
    ("number", "node", "limit_ms"),
    [
        *((0x181, "drive", 50.0), (0x281, "drive", LIMIT_MS), (0x381, "drive", LIMIT_MS)),
        # Ten a second: four frames of two senders take as long.
        *((0x182, "sonar", LIMIT_MS), (0x183, "power", 350.0)),
    ],
)
@pytest.mark.parametrize("later_ms", [340, 343])
def test_replayed_process_data_are_of_a_second_sender(bus, number, node, limit_ms, later_ms):
    frames = bus.record(0.6, number)
    bus.drive(later_ms / 1000, 0.2)  # the same bits with the same counter would prove nothing
    bus.replay(frames)
    _, _, taken_ms = bus.stopped(0.2)
    bus.robot.idle(0.1)
    state = bus.robot.stack.snapshot()
    assert (state.fault, state.fault_part) == (FaultCode.NODE_DOUBLED, node)
    assert taken_ms <= limit_ms


@pytest.mark.parametrize("state", [0, 4, 127])
@pytest.mark.parametrize(("number", "node"), [(0x701, "drive"), (0x702, "sonar"), (0x703, "power")])
def test_a_state_that_process_data_prove_false_is_none_of_the_nodes(bus, state, number, node):
    boots = [each.boots for each in bus.robot.stack.snapshot().nodes]
    pose = bus.robot.stack.snapshot()
    bus.send(number, bytes((state,)))
    code, part, taken_ms = bus.stopped()
    assert (code, part) == (FaultCode.NODE_MISREPORTED, node)
    assert taken_ms <= LIMIT_MS
    after = bus.robot.stack.snapshot()
    assert [each.boots for each in after.nodes] == boots
    assert not any(each.problem for each in after.nodes)
    assert after.odom_epoch_ns == pose.odom_epoch_ns


def test_a_false_boot_up_is_told_beside_a_true_one(bus):
    bus.send(0x701, b"\0")
    bus.robot.inject("node_reset node=sonar")
    bus.stopped()
    bus.robot.idle(0.3)
    states = {each.name: each.boots for each in bus.robot.stack.snapshot().nodes}
    assert states == {"drive": 1, "sonar": 2, "power": 1}


def test_writes_of_a_tool_are_counted_with_those_refused_and_stop_nothing(bus):
    bus.send(0x601, WRITE_TIMEOUT, 40, 20.0)
    assert bus.drive(2.0).state in POWERED
    (told,) = (each for each in bus.robot.notices if "SDO" in each)
    assert told == "another sender writes to drive (node 1) by SDO: 40 frames in 780 ms, 40 refused"


def test_a_flood_is_the_stop_and_one_notice(bus):
    bus.send(0x000, b"\x01\x00", 12_714, 0.2)
    bus.stopped()
    bus.robot.idle(3.0)
    told = [each for each in bus.robot.notices if "NmtControl" in each]
    assert len(told) == 2
    assert told[0].startswith("stopped: a device babbles: NmtControl (0x000)")


def test_a_stranger_keeps_a_robot_from_arming_while_it_sends(bus):
    bus.send(0x201, BAD_COMMAND, 400)
    bus.stopped()
    robot = bus.robot
    robot.idle(0.1)
    robot.tick(robot.request())
    robot.idle(1.2)
    (reason,) = robot.stack.snapshot().acks[-1].reasons
    assert reason.code is FaultCode.BUS_STRANGER
    robot.idle(2.0)
    robot.tick(robot.request())
    robot.idle(0.2)
    assert robot.state is SafetyState.ARMED


def test_the_robot_itself_is_no_stranger(bus):
    assert bus.drive(5.0).state in POWERED
    assert bus.robot.stack.control.inputs.feedback.strangers == ()
    assert StrangerKind.HOST_FRAME == 0
