"""Times of logs: units, ranges, clocks that wrap or stand still."""

import numpy as np
import pytest

from robotctl.errors import CalibrationError, ConfigError
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.times import unwrapped, usual_pace
from robotctl.logs.formats.tum import read_tum
from robotctl.model.trajectory import Trajectory

WALL_S = 1305031102.0
UNITS = [("ms", 1e3), ("us", 1e6), ("ns", 1e9)]


def carmen(folder, times, odometry=(), first="", way_m=0.2):
    lines = [
        f"FLASER 4 1.0 2.0 3.0 4.0 {way_m * i} 0 0 {way_m * i} 0.5 0 {time:.15g} host 0"
        for i, time in enumerate(times)
    ]
    lines += [f"ODOM {way_m * i} 0.5 0 0 0 0 {t:.15g} host 0" for i, t in enumerate(odometry)]
    path = folder / "drive.log"
    path.write_text("\n".join([first, *lines]) + "\n")
    return path


def mrclam(folder, times):
    folder.mkdir()
    np.savetxt(folder / "Barcodes.dat", np.array([[6, 60]]), "%d")
    (folder / "Landmark_Groundtruth.dat").write_text("6 1 2 0 0\n")
    rows = [f"{time:.15g} 0.2 0.0" for time in times]
    (folder / "Robot1_Odometry.dat").write_text("# t v w\n" + "\n".join(rows) + "\n")
    (folder / "Robot1_Measurement.dat").write_text("")
    truth = [f"{time:.15g} {0.2 * i} 0 0" for i, time in enumerate(times)]
    (folder / "Robot1_Groundtruth.dat").write_text("\n".join(truth) + "\n")
    return folder


def lego(folder, times):
    path = folder / "robot_motors.txt"
    rows = [f"M {time:.15g} {600 * i} 0 0 0 {600 * i} 0" for i, time in enumerate(times)]
    path.write_text("\n".join(rows) + "\n")
    return path


SECONDS = WALL_S + 0.5 * np.arange(40)


@pytest.mark.parametrize(("unit", "factor"), UNITS)
@pytest.mark.parametrize("kind", ["carmen", "mrclam", "tum"])
def test_wall_times_of_another_unit_are_refused_with_line_range_and_unit(
    tmp_path, kind, unit, factor
):
    times = factor * SECONDS
    if kind == "tum":
        path = tmp_path / "a.tum"
        path.write_text("\n".join(f"{time:.15g} 0 0 0 0 0 0 1" for time in times))
        read, name = read_tum, r"a\.tum:1"
    elif kind == "carmen":
        path, read, name = carmen(tmp_path, times), read_recording, r"drive\.log:2"
    else:
        path, read, name = mrclam(tmp_path / "set", times), read_recording, r"Odometry\.dat:2"
    allowed = r"time 1\.?3\S+ s: allowed are -100000 to 9.2e\+09 s"
    advice = r", which this file must not" if kind == "tum" else rf"\? Then give --time-unit {unit}"
    message = rf"{name}: {allowed}; are the times {unit}{advice}$"
    with pytest.raises(LogFormatError, match=message):
        read(path)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), *UNITS])
def test_with_its_unit_each_kind_is_read_as_in_seconds(tmp_path, unit, factor):
    expected = np.rint(1e9 * (SECONDS - SECONDS[0]))
    landmarks = mrclam(tmp_path / "set", factor * SECONDS)
    read = {
        "carmen": read_recording(carmen(tmp_path, factor * SECONDS), time_unit=unit).odometry,
        "mrclam": read_recording(landmarks, time_unit=unit).reference,
        "lego": read_recording(lego(tmp_path, factor * SECONDS), time_unit=unit).odometry,
    }  # fmt: skip
    for kind, trajectory in read.items():
        assert trajectory.stamps_ns[0] == pytest.approx(1e9 * WALL_S, abs=1e3), kind
        assert trajectory.stamps_ns - trajectory.stamps_ns[0] == pytest.approx(expected, abs=1e3)


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e8])
@pytest.mark.parametrize("kind", [carmen, lambda folder, times: mrclam(folder / "set", times)])
def test_times_from_0_of_another_unit_let_the_robot_creep_and_are_refused(tmp_path, kind, factor):
    path = kind(tmp_path, factor * (SECONDS - SECONDS[0]))
    with pytest.raises(LogFormatError, match=r"drives .* m/s; allowed are 0\.005 to 50 .*--time-u"):
        read_recording(path)
    if factor == 1e3:
        assert read_recording(path, time_unit="s").reference is not None
    else:  # nobody drives for years
        with pytest.raises(LogFormatError, match=r"the log lasts .* s; allowed are up to 1e\+06 s"):
            read_recording(path, time_unit="s")


@pytest.mark.parametrize("factor", [1e6, 1e9, 0.001])
def test_ticks_whose_times_are_no_milliseconds_are_refused(tmp_path, factor):
    with pytest.raises(LogFormatError, match="allowed are"):
        read_recording(lego(tmp_path, factor * (SECONDS - SECONDS[0])))


def test_a_robot_that_stands_or_hardly_moves_has_no_pace(tmp_path):
    path = carmen(tmp_path, 1e3 * (SECONDS - SECONDS[0]), way_m=1e-4)
    assert len(read_recording(path).scans) == 40


def test_the_pace_is_that_of_the_robot_while_it_drives():
    stamps_ns = (1e9 * np.cumsum(np.where(np.arange(400) % 40 == 0, 500.0, 0.1))).astype(np.int64)
    poses = np.stack([0.05 * np.arange(400), np.zeros(400), np.zeros(400)], axis=1)
    assert usual_pace(Trajectory(stamps_ns, poses)) == pytest.approx(0.5)


def test_a_time_out_of_range_is_named_wherever_it_stands(tmp_path):
    times = SECONDS.copy()
    times[7] = -3e6
    with pytest.raises(
        LogFormatError, match=r"drive\.log:9: time -3000000 s: allowed are -100000 to"
    ):
        read_recording(carmen(tmp_path, times))


@pytest.mark.parametrize(
    ("begin", "seconds"),
    [
        (4294967290.0, 4294967290.0), (4294964592.0, 4294964592.0), (2147483640.0, 2147483640.0)
    ],
)  # fmt: skip
def test_a_clock_of_32_bits_that_wraps_goes_on(tmp_path, begin, seconds):
    true = begin + 100.0 * np.arange(40)
    times = np.where(true >= 2.0**32, true - 2.0**32, true)
    if begin < 2.0**31:  # a signed one
        times = np.where(true >= 2.0**31, true - 2.0**32, true)
    recording = read_recording(carmen(tmp_path, times, times), time_unit="s")
    stamps_ns = np.array([entry.scan.stamp_ns for entry in recording.scans])
    assert stamps_ns == pytest.approx(1e9 * true)
    assert recording.odometry.stamps_ns == pytest.approx(1e9 * true)
    assert any("wraps" in note for note in recording.notes)


def test_a_clock_goes_on_alike_for_lines_of_all_kinds(tmp_path):
    path = tmp_path / "drive.log"
    path.write_text(
        "ODOM 0 0 0 0 0 0 4294967290 h 0\nODOM 0 0 0 0 0 0 4294967295 h 0\n"
        "FLASER 1 2.0 0 0 0 1 0 0 3 h 0\nODOM 1 0 0 0 0 0 5 h 0\n"
    )
    recording = read_recording(path)
    assert recording.scans[0].scan.stamp_ns == (2**32 + 3) * 10**9
    assert recording.odometry.stamps_ns[-1] == (2**32 + 5) * 10**9


def test_only_steps_of_2_to_the_32_are_wraps():
    times = np.array([0.0, 1071078718.0, 5.0, 3e9, 100.0])
    assert unwrapped(times).tolist() == times.tolist()
    below = unwrapped(np.array([10.0, 3.0, 2.0**32 - 4.0]))
    assert below.tolist() == [2.0**32 + 10.0, 2.0**32 + 3.0, 2.0**32 - 4.0]


def test_equal_times_are_said(tmp_path):
    every = read_recording(carmen(tmp_path, np.zeros(12))).notes
    assert any("all 12 scans have one time, 0 s" in note for note in every)
    some = read_recording(carmen(tmp_path, np.array([1.0, 2.0, 2.0, 3.0]))).notes
    assert any("1 of 4 FLASER scans have the time of the previous one" in note for note in some)
    none = read_recording(carmen(tmp_path, np.arange(4.0))).notes
    assert not any("time" in note for note in none)


def test_a_unit_that_is_none_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"--time-unit m: must be one of s, ms, us, ns"):
        read_recording(carmen(tmp_path, SECONDS), time_unit="m")


def test_nothing_is_calibrated_by_a_log_without_times(tmp_path):
    from robotctl.config.robot_file import find_file, load_robot
    from robotctl.workbench.odometry.calibrate_odometry import calibrate_odometry
    from robotctl.workbench.odometry.options import OdometryCalibrateOptions
    from robotctl.workbench.sensors.sources import source_of_log

    path = carmen(tmp_path, np.zeros(40), np.zeros(40))
    with pytest.raises(CalibrationError, match="all scans in it have one time"):
        source_of_log(path, "", "", load_robot(find_file("diff_drive")))
    with pytest.raises(CalibrationError, match="one time, so they cannot be matched"):
        calibrate_odometry(OdometryCalibrateOptions(find_file("diff_drive"), log=path))
