"""Each kind of fault against what physics and the standards say of it, seen on the bus."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from e2e import p01

from firmware_sim.bus.errors import ErrorState
from firmware_sim.errors import SimulationError
from firmware_sim.faults.catalogue import CATALOGUE
from firmware_sim.plant.axis import Mode
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
MS = 1_000_000
PERIOD_NS = 5 * MS
COMMAND, FEEDBACK, STATUS, DRIVE_STATUS = 0x201, 0x181, 0x281, 0x381
SONAR_A, SONAR_B, BATTERY = 0x182, 0x282, 0x183
EMCY_DRIVE, HEARTBEAT_DRIVE = 0x081, 0x701
OF_DRIVE = {FEEDBACK, STATUS, DRIVE_STATUS, EMCY_DRIVE, HEARTBEAT_DRIVE}
PARAMETERS_LOST = 0x6310


class Bench:
    """A robot in the empty room with a host that commands it, and an ear on the bus."""

    def __init__(self, robot="diff_drive", start=(2.0, 2.0, 0.0), *, tools=(), name="host"):
        self.simulation = Simulation(
            CONFIGS / f"{robot}.toml", CONFIGS / "worlds" / "empty_room.toml", 1, start
        )
        self.frames, self.wire = [], []
        self.simulation.bus.tap(self.wire.append)
        self.tools = [self.simulation.bus.attach(each, lambda _: None) for each in tools]
        self.port = self.simulation.bus.attach(name, self.frames.append)
        self.counter = 0
        self.run(20)
        self.port.send(0x000, b"\x01\x00")

    def run(self, ms):
        self.simulation.advance(self.simulation.now_ns + round(ms * MS))

    def command(self, duty1=0.0, duty2=0.0, *, enable=True):
        data = bytearray((0, self.counter | enable << 4))
        for value in (duty1, duty2, 0.0):
            data += round(value * 1e4).to_bytes(2, "little", signed=True)
        p01.e2e_p01_protect(data, 0xA201, length=8, increment_counter=False)
        if self.port.send(COMMAND, bytes(data)):
            self.counter = (self.counter + 1) % 15

    def drive(self, seconds, duty1=0.3, duty2=0.3, *, enable=True):
        """Command and SYNC every 5 ms; forget what was heard before."""
        self.frames.clear()
        self.wire.clear()
        for _ in range(round(seconds * 200)):
            self.command(duty1, duty2, enable=enable)
            self.port.send(0x080)
            self.run(5)

    def begin(self, line):
        self.simulation.faults.inject(line)

    def clear(self):
        self.simulation.faults.inject("clear")

    def of(self, identifier):
        return [frame for frame in self.frames if frame.arbitration_id == identifier]

    def on_wire(self, identifier):
        return [frame for frame in self.wire if frame.arbitration_id == identifier]

    def of_drive(self):
        """Frames on the wire that the drive has sent."""
        return [frame for frame in self.wire if frame.arbitration_id in OF_DRIVE]

    def counts(self):
        """Counts of both wheels in each feedback, unrolled from the first on."""
        raw = [np.frombuffer(frame.data[4:8], "<i2").astype(int) for frame in self.of(FEEDBACK)]
        return np.unwrap(np.array(raw), period=65536, axis=0)

    def true_counts(self):
        turn = self.simulation.config.drive.counts_per_revolution
        counts = [axis.encoder(turn).count for axis in self.simulation.plant.axes]
        return np.array((*counts, 0)[:2])

    def stamps_us(self):
        stamps = [int.from_bytes(f.data[:4], "little") >> 12 for f in self.of(FEEDBACK)]
        return np.unwrap(np.array(stamps), period=1 << 20)

    def status(self):
        bits = int.from_bytes(self.of(STATUS)[-1].data, "little")

        def signed(start):
            value = bits >> start & 0xFFF
            return value - 4096 if value & 0x800 else value

        return {
            "state": bits >> 12 & 0xF,
            "current1_a": 0.05 * signed(16),
            "current2_a": 0.05 * signed(28),
            "temperature1_c": (bits >> 40 & 0xFF) - 40,
            "temperature2_c": (bits >> 48 & 0xFF) - 40,
            "faults": bits >> 56 & 0x3F,
        }

    def voltage_v(self):
        return int.from_bytes(self.of(DRIVE_STATUS)[-1].data[4:6], "little") / 1000

    def ranges(self, identifier=SONAR_A):
        """Ranges [m] of each frame of a group of sonars."""
        bits = [int.from_bytes(frame.data, "little") for frame in self.of(identifier)]
        return np.array([[(b >> s & 0x1FFF) / 1000 for s in (12, 25, 38, 51)] for b in bits])

    def read(self, node, index, sub=0):
        request = b"\x40" + index.to_bytes(2, "little") + bytes((sub,)) + bytes(4)
        self.port.send(0x600 + node, request)
        self.frames.clear()
        self.run(5)
        [answer] = self.of(0x580 + node)
        assert answer.data[0] & 0xE3 == 0x43, answer.data.hex()
        return int.from_bytes(answer.data[4 : 8 - (answer.data[0] >> 2 & 3)], "little")

    def write(self, node, index, value, size):
        head = bytes((0x23 | (4 - size) << 2,)) + index.to_bytes(2, "little") + b"\0"
        self.port.send(0x600 + node, head + value.to_bytes(4, "little"))
        self.frames.clear()
        self.run(5)
        [answer] = self.of(0x580 + node)
        assert answer.data[0] == 0x60, answer.data.hex()


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def driving(bench):
    bench.drive(1.0)
    assert np.all(np.diff(bench.counts()[-20:], axis=0).mean(axis=0) > 5)
    return bench


class TestEncoders:
    def test_a_stuck_encoder_stands_while_its_wheel_turns_and_the_other_counts(self, driving):
        before = driving.true_counts()
        driving.begin("encoder_stuck wheel=right")
        driving.drive(0.1)
        left, right = driving.counts().T
        assert np.all(right == right[0])
        assert left[-1] - left[0] > 50
        assert np.all(driving.true_counts() - before > 50)

    def test_a_reversed_encoder_counts_down_as_far_as_its_wheel_turns_forward(self, driving):
        [at_fault, _] = driving.true_counts()
        driving.begin("encoder_reversed wheel=left")
        driving.drive(0.1)
        [now, _] = driving.true_counts()
        [read, _] = driving.counts()[-1]
        assert now - at_fault > 200
        # Feedback shows the count at the SYNC, up to one period of 5 ms before the truth of now.
        assert 0 <= read - (at_fault - (now - at_fault)) <= 30

    @pytest.mark.parametrize("kind", ["encoder_stuck", "encoder_reversed", "feedback_frozen"])
    def test_the_count_is_continuous_when_a_fault_begins_and_ends(self, driving, kind):
        driving.begin(kind)
        driving.drive(0.05)
        first = driving.counts()
        driving.clear()
        driving.drive(0.05)
        steps = np.abs(np.diff(np.vstack((first, driving.counts())), axis=0))
        assert steps.max() <= 40

    def test_of_two_faults_of_one_encoder_the_later_counts_and_the_first_stays(self, driving):
        driving.begin("encoder_stuck wheel=left duration=0.1")
        driving.begin("encoder_reversed wheel=left duration=0.05")
        driving.drive(0.04)
        assert np.diff(driving.counts()[:, 0]).max() < 0
        driving.drive(0.02)
        driving.drive(0.03)
        assert np.ptp(driving.counts()[:, 0]) == 0
        driving.drive(0.02)
        driving.drive(0.03)
        assert np.diff(driving.counts()[:, 0]).min() > 0

    @pytest.mark.parametrize("counts", [700, -32000])
    def test_a_glitch_shifts_the_count_once(self, driving, counts):
        driving.drive(0.05)
        before = driving.counts()[-1]
        driving.begin(f"encoder_glitch wheel=right counts={counts}")
        driving.drive(0.05)
        after = driving.counts()
        assert after[0][1] - before[1] - counts in range(5, 60)
        assert after[0][0] - before[0] in range(5, 60)
        assert np.diff(after[:, 1]).max() < 60

    def test_an_open_cable_with_no_noise_counts_nothing(self, driving):
        driving.begin("encoder_disconnected wheel=left edges=0")
        driving.drive(0.1)
        assert np.ptp(driving.counts()[:, 0]) == 0

    def test_an_open_cable_counts_a_random_walk_while_the_bridges_switch(self):
        walks = []
        bench = Bench()
        bench.drive(0.3)
        bench.begin("encoder_disconnected wheel=left edges=4000")
        for _ in range(6):
            bench.drive(0.5, 0.15, 0.15)
            walks.append(np.diff(bench.counts()[:, 0]))
        steps = np.concatenate(walks)
        # A walk of Poisson many steps of +1 or -1 has mean 0 and as its variance their number: 20
        # in 5 ms. The variance of 590 draws is known to about 6 %, their mean to 0.19.
        assert abs(steps.mean()) < 0.8
        assert steps.var() == pytest.approx(20.0, rel=0.3)

    def test_an_open_cable_is_quiet_while_the_bridges_are(self, bench):
        bench.drive(0.1, enable=False)
        bench.begin("encoder_disconnected wheel=left edges=4000")
        bench.drive(0.2, 0.0, 0.0, enable=False)
        assert np.ptp(bench.counts()[:, 0]) == 0

    def test_an_open_cable_has_picked_up_nothing_at_its_beginning(self, driving):
        left = driving.simulation.faults.stage.axes[0].socket
        before = left.count
        driving.begin("encoder_disconnected wheel=left edges=50000")
        assert left.count == before

    def test_an_encoder_that_is_stuck_picks_up_nothing_of_its_open_cable(self, driving):
        driving.begin("encoder_disconnected wheel=left edges=50000")
        driving.begin("encoder_stuck wheel=left duration=0.05")
        driving.drive(0.045)
        assert np.ptp(driving.counts()[:, 0]) == 0
        driving.drive(0.1)
        assert np.ptp(driving.counts()[:, 0]) > 0

    def test_the_feedback_of_a_robot_with_one_motor_freezes_and_goes_on(self):
        bench = Bench("tricycle")
        bench.drive(1.0)
        bench.begin("feedback_frozen")
        bench.drive(0.1)
        assert np.ptp(bench.counts(), axis=0) == pytest.approx([0, 0])
        bench.clear()
        bench.drive(0.1)
        assert np.diff(bench.counts()[2:, 0]).min() > 0
        assert np.ptp(bench.counts()[:, 1]) == 0

    def test_swapped_cables_show_each_wheel_the_counts_of_the_other(self, bench):
        bench.drive(1.0, 0.4, 0.1)
        fast, slow = np.diff(bench.counts()[-10:], axis=0).mean(axis=0)
        bench.begin("wheels_swapped")
        bench.drive(0.05, 0.4, 0.1)
        assert np.diff(bench.counts()[1:], axis=0).mean(axis=0) == pytest.approx(
            [slow, fast], rel=0.1
        )
        bench.clear()
        bench.drive(0.05, 0.4, 0.1)
        assert np.diff(bench.counts()[1:], axis=0).mean(axis=0) == pytest.approx(
            [fast, slow], rel=0.1
        )

    def test_frozen_feedback_goes_on_with_fresh_stamps_and_old_counts(self, driving):
        driving.begin("feedback_frozen")
        driving.drive(0.1)
        assert np.ptp(driving.counts(), axis=0) == pytest.approx([0, 0])
        assert np.diff(driving.stamps_us()) == pytest.approx(5000, abs=1000)
        assert len(driving.of(FEEDBACK)) == 20


class TestTheRobotIsCarried:
    def test_it_stands_free_elsewhere_and_its_encoders_go_on(self, bench):
        bench.drive(0.5, 0.0, 0.0)
        plant, before = bench.simulation.plant, bench.counts()[-1]
        low_x, low_y, high_x, high_y = bench.simulation.world.bounds
        places = set()
        for _ in range(20):
            bench.begin("carried")
            bench.drive(0.05, 0.0, 0.0)
            places.add((round(plant.x_m, 3), round(plant.y_m, 3)))
            assert low_x < plant.x_m < high_x
            assert low_y < plant.y_m < high_y
        assert len(places) == 20
        assert plant.collisions == 0
        assert bench.counts()[-1] == pytest.approx(before, abs=2)


class TestMotors:
    def test_a_blocked_wheel_stands_and_its_motor_stalls(self, driving):
        driving.begin("wheel_blocked wheel=left")
        driving.drive(0.2)
        plant = driving.simulation.plant
        assert plant.axes[0].speed_rad_s == 0.0
        motor = driving.simulation.config.simulation.motor
        # All of the voltage falls over the winding: I = duty * U / R.
        stall_a = 0.3 * plant.bus_voltage_v / motor.resistance_ohm
        assert plant.axes[0].current_a == pytest.approx(stall_a, rel=0.15)
        driving.clear()
        driving.drive(0.3)
        assert plant.axes[0].speed_rad_s > 1.0

    def test_added_current_and_heat_appear_at_their_motor_alone(self, driving):
        healthy = driving.status()
        driving.begin("over_current wheel=right amperes=2")
        driving.begin("over_temperature wheel=left kelvin=30")
        driving.drive(0.1)
        sick = driving.status()
        assert sick["current2_a"] - healthy["current2_a"] == pytest.approx(2.0, abs=0.4)
        assert sick["current1_a"] == pytest.approx(healthy["current1_a"], abs=0.4)
        assert sick["temperature1_c"] - healthy["temperature1_c"] == pytest.approx(30, abs=1)
        assert sick["temperature2_c"] == pytest.approx(healthy["temperature2_c"], abs=1)

    @pytest.mark.parametrize("duty", [0.3, -0.3])
    def test_added_current_makes_a_current_larger_in_either_direction(self, bench, duty):
        bench.drive(1.0, duty, duty)
        healthy_a = bench.status()["current2_a"]
        assert healthy_a * duty > 0.0
        bench.begin("over_current wheel=right amperes=2")
        bench.drive(0.1, duty, duty)
        sick_a = bench.status()["current2_a"]
        assert abs(sick_a) - abs(healthy_a) == pytest.approx(2.0, abs=0.4)
        assert sick_a * duty > 0.0

    @pytest.mark.parametrize("duty", [0.3, -0.3])
    def test_added_current_has_the_direction_of_the_duty_where_none_flows_yet(self, duty):
        bench = Bench()
        stage, plant = bench.simulation.faults.stage, bench.simulation.plant
        bench.begin("over_current wheel=left amperes=2")
        stage.axes[0].command(Mode.DUTY, duty)
        assert plant.axes[0].current_a == 0.0
        assert stage.axes[0].current_a == math.copysign(2.0, duty)

    @pytest.mark.parametrize(
        ("line", "bit", "within_s"),
        [
            ("over_current amperes=30", 1, 0.6),
            ("over_temperature kelvin=150", 2, 0.1),
            ("under_voltage volts=5", 4, 0.15),
        ],
    )
    def test_the_drive_trips_by_itself(self, driving, line, bit, within_s):
        driving.begin(line)
        driving.drive(within_s)
        assert driving.status()["faults"] & bit
        assert not driving.simulation.plant.powered


class TestSupply:
    def test_less_voltage_is_reported_and_drives_that_much_slower(self, bench):
        bench.drive(1.5, 0.3, 0.3)
        fast = bench.simulation.plant.axes[0].speed_rad_s
        full_v = bench.voltage_v()
        bench.begin("under_voltage volts=2.5")
        bench.drive(1.5, 0.3, 0.3)
        slow = bench.simulation.plant.axes[0].speed_rad_s
        assert full_v - bench.voltage_v() == pytest.approx(2.5, abs=0.05)
        bench.clear()
        bench.drive(1.5, 0.3, 0.3)
        assert bench.simulation.plant.axes[0].speed_rad_s == pytest.approx(fast, rel=0.02)
        # A duty of 0.3 at a lower supply is a smaller duty at the full one.
        smaller = Bench()
        smaller.drive(3.0, *2 * [0.3 * (full_v - 2.5) / full_v])
        assert slow == pytest.approx(smaller.simulation.plant.axes[0].speed_rad_s, rel=0.02)

    def test_a_supply_that_sags_below_the_threshold_resets_the_drive_until_it_is_back(self):
        bench = Bench()
        bench.drive(0.5)
        bench.begin("brown_out volts=3 sag=0.1 duration=0.4")
        heard = []
        for _ in range(20):
            bench.drive(0.005)
            heard += bench.of(FEEDBACK)
        # Evenly from 12.3 V to 3 V in 100 ms: below 6 V after about 68 ms.
        silent_ms = 5 * len(heard)
        assert silent_ms == pytest.approx(68, abs=10)
        assert not bench.simulation.plant.powered
        bench.drive(0.25)
        assert not bench.of(FEEDBACK)
        assert not bench.of(HEARTBEAT_DRIVE)
        assert len(bench.of(0x702)) >= 2
        bench.drive(0.1)
        assert [frame.data for frame in bench.of(HEARTBEAT_DRIVE)][:1] == [b"\0"]
        assert bench.simulation.drive.drive_state.name == "BOOT"

    def test_a_slow_sag_is_seen_as_under_voltage_before_the_reset(self, driving):
        driving.begin("brown_out volts=7 sag=0.5")
        driving.drive(0.6)
        assert driving.voltage_v() == pytest.approx(7.0, abs=0.3)
        assert driving.status()["faults"] & 4
        driving.clear()
        driving.drive(0.1)
        assert driving.voltage_v() > 11.0

    def test_of_two_brown_outs_the_deeper_counts_and_they_do_not_add_up(self, driving):
        driving.begin("brown_out volts=9 sag=0.05")
        driving.drive(0.02)
        driving.begin("brown_out volts=7.5 sag=0.05 duration=0.2")
        driving.drive(0.1)
        assert driving.voltage_v() == pytest.approx(7.5, abs=0.05)
        driving.drive(0.2)
        assert driving.voltage_v() == pytest.approx(9.0, abs=0.05)
        driving.clear()
        driving.drive(0.1)
        assert driving.voltage_v() > 11.0

    def test_a_brown_out_leaves_its_volts_though_the_supply_was_low_before(self, driving):
        driving.begin("under_voltage volts=2 duration=0.1")
        driving.begin("brown_out volts=8 sag=0.05")
        driving.drive(0.08)
        assert driving.voltage_v() == pytest.approx(8.0, abs=0.05)
        driving.drive(0.1)
        assert driving.voltage_v() == pytest.approx(8.0, abs=0.05)

    @pytest.mark.parametrize(
        "line", ["node_reset", "parameter_lost", "wrong_firmware duration=0.05"]
    )
    def test_a_drive_without_supply_does_not_boot_whatever_else_befalls_it(self, driving, line):
        driving.begin("brown_out volts=4 sag=0.01 duration=0.2")
        driving.drive(0.05)
        driving.begin(line)
        assert "drive" not in [port.name for port in driving.simulation.bus.ports]
        driving.drive(0.14)
        assert not driving.of_drive()
        driving.drive(0.05)
        assert [frame.data for frame in driving.on_wire(HEARTBEAT_DRIVE)] == [b"\0"]

    def test_any_supply_below_the_threshold_holds_the_drive_in_reset(self, driving):
        driving.begin("under_voltage volts=7 duration=0.1")
        driving.drive(0.09)
        assert not driving.of(FEEDBACK)
        assert not driving.simulation.plant.powered
        driving.drive(0.05)
        assert [frame.data for frame in driving.on_wire(HEARTBEAT_DRIVE)] == [b"\0"]

    def test_a_drive_in_reset_stays_so_until_the_supply_is_above_the_upper_threshold(self, driving):
        full_v = driving.simulation.plant.bus_voltage_v
        driving.begin(f"under_voltage volts={full_v - 6.25:.2f} duration=0.3")
        driving.drive(0.05)
        assert driving.of(FEEDBACK), "6.25 V holds no drive in reset that runs"
        driving.begin("brown_out volts=4 sag=0.01 duration=0.1")
        driving.drive(0.05)
        driving.drive(0.15)
        assert not driving.of_drive(), "6.25 V does not release one that is held"
        driving.drive(0.1)
        assert [frame.data for frame in driving.on_wire(HEARTBEAT_DRIVE)] == [b"\0"]

    def test_a_drive_that_somebody_switched_off_stays_off_after_a_brown_out(self, driving):
        simulation = driving.simulation
        simulation.power_off(simulation.drive)
        driving.begin("brown_out volts=4 sag=0.01 duration=0.1")
        driving.drive(0.2)
        assert not driving.of_drive()
        driving.begin("brown_out volts=4 sag=0.01 duration=0.1")
        driving.drive(0.05)
        simulation.power_up(simulation.drive)
        driving.drive(0.04)
        assert not driving.of_drive()
        driving.drive(0.05)
        assert [frame.data for frame in driving.on_wire(HEARTBEAT_DRIVE)] == [b"\0"]


class TestSonars:
    def test_a_silent_ring_sends_no_ranges_but_beats(self, driving):
        driving.begin("sonar_silent duration=0.4")
        driving.drive(0.35)
        assert not driving.of(SONAR_A)
        assert not driving.of(SONAR_B)
        assert len(driving.of(0x702)) >= 3
        driving.drive(0.2)
        assert driving.of(SONAR_A)

    def test_a_stuck_ring_repeats_its_ranges_while_the_robot_nears_the_wall(self, driving):
        driving.begin("sonar_stuck")
        driving.drive(0.1)
        driving.drive(1.0)
        front = driving.ranges()[:, 0]
        assert np.ptp(front) == 0
        driving.clear()
        driving.drive(0.3)
        assert driving.ranges()[-1, 0] < front[0] - 0.2

    def test_a_sonar_that_hears_another_reads_half_of_the_strange_way(self):
        # In a room of 6 m by 4 m at x 3 m, y 3.3 m along x: front sees a wall 2.8 m ahead, left
        # one at 0.54 m. The sound of "left" comes back to "front" over their distance.
        bench = Bench(start=(3.0, 3.3, 0.0))
        bench.drive(0.5, enable=False)
        front_m, left_m = np.median(bench.ranges()[:, [0, 2]], axis=0)
        assert front_m == pytest.approx(2.8, abs=0.1)
        assert left_m == pytest.approx(4.0 - 3.3 - 0.16, abs=0.03)
        bench.begin("sonar_crosstalk sonar=0 other=2")
        bench.drive(0.1, enable=False)
        bench.drive(0.5, enable=False)
        heard = np.median(bench.ranges()[:, [0, 2]], axis=0)
        way_m = left_m + math.hypot(0.18, 0.7)  # from the wall at y 4 m back to the front
        assert heard[0] == pytest.approx(way_m / 2, abs=0.03)
        assert heard[1] == pytest.approx(left_m, abs=0.02)
        bench.clear()
        bench.drive(0.1, enable=False)
        bench.drive(0.5, enable=False)
        assert np.median(bench.ranges()[:, 0]) == pytest.approx(front_m, abs=0.05)

    @pytest.mark.parametrize(
        ("pair", "problem"),
        [("sonar=0 other=8", "8 sonars"), ("sonar=3 other=4", "together"), ("other=0", "together")],
    )
    def test_sonars_that_cannot_hear_each_other_are_refused(self, bench, pair, problem):
        with pytest.raises(SimulationError, match=problem):
            bench.begin(f"sonar_crosstalk {pair}")


class TestNodes:
    @pytest.mark.parametrize(("node", "number"), [("drive", 1), ("sonar", 2), ("power", 3)])
    def test_a_reset_node_boots_once(self, driving, node, number):
        driving.begin(f"node_reset node={node}")
        driving.drive(0.05)
        booted = {n: [f.data for f in driving.of(0x700 + n)].count(b"\0") for n in (1, 2, 3)}
        assert booted == {n: int(n == number) for n in (1, 2, 3)}

    def test_a_silent_node_sends_nothing_at_all_and_then_goes_on(self, driving):
        driving.begin("node_silent node=drive duration=0.3")
        driving.drive(0.29)
        assert not [f for f in driving.frames if f.arbitration_id & 0x7F == 1]
        assert driving.of(SONAR_A)
        driving.drive(0.2)
        assert driving.of(FEEDBACK)

    def test_lost_feedback_leaves_the_heartbeat(self, driving):
        driving.begin("feedback_lost duration=0.3")
        driving.drive(0.29)
        assert not driving.of(FEEDBACK) + driving.of(STATUS) + driving.of(DRIVE_STATUS)
        assert len(driving.of(HEARTBEAT_DRIVE)) >= 2

    def test_lost_parameters_are_the_defaults_and_said_so(self, bench):
        bench.write(1, 0x2000, 60, 2)
        assert bench.read(1, 0x2000) == 60
        bench.frames.clear()
        bench.begin("parameter_lost node=drive")
        bench.run(20)
        codes = [int.from_bytes(f.data[:2], "little") for f in bench.of(EMCY_DRIVE)]
        assert PARAMETERS_LOST in codes
        assert bench.read(1, 0x2000) == 100
        bench.port.send(0x000, b"\x01\x00")
        bench.drive(0.1, enable=False)
        assert bench.status()["faults"] & 32

    @pytest.mark.parametrize(
        ("parameter", "value", "address"),
        [
            ("command_timeout", 2000, (1, 0x2000, 0)),
            ("current_limit", 60000, (1, 0x2003, 0)),
            ("temperature_limit", 200, (1, 0x2004, 0)),
            ("voltage_limit", 0, (1, 0x2005, 0)),
            ("motor_status_syncs", 1, (1, 0x1801, 2)),
            ("drive_status_syncs", 240, (1, 0x1802, 2)),
            ("drive_heartbeat", 0, (1, 0x1017, 0)),
            ("ring_period", 240, (2, 0x2201, 0)),
            ("battery_low", 1, (3, 0x2300, 0)),
            ("battery_critical", 1, (3, 0x2301, 0)),
        ],
    )
    def test_a_parameter_changes_while_the_motors_turn(self, driving, parameter, value, address):
        driving.begin(f"parameter_changed parameter={parameter} value={value}")
        assert driving.read(*address) == value

    def test_a_changed_time_out_is_the_one_that_the_drive_has(self, driving):
        driving.begin("parameter_changed value=300")
        driving.run(290)
        assert driving.simulation.drive.drive_state.name == "ENABLED"
        driving.run(20)
        assert driving.simulation.drive.drive_state.name == "STOPPED"

    def test_stored_parameters_outlive_a_reset_but_not_their_loss(self, bench):
        bench.write(1, 0x2000, 60, 2)
        request = b"\x23\x10\x10\x01save"
        bench.port.send(0x601, request)
        bench.run(5)
        bench.begin("node_reset node=drive")
        bench.run(20)
        assert bench.read(1, 0x2000) == 60
        bench.begin("parameter_lost node=drive")
        bench.run(20)
        assert bench.read(1, 0x2000) == 100
        bench.begin("node_reset node=drive")
        bench.run(20)
        assert bench.read(1, 0x2000) == 100
        bench.port.send(0x601, request)  # written anew, the memory is sound
        bench.run(5)
        bench.frames.clear()
        bench.begin("node_reset node=drive")
        bench.run(20)
        assert not bench.of(EMCY_DRIVE)

    @pytest.mark.parametrize(("node", "number"), [("drive", 1), ("sonar", 2), ("power", 3)])
    def test_wrong_firmware_boots_with_another_revision_until_its_own_is_back(
        self, bench, node, number
    ):
        right = bench.read(number, 0x1018, 3)
        bench.frames.clear()
        bench.begin(f"wrong_firmware node={node}")
        bench.run(20)
        assert next(f.data for f in bench.of(0x700 + number)) == b"\0"
        assert bench.read(number, 0x1018, 3) >> 16 != right >> 16
        bench.clear()
        bench.run(20)
        assert bench.read(number, 0x1018, 3) == right

    def test_wrong_firmware_of_the_drive_speaks_another_protocol(self, bench):
        right = bench.read(1, 0x2001)
        bench.begin("wrong_firmware")
        bench.run(20)
        assert bench.read(1, 0x2001) != right
        bench.clear()
        bench.run(20)
        assert bench.read(1, 0x2001) == right

    def test_of_two_wrong_firmwares_the_last_end_boots_the_right_one(self, bench):
        right = bench.read(1, 0x1018, 3), bench.read(1, 0x2001)
        bench.begin("wrong_firmware duration=0.1")
        bench.run(50)
        bench.begin("wrong_firmware duration=0.1")
        bench.begin("wrong_firmware node=sonar duration=0.3")
        bench.run(80)
        assert bench.read(1, 0x1018, 3) >> 16 != right[0] >> 16
        assert bench.read(1, 0x2001) != right[1]
        bench.run(50)
        assert (bench.read(1, 0x1018, 3), bench.read(1, 0x2001)) == right

    @pytest.mark.parametrize("ppm", [50_000, -20_000])
    def test_the_stamps_of_a_drifting_drive_run_by_so_much_too_fast(self, driving, ppm):
        driving.begin(f"clock_drift node=drive ppm={ppm}")
        driving.drive(2.0)
        frames = driving.of(FEEDBACK)
        true_us = (frames[-1].stamp_ns - frames[0].stamp_ns) / 1000
        own_us = driving.stamps_us()[-1] - driving.stamps_us()[0]
        assert own_us / true_us == pytest.approx(1 + ppm * 1e-6, abs=1.5e-3)
        assert np.diff(driving.stamps_us()).min() > 0
        driving.clear()
        driving.drive(2.0)
        own_us = driving.stamps_us()[-1] - driving.stamps_us()[0]
        assert own_us / true_us == pytest.approx(1.0, abs=1.5e-3)

    @pytest.mark.parametrize(
        ("node", "identifier", "period_ms"),
        [("drive", 0x701, 100), ("sonar", 0x182, 50), ("power", 0x183, 100)],
    )
    def test_the_periods_of_a_node_with_a_fast_clock_are_short(
        self, driving, node, identifier, period_ms
    ):
        driving.begin(f"clock_drift node={node} ppm=100000")
        driving.drive(0.2)
        driving.drive(2.0)
        stamps = [frame.stamp_ns for frame in driving.of(identifier)]
        assert np.mean(np.diff(stamps)) / MS == pytest.approx(period_ms / 1.1, rel=0.02)

    @pytest.mark.parametrize(("ppm", "factor"), [(0, 1.0), (100_000, 1 / 1.1), (-100_000, 1 / 0.9)])
    def test_a_drifting_drive_measures_its_time_out_with_its_own_clock(self, driving, ppm, factor):
        if ppm:
            driving.begin(f"clock_drift ppm={ppm}")
        driving.drive(0.05)
        last_ns = driving.on_wire(COMMAND)[-1].stamp_ns
        driving.wire.clear()
        driving.run(200)
        [emergency] = driving.on_wire(EMCY_DRIVE)
        assert (emergency.stamp_ns - last_ns) / MS == pytest.approx(100 * factor, abs=0.3)


class TestBus:
    @pytest.mark.parametrize("line", ["bus_cut", "bus_short", "host_cut", "node_cut node=drive"])
    def test_no_feedback_comes_through_a_broken_wire_and_it_does_afterwards(self, driving, line):
        driving.begin(f"{line} duration=0.2")
        driving.drive(0.19)
        assert not driving.of(FEEDBACK)
        assert bool(driving.of(SONAR_A)) == line.startswith("node_cut")
        driving.drive(0.3)
        driving.drive(0.2)
        assert driving.of(SONAR_A)

    def test_a_host_that_breaks_its_frames_goes_bus_off_and_comes_back(self, driving):
        driving.begin("host_bus_off duration=0.2")
        driving.drive(0.19)
        assert driving.port.statistics.bus_offs >= 1
        assert not driving.on_wire(COMMAND)
        assert driving.of(SONAR_A)
        driving.drive(0.1)
        assert driving.port.state is ErrorState.ERROR_ACTIVE
        assert driving.on_wire(COMMAND)

    def test_a_node_goes_bus_off_after_32_broken_frames(self, driving):
        driving.begin("node_bus_off node=power duration=0.15")
        port = next(each for each in driving.simulation.bus.ports if each.name == "power")
        while not port.statistics.bus_offs:
            driving.drive(0.005)
        # From 0, TEC grows by 8 with each broken frame and passes 255 with the 32nd.
        assert port.statistics.errors == 32
        assert driving.port.counters.tec == 0

    @pytest.mark.parametrize(
        ("line", "name", "identifier"),
        [("host_error_passive", "host", COMMAND), ("node_error_passive", "drive", FEEDBACK)],
    )
    def test_an_error_passive_node_stays_so_and_its_frames_get_through(
        self, driving, line, name, identifier
    ):
        driving.begin(line)
        driving.drive(0.05)
        port = next(each for each in driving.simulation.bus.ports if each.name == name)
        states = []
        for _ in range(100):
            driving.drive(0.005)
            states.append(port.state)
            assert len(driving.on_wire(identifier)) in (0, 1, 2)
        assert set(states) == {ErrorState.ERROR_PASSIVE}
        assert port.statistics.bus_offs == 0
        driving.drive(0.5)
        assert len(driving.on_wire(identifier)) == pytest.approx(100, abs=2)
        driving.clear()
        driving.drive(1.0)  # each frame that gets through takes one off the counter
        assert port.state is ErrorState.ERROR_ACTIVE

    def test_without_acknowledgement_the_host_is_error_passive_and_never_bus_off(self, driving):
        driving.begin("no_ack duration=0.5")
        driving.drive(0.4)
        assert not driving.on_wire(COMMAND)
        assert driving.port.state is ErrorState.ERROR_PASSIVE
        assert driving.port.counters.tec == 128
        assert driving.of(SONAR_A)
        driving.drive(0.5)
        driving.drive(0.1)
        assert driving.on_wire(COMMAND)

    @pytest.mark.parametrize("first", ["no_ack", "overload"])
    def test_without_acknowledgement_a_stranger_gives_none_whichever_comes_first(
        self, driving, first
    ):
        second = {"no_ack": "overload", "overload": "no_ack"}[first]
        driving.begin(f"{first} duration=0.5")
        driving.run(1)
        driving.begin(f"{second} duration=0.5")
        driving.drive(0.4)
        assert not driving.on_wire(COMMAND)
        assert driving.port.counters.tec == 128

    def test_a_node_that_boots_meanwhile_does_not_acknowledge_either(self, driving):
        driving.begin("no_ack duration=0.5")
        driving.drive(0.1)
        driving.begin("node_reset node=drive")
        driving.drive(0.3)
        assert not driving.on_wire(COMMAND)

    def test_a_stranger_alone_does_not_acknowledge_the_host(self, driving):
        driving.begin("overload load=0.3 duration=0.5")
        driving.begin("node_cut node=drive duration=0.5")
        driving.begin("node_cut node=sonar duration=0.5")
        driving.begin("node_cut node=power duration=0.5")
        driving.run(10)
        driving.wire.clear()
        driving.drive(0.3)
        assert not driving.on_wire(COMMAND)
        assert driving.port.counters.tec == 128
        assert driving.of(0x7FF), "the host acknowledges the stranger"

    def test_babble_of_identifier_0_leaves_nothing_for_others(self, driving):
        driving.begin("babble node=sonar duration=0.2")
        driving.drive(0.19)
        assert {frame.arbitration_id for frame in driving.wire} == {0}
        driving.drive(0.3)
        driving.drive(0.1)
        assert driving.of(FEEDBACK)

    @pytest.mark.parametrize("load", [0.3, 0.9])
    def test_a_stranger_fills_the_share_that_is_asked_for(self, bench, load):
        bench.run(100)
        bench.begin(f"overload load={load} duration=1")
        bench.frames.clear()
        bench.run(990)
        # 0x7FF with eight zero bytes: 108 bits, 13 stuffed in the zeros, 3 between frames.
        [bits] = {round(s.bits / s.frames) for i, s in bench.simulation.bus.statistics.ids.items()
                  if i == 0x7FF}  # fmt: skip
        assert 108 < bits < 135
        assert len(bench.of(0x7FF)) * bits * 1e-6 / 0.99 == pytest.approx(load, rel=0.02)
        bench.run(11)
        bench.frames.clear()
        bench.run(100)
        assert not bench.of(0x7FF)
        assert len(bench.simulation.bus.ports) == 4

    def test_an_overload_behind_all_others_costs_them_no_frame(self, driving):
        driving.begin("overload priority=low load=1 duration=2.5")
        driving.drive(2.4)
        assert len(driving.of(FEEDBACK)) == 480
        assert driving.simulation.bus.load() > 0.99

    def test_an_overload_before_all_others_leaves_them_nothing(self, driving):
        driving.begin("overload priority=high load=1 duration=0.3")
        driving.drive(0.29)
        assert not driving.of(FEEDBACK)
        assert {f.arbitration_id for f in driving.wire[5:]} == {0x002}


class TestTheHost:
    @pytest.mark.parametrize(
        ("tools", "name"),
        [(("host",), "host#2"), (("bridge:vcan0", "host"), "host#2"), (("host",), "controller")],
    )
    def test_a_fault_of_the_host_befalls_the_port_that_commands_the_motors(self, tools, name):
        bench = Bench(tools=tools, name=name)
        bench.drive(0.1)
        for tool in bench.tools:
            tool.send(0x601, b"\x40\x18\x10\x03")
        bench.begin("host_bus_off duration=0.1")
        bench.drive(0.09)
        assert bench.port.statistics.bus_offs >= 1
        assert [tool.statistics.bus_offs for tool in bench.tools] == [0] * len(tools)

    def test_a_node_that_masquerades_is_not_taken_for_the_host(self, bench):
        bench.begin("masquerade duration=0.1")
        bench.run(50)
        bench.begin("host_cut duration=0.1")
        bench.drive(0.04)
        assert not bench.of(FEEDBACK) + bench.of(SONAR_A)

    @pytest.mark.parametrize("commands", [True, False])
    def test_where_several_could_be_the_host_the_fault_is_refused_and_they_are_named(
        self, commands
    ):
        bench = Bench(tools=("host",), name="host#2")
        if commands:
            bench.command()
            bench.tools[0].send(COMMAND, bytes(8))
            bench.run(5)
        with pytest.raises(SimulationError, match="host, host#2 could be the host"):
            bench.begin("host_cut")

    def test_without_a_host_its_fault_is_refused(self, bench):
        bench.port.detach()
        bench.begin("overload")
        with pytest.raises(SimulationError, match="no host is on the bus"):
            bench.begin("host_cut")


class TestFrames:
    def test_destroyed_frames_are_sent_again_until_they_get_through(self, driving):
        driving.begin("frames_destroyed id=0x181 probability=0.3 duration=0.5")
        driving.drive(0.49)
        assert len(driving.of(FEEDBACK)) == 98
        assert sum(driving.simulation.bus.statistics.errors.values()) > 20

    def test_a_corrupt_frame_differs_in_one_bit_and_fails_its_crc(self, driving):
        driving.begin("frames_corrupt id=0x181 duration=0.5")
        driving.drive(0.49)
        assert len(driving.of(FEEDBACK)) == 98
        for frame in driving.of(FEEDBACK):
            data = bytearray(frame.data)
            assert not p01.e2e_p01_check(data, 0xA181, length=8)
            flips = [
                p01.e2e_p01_check(bytearray((int.from_bytes(frame.data, "little") ^ 1 << b)
                                            .to_bytes(8, "little")), 0xA181, length=8)
                for b in range(64)
            ]  # fmt: skip
            assert sum(map(bool, flips)) >= 1

    def test_lost_frames_are_on_the_wire_but_reach_nobody(self, driving):
        driving.begin("frames_lost id=0x181 duration=0.3")
        driving.drive(0.29)
        assert len(driving.on_wire(FEEDBACK)) == 58
        assert not driving.of(FEEDBACK)

    def test_repeated_frames_come_in_equal_pairs(self, driving):
        driving.begin("frames_repeated id=0x181 duration=0.3")
        driving.drive(0.29)
        data = [frame.data for frame in driving.of(FEEDBACK)]
        assert len(data) == 116
        assert data[::2] == data[1::2]

    def test_a_stale_frame_is_the_last_true_one_again(self, driving):
        driving.drive(0.05)
        driving.begin("frames_stale id=0x181 duration=0.3")
        driving.drive(0.29)
        data = [frame.data for frame in driving.of(FEEDBACK)]
        assert len(data) == 58
        assert set(data) == {data[0]}
        driving.drive(0.1)
        assert len({frame.data for frame in driving.of(FEEDBACK)}) >= 17

    def test_reordered_frames_come_in_swapped_pairs(self, driving):
        driving.begin("frames_reordered id=0x181 duration=0.3")
        driving.drive(0.28)
        stamps = driving.stamps_us()
        assert len(stamps) == 56
        assert np.all(stamps[::2] - stamps[1::2] == pytest.approx(5000, abs=1000))
        assert np.all(np.diff(np.sort(stamps)) == pytest.approx(5000, abs=1000))

    def test_late_frames_come_so_much_later(self, driving):
        driving.begin("frames_late id=0x181 delay=0.012 duration=0.3")
        driving.drive(0.25)
        syncs = [frame.stamp_ns for frame in driving.on_wire(0x080)]
        late = [frame.stamp_ns for frame in driving.of(FEEDBACK)]
        assert (late[0] - syncs[0]) / MS == pytest.approx(12.15, abs=0.1)

    def test_the_drive_takes_no_command_of_a_masquerader(self, bench):
        bench.run(50)
        bench.begin("masquerade duration=0.5")
        bench.run(500)
        assert len(bench.on_wire(COMMAND)) == pytest.approx(100, abs=2)
        assert not bench.simulation.plant.powered
        assert bench.read(1, 0x2100, 1) == 0
        assert bench.read(1, 0x2100, 2) == pytest.approx(100, abs=2)


@pytest.mark.parametrize(
    "line",
    ["encoder_stuck", "encoder_reversed", "wheel_blocked", "under_voltage volts=3", "brown_out"],
)
def test_a_fault_begins_and_ends_at_its_time_though_nobody_has_looked_at_the_robot(line):
    """The robot is simulated when something touches it; here once as well right before a fault."""

    def run(*, looked_at):
        bench = Bench()
        bench.drive(0.5)
        simulation = bench.simulation
        now_ns = simulation.now_ns
        if looked_at:
            for due_ns in (now_ns + 4 * MS, now_ns + 12 * MS):
                simulation.bus.schedule(due_ns, lambda: simulation.run_to(simulation.now_ns))
        bench.run(4)
        bench.begin(f"{line} duration=0.008")
        bench.run(20)
        simulation.run_to(simulation.now_ns)
        stage, plant = simulation.faults.stage, simulation.plant
        counts = [axis.socket.count for axis in stage.axes]
        return counts, plant.axes[0].speed_rad_s, plant.x_m

    assert run(looked_at=False) == run(looked_at=True)


class TestLines:
    @pytest.mark.parametrize(
        ("line", "problem"),
        [
            ("encoder_stck", "fault 'encoder_stck': unknown; did you mean \"encoder_stuck\"?"),
            ("CLEAR", "fault 'CLEAR': unknown; did you mean \"clear\"?"),
            ("\x1c", f"fault '': unknown, allowed: {', '.join([*CATALOGUE, 'clear'])}"),
            ("encoder_stuck wheel", "fault encoder_stuck: 'wheel' is not of the form key=value"),
            ("node_cut node=drive node=sonar", "fault node_cut: node is given twice"),
            (
                "encoder_stuck weel=left",
                (
                    "fault encoder_stuck: weel: unknown, allowed: wheel, duration; "
                    'did you mean "wheel"?'
                ),
            ),
            (
                "encoder_stuck wheel=middle",
                (
                    "fault encoder_stuck: wheel: 'middle', the differential drive has no such "
                    "wheel, allowed: left, right, drive"
                ),
            ),
            ("bus_cut duration=long", "fault bus_cut: duration: 'long' is no number"),
            ("bus_cut duration=0x", "fault bus_cut: duration: '0x' is no number"),
            (
                f"bus_cut duration=0x{999 * 'f'}",
                "fault bus_cut: duration: '0xffffffffff...fffffffffffff' is no number",
            ),
            ("bus_cut duration=nan", "fault bus_cut: duration: nan, allowed: 0.001 to 3600"),
            ("frames_lost id=513.5", "fault frames_lost: id: 513.5 is no whole number"),
            ("frames_lost id=nan", "fault frames_lost: id: nan is no whole number"),
            (
                "frames_lost id=0xA0000000",
                "fault frames_lost: id: 2684354560, allowed: 0 to 2684354559",
            ),
            ("bus_cut duration=0", "fault bus_cut: duration: 0, allowed: 0.001 to 3600"),
        ],
    )
    def test_a_wrong_line_is_refused_with_what_is_allowed(self, bench, line, problem):
        with pytest.raises(SimulationError) as caught:
            bench.simulation.faults.inject(line)
        assert str(caught.value) == problem

    def test_a_fault_ends_by_itself_after_its_duration(self, driving):
        driving.begin("encoder_stuck duration=0.1")
        driving.drive(0.2)
        left = driving.counts()[:, 0]
        assert np.ptp(left[:19]) == 0
        assert np.diff(left[21:]).min() > 0


@pytest.mark.parametrize(("robot", "seed"), [("diff_drive", 1), ("tricycle", 2), ("ackermann", 3)])
def test_after_any_mixture_of_faults_the_robot_is_as_sound_as_before(robot, seed):
    bench = Bench(robot)
    rng = np.random.default_rng(seed)
    robot_file = bench.simulation.config
    felt = [
        name
        for name, kind in CATALOGUE.items()
        if not any(kind.fits(robot_file, kind.complete({})))
    ]
    bench.drive(0.5, 0.2, 0.2)
    for _ in range(200):
        name = str(rng.choice(felt))
        duration = f" duration={rng.uniform(0.05, 0.5):.3f}"
        bench.begin(name + (duration if "duration" in CATALOGUE[name].parameters else ""))
        bench.drive(0.05, 0.2, 0.2)
    bench.clear()
    bench.drive(1.0, 0.0, 0.0, enable=False)
    for node in (1, 2, 3):  # what was lost must be stored anew
        bench.port.send(0x600 + node, b"\x23\x10\x10\x01save")
    bench.run(10)
    bench.begin("node_reset node=drive")  # a trip of its guards stays latched otherwise
    bench.run(20)
    bench.port.send(0x000, b"\x01\x00")
    bench.drive(0.5, 0.0, 0.0, enable=False)
    simulation = bench.simulation
    assert {port.name for port in simulation.bus.ports} == {"drive", "sonar", "power", "host"}
    assert {port.state for port in simulation.bus.ports} <= {
        ErrorState.ERROR_ACTIVE, ErrorState.ERROR_WARNING,
    }  # fmt: skip
    before, true = bench.counts()[-1], bench.true_counts()
    bench.drive(0.5, 0.15, 0.15)
    assert len(bench.of(FEEDBACK)) == 100
    assert simulation.plant.powered
    moved = bench.true_counts() - true
    assert moved[0] > 20
    assert bench.counts()[-1] - before == pytest.approx(moved, abs=0.05 * moved.max() + 1)
    status = bench.status()
    assert status["faults"] == 0
    assert status["current1_a"] == pytest.approx(simulation.plant.axes[0].current_a, abs=0.1)
    assert status["temperature1_c"] == pytest.approx(simulation.plant.axes[0].temperature_c, abs=1)
    assert bench.voltage_v() == pytest.approx(simulation.plant.bus_voltage_v, abs=0.1)
    assert np.diff(bench.stamps_us()) == pytest.approx(5000, abs=1001)
    for node in (1, 2, 3):
        assert bench.read(node, 0x1018, 3) >> 16 == 1


def test_every_default_is_allowed():
    for kind in CATALOGUE.values():
        for key, value in kind.complete({}).items():
            assert kind.value(key, value) == value


def test_the_catalogue_can_be_had_without_a_compiler():
    code = (
        "import sys; import firmware_sim.faults.scenario; "
        "assert not {'numba', 'firmware_sim.plant.plant'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_kind_stands_in_a_test_of_the_simulator():
    files = Path(__file__).parents[1].rglob("test_*.py")
    source = "".join(file.read_text(encoding="utf-8") for file in files)
    assert [name for name in CATALOGUE if f'"{name}' not in source] == []


@pytest.mark.parametrize("line", ["{}", "{} a", "{} a=1 a=2", "bus_cut {}", "bus_cut {}=1"])
def test_very_long_words_of_a_fault_are_shortened(bench, line):
    with pytest.raises(SimulationError) as caught:
        bench.simulation.faults.inject(line.format("x" * 5000))
    assert len(str(caught.value)) < 1000
    assert "xxx...xxx" in str(caught.value)
