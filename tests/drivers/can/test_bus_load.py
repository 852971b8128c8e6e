import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.drivers.can.bus_load import (
    MAX_LOAD,
    budget,
    nominal_bits,
    transmission_type,
    worst_case_bits,
)
from robotctl.drivers.can.bus_meter import FRAME_BITS


def stuffed_length(arbitration_id, data):
    """Bits of a classic frame with its stuff bits and the interframe space, bit by bit."""
    bits = [0] + [arbitration_id >> n & 1 for n in range(10, -1, -1)] + [0, 0, 0]
    bits += [len(data) >> n & 1 for n in range(3, -1, -1)]
    bits += [byte >> n & 1 for byte in data for n in range(7, -1, -1)]
    crc = 0
    for bit in bits:
        crc = (crc << 1) ^ (0x4599 if (crc >> 14 & 1) ^ bit else 0)
        crc &= 0x7FFF
    bits += [crc >> n & 1 for n in range(14, -1, -1)]
    stuffing, run, before = 0, 0, None
    for bit in bits:
        run = run + 1 if bit == before else 1
        before = bit
        if run == 5:
            stuffing += 1
            run, before = 1, 1 - bit
    return len(bits) + stuffing + 1 + 2 + 7 + 3


@settings(max_examples=400, deadline=None)
@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_no_frame_is_longer_than_the_worst_case_or_shorter_than_the_nominal_one(can_id, data):
    length = stuffed_length(can_id, data)
    assert nominal_bits(len(data)) <= length <= worst_case_bits(len(data))
    assert abs(FRAME_BITS[len(data)] - length) <= 0.11 * length


def test_the_worst_cases_are_those_of_the_literature():
    assert worst_case_bits(8) == 135
    assert worst_case_bits(0) == 55


@pytest.mark.parametrize("steered", [False, True])
@pytest.mark.parametrize("rate_hz", [100, 200, 500, 1000])
def test_the_budget_is_kept_at_every_rate_of_the_loop(dbc, rate_hz, steered):
    load = budget(dbc, rate_hz, dbc.bitrate, sonars=16, steered=steered, imu=True)
    assert 0 < load.total <= MAX_LOAD == 0.5


def test_the_default_rate_takes_what_a_sum_by_hand_says(dbc):
    hertz_and_bytes = [(200, 0), (200, 8), (200, 8), (50, 8), (50, 8), (20, 8), (20, 8), (10, 8)]
    hertz_and_bytes += [(10, 1)] * 3
    bits = sum(hertz * (55 + 10 * length) for hertz, length in hertz_and_bytes)
    assert budget(dbc, 200, 1_000_000, sonars=8).total == pytest.approx(bits / 1e6)


def test_an_imu_takes_a_hundred_frames_a_second_and_its_heartbeat(dbc):
    without, with_imu = (budget(dbc, 200, 1_000_000, imu=imu).total for imu in (False, True))
    assert with_imu - without == pytest.approx((100 * 135 + 10 * 65) / 1e6)


def test_the_rows_add_up_and_stand_in_the_order_of_urgency(dbc):
    load = budget(dbc, 200, 500_000, sonars=4)
    assert load.total == pytest.approx(sum(row.load for row in load.rows))
    ids = [row.arbitration_id for row in load.rows]
    assert ids == sorted(ids)
    names = {row.name for row in load.rows}
    assert "SonarRangesA" in names
    assert "SonarRangesB" not in names
    assert "EmergencyStop" not in names


def test_a_steered_robot_hears_of_its_steering_on_every_sync(dbc):
    [row] = [r for r in budget(dbc, 500, 1_000_000, steered=True).rows if r.name == "DriveStatus"]
    assert row.period_ms == 2.0


@pytest.mark.parametrize(
    ("rate_hz", "every"), [(25, 1), (100, 2), (200, 4), (1000, 20), (100_000, 240)]
)
def test_status_frames_keep_their_20_ms_at_any_rate(dbc, rate_hz, every):
    sync = dbc.message("Sync")
    for steered in (False, True):
        for name, wanted in (("MotorStatus", every), ("WheelFeedback", 1)):
            found = transmission_type(dbc.message(name), sync, rate_hz, steered=steered)
            assert found == wanted
    assert transmission_type(dbc.message("DriveStatus"), sync, rate_hz, steered=True) == 1
