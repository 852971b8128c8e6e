"""Faults of encoders, motors, supply and sonars against physics, seen on the bus."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_sim.errors import SimulationError
from firmware_sim.plant.axis import Mode
from tests.firmware_sim.faults.fault_bench import FEEDBACK, HEARTBEAT_DRIVE, SONAR_A, SONAR_B, Bench


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
