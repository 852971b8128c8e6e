import pytest
from can.util import len2dlc
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.config.robot_file import config_directory, load_robot
from robotctl.drivers.can.bus_load import (
    MAX_LOAD,
    FrameBits,
    budget,
    nominal_bits,
    transmission_type,
    worst_case_bits,
)
from robotctl.drivers.can.bus_meter import BusMeter
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.dbc import load_dbc
from robotctl.errors import ConfigError
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, FD_LENGTHS
from tests.drivers.can.dbc_files import FORMATS, HEAD
from tests.drivers.can.drives.drive_rig import DriveRig

BUS = CanConfig()
FD_BUS = CanConfig(data_bitrate=5_000_000)


def stuff_bits(bits, last=True):
    """Stuff bits of a sequence, counted one by one; without `last` none follows the last bit."""
    found, run, before = 0, 0, None
    for place, bit in enumerate(bits):
        run = run + 1 if bit == before else 1
        before = bit
        if run == 5 and (last or place < len(bits) - 1):
            found += 1
            run, before = 1, 1 - bit
    return found


def binary(value, width):
    return [value >> n & 1 for n in range(width - 1, -1, -1)]


def identifier_bits(can_id, remote_or_fd):
    """Start of frame, identifier, RTR or RRS, and IDE of an 11-bit one."""
    if can_id & EXTENDED_FLAG:
        plain = binary(can_id & 0x1FFFFFFF, 29)
        return [0, *plain[:11], 1, 1, *plain[11:], remote_or_fd]
    return [0, *binary(can_id & 0x7FF, 11), remote_or_fd, 0]


def classic_bits(can_id, data):
    """Bits of a classic data frame with its stuff bits and the interframe space, bit by bit."""
    reserved = [0, 0] if can_id & EXTENDED_FLAG else [0]
    bits = [*identifier_bits(can_id, 0), *reserved, *binary(len(data), 4)]
    bits += [bit for byte in data for bit in binary(byte, 8)]
    crc = 0
    for bit in bits:
        crc = (crc << 1) ^ (0x4599 if (crc >> 14 & 1) ^ bit else 0)
        crc &= 0x7FFF
    bits += binary(crc, 15)
    return FrameBits(len(bits) + stuff_bits(bits) + 1 + 2 + 7 + 3)


def fd_bits(can_id, data, switch):
    """Bits of a frame of CAN FD at both rates, likewise."""
    head = [*identifier_bits(can_id, 0), 1, 0, switch]
    body = [0, *binary(len2dlc(len(data)), 4), *(bit for byte in data for bit in binary(byte, 8))]
    in_head = stuff_bits(head)
    in_body = stuff_bits([*head, *body], last=False) - in_head
    crc_field = 4 + (17 if len(data) <= 16 else 21)
    fixed = (crc_field + 3) // 4
    return FrameBits(len(head) + in_head + 12, len(body) + in_body + crc_field + fixed + 1)


PLAIN = st.one_of(
    st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda each: each | EXTENDED_FLAG)
)
FRAMES = st.one_of(
    st.tuples(PLAIN, st.binary(max_size=8)),
    st.tuples(
        PLAIN.map(lambda each: each | FD_FLAG),
        st.sampled_from(FD_LENGTHS).flatmap(
            lambda size: st.one_of(
                st.binary(min_size=size, max_size=size),
                st.sampled_from([bytes(size), b"\xf0" * size, b"\x87\x87" * (size // 2)]),
            )
        ),
    ),
)


@settings(max_examples=200, deadline=None)
@given(FRAMES, st.booleans())
def test_no_frame_is_longer_than_the_worst_case_or_shorter_than_the_nominal_one(frame, switch):
    can_id, data = frame
    length = fd_bits(can_id, data, switch) if can_id & FD_FLAG else classic_bits(can_id, data)
    shortest, longest = nominal_bits(can_id, len(data)), worst_case_bits(can_id, len(data))
    assert shortest.nominal <= length.nominal <= longest.nominal
    assert shortest.data <= length.data <= longest.data
    estimate = BusMeter(FD_BUS).measure(can_id, len(data)) / FD_BUS.bitrate
    assert abs(estimate - length.seconds(FD_BUS)) <= 0.12 * length.seconds(FD_BUS)


def test_the_worst_cases_are_those_of_the_literature():
    """Davis et al. for classic frames: 8 n + g + 13 + floor((g + 8 n - 1) / 4), g = 34 or 54."""
    assert worst_case_bits(0x7FF, 8) == (135, 0)
    assert worst_case_bits(0x7FF, 0) == (55, 0)
    for n in range(9):
        for can_id, g in ((0, 34), (EXTENDED_FLAG, 54)):
            assert worst_case_bits(can_id, n).nominal == 8 * n + g + 13 + (g + 8 * n - 1) // 4


def test_the_longest_frame_of_can_fd_takes_the_time_of_a_sum_by_hand():
    """64 bytes, 11-bit identifier: 32 slow bits; 5 + 512 + 129 + 33 fast ones."""
    assert worst_case_bits(FD_FLAG, 64) == (32, 679)
    assert worst_case_bits(FD_FLAG, 64).seconds(FD_BUS) == pytest.approx(32e-6 + 679 * 0.2e-6)


def test_a_port_measures_only_frames_that_its_bus_carries():
    assert BusMeter(BUS).measure(FD_FLAG | 1, 8) == 0
    assert BusMeter(BUS).measure(EXTENDED_FLAG | 1, 9) == 0
    assert BusMeter(FD_BUS).measure(FD_FLAG | 1, 9) == 0
    assert BusMeter(FD_BUS).measure(FD_FLAG | 1, 65) == 0
    assert BusMeter(BUS).measure(EXTENDED_FLAG | 1, 8) == 146


def test_the_budget_counts_29_bit_identifiers_and_both_bit_rates(tmp_path):
    path = tmp_path / "robot.dbc"
    path.write_text(
        HEAD
        + 'BO_ 128 Sync: 0 HOST\n\nBO_ 2147484033 Long: 8 DRIVE\n SG_ A : 0|8@1+ (1,0) [0|0] "" X\n'
        + '\nBO_ 2 Fast: 64 DRIVE\n SG_ A : 0|8@1+ (1,0) [0|0] "" X\n\n'
        + 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;\nBA_DEF_DEF_ "GenMsgCycleTime" 10;\n'
        + FORMATS
        + 'BA_ "VFrameFormat" BO_ 2 14;\n'
    )
    load = budget(load_dbc(path), 100, FD_BUS)
    assert [(row.name, row.bits) for row in load.rows] == [
        ("Long", (160, 0)),
        ("Fast", (32, 679)),
        ("Sync", (55, 0)),
    ]
    assert load.total == pytest.approx(100 * (160e-6 + 32e-6 + 679 * 0.2e-6 + 55e-6))
    with pytest.raises(ConfigError, match=r"Fast is a message of CAN FD, but can.data_bitrate"):
        budget(load_dbc(path), 100, BUS)


@pytest.mark.parametrize("steered", [False, True])
@pytest.mark.parametrize("rate_hz", [100, 200, 500, 1000])
def test_the_budget_is_kept_at_every_rate_of_the_loop(dbc, rate_hz, steered):
    load = budget(
        dbc, rate_hz, CanConfig(bitrate=dbc.bitrate), sonars=16, steered=steered, imu=True
    )
    assert 0 < load.total <= MAX_LOAD == 0.5


def test_the_default_rate_takes_what_a_sum_by_hand_says(dbc):
    hertz_and_bytes = [(200, 0), (200, 8), (200, 8), (50, 8), (50, 8), (20, 8), (20, 8), (10, 8)]
    hertz_and_bytes += [(10, 1)] * 3
    bits = sum(hertz * (55 + 10 * length) for hertz, length in hertz_and_bytes)
    assert budget(dbc, 200, BUS, sonars=8).total == pytest.approx(bits / 1e6)


def test_an_imu_takes_a_hundred_frames_a_second_and_its_heartbeat(dbc):
    without, with_imu = (budget(dbc, 200, BUS, imu=imu).total for imu in (False, True))
    assert with_imu - without == pytest.approx((100 * 135 + 10 * 65) / 1e6)


def test_four_odrives_at_200_hz_take_what_a_sum_by_hand_says(dbc):
    """Each: command, two requests without data, their answers, and what comes by itself."""
    config = load_robot(config_directory() / "skid_steer.toml")
    frames = [each for motor in config.motors for each in motor.traffic(config.safety, 200)]
    everything = {"DRIVE", "SONAR", "POWER", "IMU"}
    load = budget(dbc, 200, BUS, elsewhere=everything, foreign=frames)
    by_hand = 4 * (200 * (135 + 2 * 55 + 2 * 135) + 10 * 135 + 100 * 135)
    assert load.total == pytest.approx(by_hand / 1e6)
    assert 0.45 < load.total < MAX_LOAD


@pytest.mark.parametrize(
    "robot", ["odrive", "skid_steer", "vesc_car", "moteus", "mecanum", "cia402", "zlac8015d"]
)
def test_a_robot_that_drives_takes_no_more_of_the_simulated_bus_than_its_budget(dbc, robot):
    """The bus counts the bits of each frame as they are; the budget's are the worst case."""
    rig = DriveRig(robot).commission()
    rig.drive(1.0, 1200)
    (measured,) = (bus.load() for bus in rig.simulation.buses.values())
    config, wanted = rig.config, {part.status.name.upper() for part in rig.parts.ours}
    frames = [each for motor in config.motors
              for each in motor.traffic(config.safety, config.runtime.rate_hz)]  # fmt: skip
    load = budget(
        dbc,
        config.runtime.rate_hz,
        config.buses[0],
        sonars=len(config.sonar),
        elsewhere={"DRIVE", "SONAR", "POWER", "IMU"} - wanted,
        foreign=frames,
    )
    assert 0.7 * load.total < measured < load.total


def test_frames_of_can_fd_need_a_data_bit_rate(dbc):
    config = load_robot(config_directory() / "moteus.toml")
    frames = config.motors[0].traffic(config.safety, 200)
    with pytest.raises(ConfigError, match="moteus_left command is a frame of CAN FD"):
        budget(dbc, 200, BUS, foreign=frames)


def test_the_rows_add_up_and_stand_in_the_order_of_urgency(dbc):
    load = budget(dbc, 200, CanConfig(bitrate=500_000), sonars=4)
    assert load.total == pytest.approx(sum(row.load for row in load.rows))
    ids = [row.arbitration_id for row in load.rows]
    assert ids == sorted(ids)
    names = {row.name for row in load.rows}
    assert "SonarRangesA" in names
    assert "SonarRangesB" not in names
    assert "EmergencyStop" not in names


def test_a_steered_robot_hears_of_its_steering_on_every_sync(dbc):
    [row] = [r for r in budget(dbc, 500, BUS, steered=True).rows if r.name == "DriveStatus"]
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
