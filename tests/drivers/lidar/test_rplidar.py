"""The driver of RPLIDARs, on a pseudo terminal, and beside another client of the protocol."""

import math
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rplidar import RPLidar

from robotctl.drivers.lidar.rplidar import Rplidar, SampleReader
from robotctl.errors import LinkError
from robotctl.runtime.clock import RealClock
from tests.drivers.lidar.rplidar_double import RplidarDouble, node, revolution

RANGES_M = 0.5 + 0.01 * np.arange(360)


def sweeps(lidar, count, deadline_s=10.0):
    """Return the next revolutions."""
    found = []
    end = time.monotonic() + deadline_s
    while len(found) < count:
        assert time.monotonic() < end, "no revolution came"
        if (sweep := lidar.read()) is not None:
            found.append(sweep)
    return found


@pytest.fixture
def opened():
    """Return a function that opens the driver on a double."""
    lidars = []

    def open_on(double):
        lidars.append(Rplidar(double.device, 115200, RealClock()))
        return lidars[-1]

    yield open_on
    for each in lidars:
        each.close()


def test_a_revolution_is_as_it_was_sent_and_turns_the_other_way_round(opened):
    with RplidarDouble(2 * revolution(RANGES_M) + node(True, 0.0, 1.0)) as double:
        sweep = sweeps(opened(double), 1)[0]
    assert len(sweep.ranges_m) == 360
    assert sweep.ranges_m == pytest.approx(RANGES_M, abs=1e-4)
    assert sweep.angles_rad == pytest.approx(-np.radians(np.arange(360)), abs=math.radians(1 / 64))
    assert np.all(np.diff(sweep.stamps_ns) >= 0)


def test_another_client_of_the_protocol_reads_the_same(opened):
    stream = revolution(RANGES_M, 0.25) + node(True, 0.0, 1.0)
    with RplidarDouble(stream) as double:
        ours = sweeps(opened(double), 1)[0]
    with RplidarDouble(stream) as double:
        client = RPLidar(double.device)
        client._serial.setDTR = lambda _: None  # a pseudo terminal has no such line
        theirs = [each for _, each in zip(range(360), client.iter_measures(), strict=False)]
        client.disconnect()
    assert [each[0] for each in theirs] == [True] + 359 * [False]
    assert -np.degrees(ours.angles_rad) == pytest.approx([each[2] for each in theirs])
    assert 1000.0 * ours.ranges_m == pytest.approx([each[3] for each in theirs])


def test_what_comes_before_the_first_beginning_is_no_revolution(opened):
    cut = revolution(RANGES_M)[100 * 5 + 3 :]
    with RplidarDouble(cut + revolution(RANGES_M) + node(True, 0.0, 1.0)) as double:
        assert len(sweeps(opened(double), 1)[0].ranges_m) == 360


def test_no_measurement_is_told_from_a_range(opened):
    ranges = RANGES_M.copy()
    ranges[10:20] = 0.0
    with RplidarDouble(revolution(ranges) + node(True, 0.0, 1.0)) as double:
        sweep = sweeps(opened(double), 1)[0]
    assert np.flatnonzero(np.isnan(sweep.ranges_m)).tolist() == list(range(10, 20))


@given(st.data())
def test_samples_in_a_damaged_stream_are_found_again(data):
    """Whatever is cut out of a stream, wherever its lumps end, all goes on behind the damage."""
    stream = revolution(RANGES_M)
    first = data.draw(st.integers(0, 300 * 5))
    lost = data.draw(st.integers(1, 40))
    stream = stream[:first] + stream[first + lost :]
    size = data.draw(st.integers(1, 700))
    reader = SampleReader()
    parts = [reader.feed(stream[k : k + size]) for k in range(0, len(stream), size)]
    ranges = np.concatenate([part.ranges_m for part in parts])
    whole = first // 5
    assert ranges[:whole] == pytest.approx(RANGES_M[:whole], abs=1e-4)
    assert ranges[-10:] == pytest.approx(RANGES_M[-10:], abs=1e-4)


@given(st.binary(max_size=600))
def test_random_bytes_give_samples_in_range_or_none(data):
    samples = SampleReader().feed(data)
    assert np.all((samples.angles_rad <= 0.0) & (samples.angles_rad > -math.radians(512.0)))
    assert not np.any(samples.ranges_m <= 0.0)


def test_the_motor_is_started_and_the_lidar_is_stopped_at_the_end():
    with RplidarDouble(revolution(RANGES_M) + node(True, 0.0, 1.0)) as double:
        lidar = Rplidar(double.device, 115200, RealClock())
        sweeps(lidar, 1)
        # The example of the manual for SET_PWM 660: A5 F0 02 94 02 and the xor of these.
        assert double.asked == [
            b"\xa5\x25",
            b"\xa5\x50",
            b"\xa5\x52",
            b"\xa5\xf0\x02\x94\x02\xc1",
            b"\xa5\x20",
        ]
        lidar.close()
        deadline = time.monotonic() + 5.0
        while len(double.asked) < 7:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert double.asked[5:] == [b"\xa5\x25", b"\xa5\xf0\x02\x00\x00\x57"]


def test_a_fault_that_a_reset_ends_is_none(opened):
    with RplidarDouble(revolution(RANGES_M) + node(True, 0.0, 1.0)) as double:
        double.health = [b"\x02\x34\x12", b"\x00\x00\x00"]
        assert len(sweeps(opened(double), 1)) == 1
        assert b"\xa5\x40" in double.asked


def test_a_fault_that_stays_is_said_with_its_code(opened):
    with (
        RplidarDouble(health=b"\x02\x34\x12") as double,
        pytest.raises(LinkError, match="reports a fault, code 0x1234"),
    ):
        opened(double)


def test_a_device_that_does_not_answer_is_said(opened):
    with (
        RplidarDouble(mute=True) as double,
        pytest.raises(LinkError, match="0 of 7 bytes came in answer to a5 50"),
    ):
        opened(double)


def test_another_device_is_told_by_its_answer(opened):
    with RplidarDouble() as double:
        double._answer = lambda _: double.send(b"$GPGGA,12")
        with pytest.raises(LinkError, match="which an RPLIDAR does not; is baud right"):
            opened(double)


def test_a_device_that_is_not_there_is_said(tmp_path):
    with pytest.raises(LinkError, match="none"):
        Rplidar(str(tmp_path / "none"), 115200, RealClock())


def test_a_lidar_that_falls_silent_is_said(opened):
    with RplidarDouble(revolution(RANGES_M)) as double:
        lidar = opened(double)
        with pytest.raises(LinkError, match="no samples for 3 s"):
            sweeps(lidar, 2)


def test_samples_are_stamped_over_the_time_of_their_revolution(opened):
    """Turns of 0.1 s, sent in lumps: the stamps of the third lie between those of its ends."""
    with RplidarDouble(revolution(RANGES_M)) as double:
        lidar = opened(double)
        begin_ns = time.monotonic_ns()
        found = []
        while len(found) < 3 and time.monotonic_ns() - begin_ns < 10e9:
            turn = revolution(RANGES_M)
            for k in range(0, len(turn), 300):
                double.send(turn[k : k + 300])
                found += [each for each in [lidar.read()] if each is not None]
                time.sleep(0.0167)
        sweep = found[-1]
        assert begin_ns < sweep.stamps_ns[0] <= sweep.stamps_ns[-1] <= time.monotonic_ns()
        assert 0.05e9 < sweep.stamps_ns[-1] - sweep.stamps_ns[0] < 2e9


def test_an_unplugged_lidar_is_said(opened):
    double = RplidarDouble(revolution(RANGES_M))
    lidar = opened(double)
    double.close()
    with pytest.raises(LinkError, match=Path(double.device).name):
        sweeps(lidar, 2)
