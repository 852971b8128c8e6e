"""The robot port against the independent firmware, bus and plant, under one virtual time."""

import dataclasses
import itertools
import zlib
from pathlib import Path

import pytest

from firmware_sim.simulation import Simulation
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import BusState, EmergencyStopSource
from tests.native_frames import DIFFERENTIAL, native_parts, native_robot

CONFIGS = Path(__file__).parents[4] / "configs"
PERIOD_NS = 5_000_000
MS = 1_000_000
OFF = ActuatorCommand(enable=False, brake=True)


class Rig:
    def __init__(
        self, codec, parameters, clock, robot="diff_drive", faults=None, drive=DIFFERENTIAL
    ):
        self.clock = clock
        self.simulation = Simulation(
            CONFIGS / f"{robot}.toml",
            CONFIGS / "worlds" / "empty_room.toml",
            seed=1,
            start_ns=clock.now_ns(),
            faults=faults,
        )
        parts = native_parts(codec, parameters, drive)
        ids = parts.identifiers("")
        self.port = port = MemoryPort(lambda *_: False, ids, CanConfig(), clock)
        self.line = self.simulation.bus.attach("host", port.deliver, accept=ids, errors=True)
        port.transmit = self.line.send
        self.robot = native_robot(port, parts)
        self.feedback = None
        self.seen = []

    def run(self, duration_ms, command=OFF):
        for _ in range(duration_ms * MS // PERIOD_NS):
            deadline_ns = self.clock.now_ns() + PERIOD_NS
            self.simulation.advance(deadline_ns)
            self.clock.sleep_until(deadline_ns)
            self.feedback = self.robot.receive(deadline_ns)
            self.seen.append(self.feedback)
            self.robot.send(command, deadline_ns)

    def problems(self):
        return [node.problem for node in self.feedback.nodes]

    def commission(self):
        self.run(600)
        assert self.problems() == ["", "", ""]
        self.seen.clear()
        return self

    def last(self):
        """Return what the left wheel told last."""
        return self.feedback.actuators[0]

    def times(self, what):
        """Return how many different times of reception there were."""
        return len({getattr(f.actuators[0], what) for f in self.seen})


@pytest.fixture
def make_rig(codec, parameters, clock):
    return lambda **kwargs: Rig(codec, parameters, clock, **kwargs)


@pytest.fixture
def rig(make_rig):
    return make_rig().commission()


def test_the_real_nodes_are_commissioned_within_half_a_second(make_rig):
    rig = make_rig()
    rig.run(500)
    assert rig.problems() == ["", "", ""]
    assert [node.boots for node in rig.feedback.nodes] == [1, 1, 1]
    drive = rig.simulation.drive.dictionary
    assert drive.number(0x2000) == 100
    assert drive.number(0x2001) == zlib.crc32((CONFIGS / "robot.dbc").read_bytes())


def test_every_frame_is_accepted_on_both_sides(rig):
    rig.run(1000)
    bus = rig.feedback.bus
    assert (bus.crc_rejects, bus.counter_rejects, bus.lost, bus.send_failures) == (0, 0, 0, 0)
    assert bus.state is BusState.ERROR_ACTIVE
    assert rig.last().command_age_ms <= 5


def test_feedback_comes_at_the_rates_of_the_dbc(rig):
    rig.run(1000)
    assert rig.times("motion_ns") == 200
    assert rig.times("report_ns") == pytest.approx(50, abs=1)
    assert rig.times("supply_ns") == pytest.approx(50, abs=1)
    assert sum(len(f.sonars) for f in rig.seen) == 40
    assert sum(f.battery is not None for f in rig.seen) == 10


def test_wheel_feedback_is_fresh_at_each_tick(rig):
    rig.run(500)
    assert len(rig.seen) == 100
    ages_ns = [
        rig.clock.now_ns() - PERIOD_NS * (len(rig.seen) - 1 - n) - f.actuators[0].motion_ns
        for n, f in enumerate(rig.seen)
    ]
    assert all(0 < age_ns < PERIOD_NS for age_ns in ages_ns)
    times = [f.actuators[0].latch_us for f in rig.seen]
    steps = {(b - a) % 2**20 for a, b in itertools.pairwise(times)}
    assert all(abs(step - 5000) <= 150 for step in steps)


def test_the_load_is_what_the_bus_itself_measures(rig):
    rig.run(2000)
    assert rig.feedback.bus.load == pytest.approx(rig.simulation.bus.load(), rel=0.1)


def test_the_motors_turn_while_enabled_and_the_counts_follow(rig):
    rig.run(20)
    before = rig.last()
    rig.run(500, ActuatorCommand(enable=True, values=(0.3, 0.3)))
    assert rig.last().state is DriveState.ENABLED
    after = rig.last()
    turned = (after.position_ticks - before.position_ticks) % 65536
    expected = rig.simulation.truth().distance_m / (2 * 3.14159 * 0.05) * 2400
    assert turned == pytest.approx(expected, rel=0.05)
    rig.robot.close()
    rig.simulation.advance(rig.clock.now_ns() + 50 * MS)
    assert rig.simulation.drive.drive_state.name == "READY"


def test_silence_stops_the_drive_which_stays_stopped_until_it_is_cleared(rig):
    rig.run(300, ActuatorCommand(enable=True, values=(0.2, 0.2)))
    rig.clock.sleep_until(rig.clock.now_ns() + 150 * MS)
    rig.simulation.advance(rig.clock.now_ns())
    rig.run(100, ActuatorCommand(enable=True, values=(0.2, 0.2)))
    assert rig.last().state is DriveState.STOPPED
    assert any(f.emergencies for f in rig.seen)
    rig.robot.clear_faults()
    rig.run(100)
    assert rig.last().state is DriveState.READY
    rig.run(100, ActuatorCommand(enable=True))
    assert rig.last().state is DriveState.ENABLED


def test_an_emergency_stop_latches_and_is_cleared_by_request_alone(rig):
    rig.run(100, ActuatorCommand(enable=True))
    rig.robot.emergency_stop(EmergencyStopSource.OPERATOR)
    rig.run(100, ActuatorCommand(enable=True))
    assert rig.last().state is DriveState.EMERGENCY_STOP
    rig.robot.clear_faults()
    rig.run(100)
    assert rig.last().state is DriveState.READY


def test_a_power_cycle_is_seen_as_boots_and_commissioned_again(rig):
    boots = [node.boots for node in rig.feedback.nodes]
    rig.simulation.power_cycle()
    troubled = set()
    for _ in range(30):
        rig.run(5)
        troubled |= {number for number, problem in enumerate(rig.problems()) if problem}
    assert troubled == {0, 1, 2}
    rig.run(600)
    assert rig.problems() == ["", "", ""]
    assert [node.boots for node in rig.feedback.nodes] == [n + 1 for n in boots]
    bus = rig.feedback.bus
    assert (bus.crc_rejects, bus.counter_rejects) == (0, 0)


def test_a_host_that_comes_late_takes_over_running_nodes(codec, parameters, clock, make_rig):
    rig = make_rig().commission()
    rig.run(100, ActuatorCommand(enable=True))
    second = native_robot(rig.port, native_parts(codec, parameters))
    rig.robot = second
    rig.run(300)
    assert rig.problems() == ["", "", ""]
    assert [node.boots for node in rig.feedback.nodes] == [1, 1, 1]


def test_another_robots_configuration_is_refused(codec, parameters, clock):
    coarse = dataclasses.replace(DIFFERENTIAL, counts_per_revolution=1000)
    rig = Rig(codec, dataclasses.replace(parameters, sonars=12), clock, drive=coarse)
    rig.run(600)
    drive, sonar, power = rig.problems()
    assert drive == ("drive (node 1): has 2400 counts per revolution, the configuration says 1000")
    assert sonar == "sonar (node 2): has 8 sonars, the configuration says 12"
    assert power == ""
    rig.run(200, ActuatorCommand(enable=True, values=(0.5, 0.5)))
    assert rig.simulation.truth().distance_m == 0.0


def test_a_wrong_wire_version_is_refused(codec, parameters, clock, edited_dbc):
    from robotctl.drivers.can.dbc import load_dbc
    from robotctl.drivers.can.nodes.robot_codec import RobotCodec

    ours = RobotCodec(load_dbc(edited_dbc(("robotctl wire protocol", "another wire protocol"))))
    rig = Rig(ours, parameters, clock)
    rig.run(600)
    assert rig.problems()[0] == (
        f"drive (node 1): wire version 0x{codec.dbc.wire_version:08X} is not ours "
        f"0x{ours.dbc.wire_version:08X}"
    )
