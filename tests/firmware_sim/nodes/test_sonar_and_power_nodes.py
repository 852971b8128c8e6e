"""Sonar ring and battery monitor on a line."""

from __future__ import annotations

import itertools
import math

import pytest

from firmware_sim.nodes.power import BatterySample, PowerNode
from firmware_sim.nodes.sonar import SonarNode

MS = 1_000_000
INF, NAN = math.inf, math.nan


class Ring:
    def __init__(self, ranges=(1.0, 1.0, 1.0, 1.0)):
        self.ranges = ranges
        self.fired = []

    def __call__(self, group, now_ns):
        self.fired.append((group, now_ns))
        return self.ranges


def operational_ring(line, count=8, ranges=(1.0, 1.0, 1.0, 1.0), max_range_m=4.0):
    ring = Ring(ranges)
    line.add(SonarNode(count, max_range_m, ring))
    line.start_all()
    return ring


class TestSonar:
    def test_groups_fire_in_turn_half_a_ring_period_apart(self, line):
        ring = operational_ring(line)
        line.run_ms(200)
        assert ring.fired == [(n % 2, (20 + 25 * n) * MS) for n in range(9)]

    @pytest.mark.parametrize(
        ("count", "ids"),
        [
            (0, []),
            (1, [0x182]),
            (4, [0x182]),
            (5, [0x182, 0x282]),
            (12, [0x182, 0x282, 0x382]),
            (16, [0x182, 0x282, 0x382, 0x482]),
        ],
    )
    def test_each_group_sends_once_a_ring_period(self, line, count, ids):
        operational_ring(line, count)
        line.run_ms(1000)
        for arbitration_id in (0x182, 0x282, 0x382, 0x482):
            expected = 20 if arbitration_id in ids else 0
            assert abs(len(line.frames(arbitration_id)) - expected) <= bool(expected)

    @pytest.mark.parametrize(
        ("ranges", "farthest_m"),
        [((0.343, 1.715, NAN, NAN), 1.715), ((0.343, INF, NAN, 1.0), 4.0), ((NAN,) * 4, 0.0)],
    )
    def test_the_frame_leaves_when_the_last_echo_is_in(self, line, ranges, farthest_m):
        operational_ring(line, 4, ranges)
        line.run_ms(40)
        [frame] = line.frames(0x182)
        flight_ns = 2 * farthest_m / 343.0 * 1e9
        assert frame.stamp_ns - 20 * MS == pytest.approx(flight_ns + 500_000, abs=2)

    def test_the_frame_says_what_was_heard(self, line, database):
        operational_ring(line, 6, (0.5, INF, NAN, NAN))
        line.run_ms(100)
        decoded = database.decode_message(
            "SonarRangesB", line.frames(0x282)[0].data, decode_choices=False
        )
        assert [decoded[f"Range{n}"] for n in (4, 5, 6, 7)] == pytest.approx(
            [0.5, 8.191, 8.190, 8.190]
        )

    def test_a_short_ring_period_keeps_the_frames_in_order(self, line):
        operational_ring(line, 16, (INF,) * 4)
        line.deliver(0x602, bytes.fromhex("2b01220014000000"))
        line.run_ms(1000)
        sent = [frame for frame in line.sent if frame.arbitration_id & 0x7F == 2][4:]
        ids = [frame.arbitration_id for frame in sent if frame.arbitration_id < 0x500]
        assert len(ids) > 100
        for here, after in itertools.pairwise(ids):
            assert (after - here) % 0x400 == 0x100

    def test_it_is_silent_outside_operational_and_starts_anew(self, line):
        ring = operational_ring(line)
        line.run_ms(30)
        line.deliver(0, b"\x80\x00")
        before = len(line.frames(0x182))
        line.run_ms(500)
        assert len(line.frames(0x182)) == before
        line.deliver(0, b"\x01\x00")
        line.run_ms(10)
        assert ring.fired[-1] == (0, 550 * MS)

    @pytest.mark.parametrize("count", [-1, 17])
    def test_impossible_rings_are_refused(self, count):
        with pytest.raises(ValueError, match=r"0\.\.16"):
            SonarNode(count, 4.0, Ring())


class Cells:
    def __init__(self):
        self.sample = BatterySample(12.0, 1.5, 0.75, 25.0)

    def __call__(self, now_ns):
        return self.sample


@pytest.fixture
def cells(line):
    cells = Cells()
    line.add(PowerNode(cells, 3))
    line.start_all()
    return cells


class TestPower:
    def battery(self, line, database):
        return database.decode_message("Battery", line.frames(0x183)[-1].data)

    def test_a_measurement_comes_every_100_ms(self, line, cells, database):
        line.run_ms(1000)
        frames = line.frames(0x183)
        assert [f.stamp_ns for f in frames] == [(120 + 100 * n) * MS for n in range(10)]
        decoded = self.battery(line, database)
        assert decoded["Voltage"] == pytest.approx(12.0)
        assert decoded["Current"] == pytest.approx(1.5)
        assert decoded["Charge"] == pytest.approx(75.0)
        assert decoded["Temperature"] == 25

    def test_low_and_critical_have_limits_and_hysteresis(self, line, cells, database):
        for voltage_v, low, critical in (
            (10.6, 0, 0),
            (10.4, 1, 0),
            (10.6, 1, 0),
            (9.5, 1, 1),
            (9.7, 1, 1),
            (9.9, 1, 0),
            (10.8, 0, 0),
        ):
            cells.sample = cells.sample._replace(voltage_v=voltage_v)
            line.run_ms(100)
            decoded = self.battery(line, database)
            assert (decoded["BatteryLow"], decoded["BatteryCritical"]) == (low, critical)

    def test_a_critical_battery_is_an_emergency_until_it_is_over(self, line, cells):
        cells.sample = cells.sample._replace(voltage_v=9.0)
        line.run_ms(500)
        cells.sample = cells.sample._replace(voltage_v=12.0)
        line.run_ms(500)
        assert [f.data.hex() for f in line.frames(0x083)] == [
            "2032050000000000",
            "0000000000000000",
        ]

    def test_the_limits_can_be_set(self, line, cells, database):
        line.deliver(0x603, bytes.fromhex("2b002300ff2f0000"))
        line.run_ms(100)
        assert self.battery(line, database)["BatteryLow"] == 1
