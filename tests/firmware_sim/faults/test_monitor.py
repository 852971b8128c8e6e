"""The monitor: what it holds against a robot, and that it finds out a drive without guards."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from firmware_sim.bus.faults import Cut, Drop
from firmware_sim.bus.frame import REMOTE_FLAG, Frame
from firmware_sim.config.config import load_robot
from firmware_sim.faults.monitor import GRACE_NS, Allowed, Kind, Motion, SafetyMonitor, Since
from firmware_sim.nodes.drive_state import DriveState
from firmware_sim.nodes.e2e import Protector, crc8, data_id_crc
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
COMMAND, STOP, TO_DRIVE = 0x201, 0x001, 0x601
CLEAR = bytes.fromhex("2F10200001000000")
PERIOD_NS = 5_000_000
TIMEOUT_NS = 100_000_000


class Scene:
    """A robot of two numbers, a wire and a monitor."""

    def __init__(self):
        self.motion = Motion(False, 0.0, 0.0, 0.0, 0.0)
        self.monitor = SafetyMonitor(lambda: self.motion, Allowed(0.8, 2.5, TIMEOUT_NS))
        self.protector = Protector(0xA000 + COMMAND)
        self.now_ns = 0

    def on_bus(self, arbitration_id, data=b""):
        """Let a frame pass the bus that no node has heard."""
        self.monitor.on_bus(Frame(arbitration_id, data, self.now_ns))

    def frame(self, arbitration_id, data=b""):
        """Let a frame pass the bus and reach the drive's controller."""
        self.on_bus(arbitration_id, data)
        self.monitor.on_delivery(Frame(arbitration_id, data, self.now_ns))

    def command(self, enable, duty=3000):
        payload = (0x10 if enable else 0) << 8 | (duty if enable else 0) << 16
        self.frame(COMMAND, self.protector.protect(payload))

    def power(self, powered=True):
        self.motion = replace(self.motion, powered=powered)

    def run(self, milliseconds, enable=None):
        """Let time pass, with a command each 5 ms where `enable` is given."""
        for _ in range(milliseconds // 5):
            self.now_ns += PERIOD_NS
            if enable is not None:
                self.command(enable)
            self.monitor.look(self.now_ns)

    @property
    def reasons(self):
        return [finding.reason for finding in self.monitor.findings]


@pytest.fixture
def scene():
    return Scene()


def test_a_robot_that_drives_as_it_is_told_is_safe(scene):
    scene.run(50, enable=False)
    scene.power()
    scene.run(500, enable=True)
    scene.power(False)
    scene.run(500)
    assert scene.reasons == []


def test_power_without_any_command_is_unsafe(scene):
    scene.power()
    scene.run(5)
    assert scene.reasons == ["power without any command"]


def test_power_beyond_the_time_out_is_unsafe_and_counts_once(scene):
    scene.power()
    scene.run(100, enable=True)
    scene.run(105)
    assert scene.reasons == []
    scene.run(400)
    assert scene.reasons == ["power 110 ms after it was last allowed, behind the last command"]
    assert scene.monitor.count == 1


def test_a_repeated_or_a_damaged_command_keeps_nobody_alive(scene):
    scene.power()
    scene.run(20, enable=True)
    sound = scene.protector.protect(0x1000)
    scene.frame(COMMAND, sound)
    for _ in range(50):
        scene.run(5)
        scene.frame(COMMAND, sound)
        scene.frame(COMMAND, bytes((sound[0] ^ 1,)) + sound[1:])
    assert scene.monitor.count == 1


def test_a_counter_that_no_sender_uses_keeps_nobody_alive(scene):
    scene.power()
    scene.run(20, enable=True)
    unused = 0x1F  # enable, counter 15
    body = bytes((unused,)) + bytes(6)
    for _ in range(50):
        scene.run(5)
        scene.frame(COMMAND, bytes((crc8(body, data_id_crc(0xA000 + COMMAND)),)) + body)
    assert scene.monitor.count == 1


def test_a_repeated_enable_0_forbids_as_a_new_one_does(scene):
    scene.monitor.on_arming(1)
    scene.power()
    scene.run(100, enable=True)
    scene.protector.counter = (scene.protector.counter - 1) % 15  # that of the last command
    scene.command(enable=False)
    scene.run(200, enable=True)
    (found,) = scene.monitor.findings
    assert (found.kind, found.since) == (Kind.POWER, Since.NOT_ARMED)


def test_power_that_goes_on_behind_enable_0_is_unsafe(scene):
    scene.power()
    scene.run(50, enable=True)
    scene.run(105, enable=False)
    assert scene.reasons == []
    scene.run(10, enable=False)
    assert scene.reasons == ["power 110 ms after it was last allowed, behind Enable=0"]


def test_after_an_emergency_stop_only_clearing_and_a_new_enable_make_power_safe(scene):
    scene.power()
    scene.run(50, enable=True)
    scene.frame(STOP, b"\x01")
    scene.power(False)
    scene.run(150, enable=True)
    scene.power()
    scene.run(5, enable=True)
    assert scene.reasons == ["power 155 ms after it was last allowed, behind an emergency stop"]
    scene.power(False)
    scene.frame(TO_DRIVE, CLEAR)
    scene.run(20, enable=True)
    scene.power()
    scene.run(20, enable=True)
    assert scene.monitor.count == 2, "the host has not said no yet"
    scene.power(False)
    scene.run(20, enable=False)
    scene.power()
    scene.run(200, enable=True)
    assert scene.monitor.count == 2


def test_a_command_that_passed_the_bus_but_did_not_reach_the_drive_allows_nothing(scene):
    scene.power()
    scene.run(50, enable=True)
    for _ in range(30):
        scene.on_bus(COMMAND, scene.protector.protect(0x1000))
        scene.run(5)
    assert scene.reasons == ["power 110 ms after it was last allowed, behind the last command"]


@pytest.mark.parametrize("identifier", [STOP, STOP | REMOTE_FLAG])
def test_an_emergency_stop_counts_though_the_drive_has_not_heard_it(scene, identifier):
    scene.power()
    scene.run(50, enable=True)
    scene.on_bus(identifier)
    scene.run(110, enable=True)
    assert scene.reasons == ["power 110 ms after it was last allowed, behind an emergency stop"]


def test_clearing_that_did_not_reach_the_drive_clears_nothing(scene):
    scene.frame(STOP, b"\x01")
    scene.on_bus(TO_DRIVE, CLEAR)
    scene.run(20, enable=False)
    scene.power()
    scene.run(5, enable=True)
    assert scene.reasons == ["power that was never allowed, behind an emergency stop"]


def test_a_drive_that_was_powered_up_has_lost_its_latch_and_needs_a_new_no(scene):
    scene.run(50, enable=True)
    scene.frame(STOP, b"\x01")
    scene.run(200, enable=False)
    scene.monitor.on_power_up()
    scene.power()
    scene.run(5, enable=True)
    assert scene.monitor.count == 1, "the host has not said no to the new drive"
    scene.power(False)
    scene.run(20, enable=False)
    scene.power()
    scene.run(200, enable=True)
    assert scene.monitor.count == 1


def test_where_armings_are_told_of_power_after_a_stop_needs_a_new_one(scene):
    scene.monitor.on_arming(1)
    scene.power()
    scene.run(150, enable=True)
    scene.power(False)
    scene.run(50, enable=False)
    scene.power()
    scene.run(100, enable=True)
    (found,) = scene.monitor.findings
    assert (found.kind, found.since) == (Kind.POWER, Since.NOT_ARMED)
    scene.power(False)
    scene.run(50, enable=False)
    scene.monitor.on_arming(2)
    scene.power()
    scene.run(200, enable=True)
    assert scene.monitor.count == 1


def test_an_arming_outlives_what_was_sent_before_it_and_comes_after_it(scene):
    scene.monitor.on_arming(1)
    scene.power()
    scene.run(150, enable=True)
    scene.power(False)
    scene.run(50)  # the bus is dead: what the host says waits
    scene.monitor.on_arming(2)
    scene.run(5, enable=True)
    scene.run(20, enable=False)
    scene.power()
    scene.run(300, enable=True)
    assert scene.reasons == []


def test_an_arming_that_was_refused_is_no_leave_to_drive(scene):
    scene.monitor.on_arming(1)
    scene.monitor.on_refusal(1)
    scene.power()
    scene.run(5, enable=True)
    assert scene.reasons == ["power that was never allowed, behind a stop, without a new arming"]
    scene.monitor.on_arming(2)
    scene.monitor.on_arming(3)
    scene.monitor.on_refusal(3)
    scene.monitor.on_refusal(1)
    scene.run(200, enable=True)
    assert scene.monitor.count == 1, "the second arming stands"


def test_the_refusal_of_an_old_arming_takes_no_leave_that_is_there(scene):
    scene.monitor.on_arming(1)
    scene.run(50, enable=True)
    scene.run(50, enable=False)
    scene.monitor.on_arming(2)
    scene.monitor.on_refusal(1)
    scene.power()
    scene.run(200, enable=True)
    assert scene.reasons == []


@pytest.mark.parametrize(
    ("v_m_s", "vy_m_s", "omega_rad_s", "reason"),
    [
        (1.0, 0.0, 3.2, ""),
        (0.7, -0.7, 3.2, ""),
        (1.05, 0.0, 0.0, "speed 1.05 m/s, allowed 0.8"),
        (-1.05, 0.01, 0.0, "speed -1.05 m/s, allowed 0.8"),
        (0.0, 1.05, 0.0, "speed 0.00 m/s and 1.05 m/s to the left, allowed 0.8"),
        (0.8, -0.7, 0.0, "speed 0.80 m/s and -0.70 m/s to the left, allowed 0.8"),
        (0.0, 0.0, 3.3, "turn rate 3.30 rad/s, allowed 2.5"),
    ],
)
def test_more_speed_than_allowed_is_unsafe(scene, v_m_s, vy_m_s, omega_rad_s, reason):
    scene.motion = Motion(False, v_m_s, vy_m_s, omega_rad_s, 0.0)
    scene.run(5)
    assert scene.reasons == ([reason] if reason else [])


def test_a_motion_that_is_unsafe_for_its_speed_and_then_for_its_power_counts_twice(scene):
    scene.power()
    scene.run(50, enable=True)
    scene.motion = Motion(True, 1.05, 0.0, 0.0, 0.0)
    scene.run(100)
    assert scene.reasons == ["speed 1.05 m/s, allowed 0.8"]
    scene.run(50)
    assert scene.reasons[1:] == ["power 110 ms after it was last allowed, behind the last command"]
    scene.motion = Motion(False, 1.05, 0.0, 0.0, 0.0)
    scene.run(50)
    assert scene.monitor.count == 3


def test_steering_that_goes_on_in_a_stop_is_unsafe(scene):
    scene.power()
    scene.run(50, enable=True)
    scene.motion = replace(scene.motion, powered=False, steering_rad=0.4)
    scene.run(150, enable=False)  # wherever it is once nothing allows power any more, it stays
    scene.motion = replace(scene.motion, steering_rad=0.44)
    scene.run(20, enable=False)
    assert scene.reasons == []
    scene.motion = replace(scene.motion, steering_rad=0.32)
    scene.run(20, enable=False)
    assert scene.reasons == ["steering moved by -0.08 rad in a stop"]
    scene.run(20, enable=True)
    scene.motion = replace(scene.motion, steering_rad=-0.5)
    scene.run(50, enable=True)
    assert scene.monitor.count == 1


def test_figures_that_change_are_no_new_finding(scene):
    for speed_m_s in (1.05, 1.1, 1.2, 1.1):
        scene.motion = Motion(False, speed_m_s, 0.0, 0.0, 0.0)
        scene.run(5)
    assert scene.reasons == ["speed 1.05 m/s, allowed 0.8"]


class Host:
    """A host on the bus of a simulated robot that commands each 5 ms."""

    def __init__(self, **settings):
        robot = load_robot(CONFIGS / "diff_drive.toml", settings)
        world = CONFIGS / "worlds" / "empty_room.toml"
        self.simulation = Simulation(robot, world, start=(2.0, 2.0, 0.0))
        self.port = self.simulation.bus.attach("host", lambda _: None)
        self.protector = Protector(0xA000 + COMMAND)
        self.run(20)
        self.port.send(0x000, b"\x01\x00")
        self.run(20)

    def run(self, milliseconds, enable=None):
        for _ in range(milliseconds // 5):
            if enable is not None:
                duty = 3000 if enable else 0
                payload = (0x10 if enable else 0) << 8 | duty << 16 | duty << 32
                self.port.send(COMMAND, self.protector.protect(payload))
            self.simulation.advance(self.simulation.now_ns + PERIOD_NS)

    def drive(self):
        self.run(100, enable=False)
        self.run(500, enable=True)
        assert self.simulation.truth().v_m_s > 0.1


def last(host):
    """Return kind and cause of the last unsafe motion."""
    found = host.simulation.monitor.findings[-1]
    assert found.reason == host.simulation.truth().unsafe_reason
    return found.kind, found.since


def test_the_simulated_drive_is_safe_when_its_host_falls_silent():
    host = Host()
    host.drive()
    last_ns = host.simulation.now_ns
    host.run(500)
    truth = host.simulation.truth()
    assert (truth.unsafe_motions, truth.unsafe_reason) == (0, "")
    assert 90_000_000 < truth.power_off_ns - last_ns < 106_000_000
    assert host.simulation.drive.drive_state is DriveState.STOPPED


def test_a_drive_without_its_time_out_is_found_out():
    host = Host()
    host.drive()
    host.simulation.drive._timeout_ns = 10**12
    host.run(500)
    truth = host.simulation.truth()
    assert truth.unsafe_motions == 1
    assert last(host) == (Kind.POWER, Since.LAST_COMMAND)
    late_ns = host.simulation.monitor.findings[0].stamp_ns
    assert late_ns - (host.simulation.now_ns - 500_000_000) <= TIMEOUT_NS + GRACE_NS + PERIOD_NS


@pytest.mark.parametrize(
    "fault", [Drop(arbitration_id=COMMAND, receiver="drive"), Cut(node="drive")]
)
def test_a_drive_that_goes_on_without_hearing_its_commands_is_found_out(fault):
    host = Host()
    host.drive()
    host.simulation.drive._timeout_ns = 10**12
    host.simulation.bus.inject(fault)
    host.run(150, enable=True)
    assert last(host) == (Kind.POWER, Since.LAST_COMMAND)


def test_a_drive_whose_supply_failed_and_that_booted_unheard_may_drive_after_a_no_again():
    host = Host()
    host.drive()
    host.port.send(STOP, b"\x01")
    host.run(50, enable=False)
    host.simulation.faults.inject("node_silent node=drive duration=0.1")
    host.simulation.faults.inject("node_reset node=drive")
    host.run(200, enable=False)
    host.port.send(0x000, b"\x01\x00")
    host.run(20)
    host.drive()
    assert host.simulation.truth().unsafe_motions == 0


def test_a_drive_that_loses_its_latch_by_a_warm_reset_is_found_out():
    host = Host()
    host.drive()
    host.port.send(STOP, b"\x01")
    host.run(50, enable=False)
    host.simulation.drive._machine.state = DriveState.BOOT
    host.port.send(0x000, b"\x81\x01")
    host.run(50, enable=False)
    host.port.send(0x000, b"\x01\x00")
    host.run(20, enable=False)
    host.run(50, enable=True)
    assert last(host) == (Kind.POWER, Since.EMERGENCY_STOP)


@pytest.mark.parametrize("timeout_ms", [60, 90, 300])
def test_a_drive_is_judged_by_the_time_out_of_its_robot(timeout_ms):
    host = Host(**{"safety.command_timeout_ms": timeout_ms})
    host.drive()
    last_ns = host.simulation.now_ns
    host.simulation.drive._timeout_ns = 10**12
    host.run(500)
    late_ms = (host.simulation.monitor.findings[0].stamp_ns - last_ns) / 1e6
    # 10 ms for a drive whose clock is slow, 6 ms of grace, and a look each 5 ms.
    assert timeout_ms + 10 < late_ms <= timeout_ms + 10 + 6 + 5


def test_a_drive_that_does_not_obey_the_emergency_stop_is_found_out():
    host = Host()
    host.drive()
    host.simulation.drive._handlers.pop(STOP)
    host.port.send(STOP, b"\x01")
    host.run(200, enable=True)
    assert last(host) == (Kind.POWER, Since.EMERGENCY_STOP)
