"""Faults of nodes against CANopen, seen on the bus."""

from __future__ import annotations

import numpy as np
import pytest

from tests.firmware_sim.faults.fault_bench import (
    COMMAND,
    DRIVE_STATUS,
    EMCY_DRIVE,
    FEEDBACK,
    HEARTBEAT_DRIVE,
    MS,
    PARAMETERS_LOST,
    SONAR_A,
    STATUS,
)


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
