"""Checks of the computer on folders that stand for computers."""

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.config.robot_file import find_file, load_robot
from robotctl.deploy.check_result import Finding, Verdict
from robotctl.deploy.doctor import _check_wakeups
from robotctl.deploy.doctor_host import (
    MIN_FREE_BYTES,
    MIN_WRITE_BYTES_S,
    check_camera,
    check_clock_source,
    check_disk,
    check_governor,
    check_isolation,
    check_lidars,
    check_preemption,
    check_serial,
    check_space,
    check_time_sync,
    check_write_speed,
    parse_cpu_list,
)
from robotctl.deploy.wakeup import Wakeups, check_lag, check_rights, check_timer_slack
from robotctl.model.sensors.camera import CameraConfig, CameraIntrinsics, CameraMount
from robotctl.model.sensors.lidar import LidarConfig

OK, WARN, FAIL, NONE = Verdict.OK, Verdict.WARN, Verdict.FAIL, Verdict.NONE
RT = "Linux version 6.6.31-rt31-v8+ (gcc 12) #1 SMP PREEMPT_RT Thu"
NO_RT = "Linux version 6.6.31-v8+ (gcc 12) #1 SMP PREEMPT Thu"


def computer(root: Path, **files: str) -> Path:
    """Make files; `__` in a name stands for `/`."""
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    return root


def assert_is(finding: Finding, verdict: Verdict, *words: str) -> None:
    assert finding.verdict is verdict, finding
    for word in words:
        assert word in finding.found + finding.fix
    assert bool(finding.fix) == (verdict in {WARN, FAIL}), "a fix for each failure, and only there"
    assert "\n" not in finding.fix


def test_a_real_time_kernel_is_seen_by_its_file_or_by_its_version(tmp_path: Path) -> None:
    by_version = computer(tmp_path / "a", proc__version=RT)
    by_file = computer(tmp_path / "b", proc__version=NO_RT, sys__kernel__realtime="1")
    neither = computer(tmp_path / "c", proc__version=NO_RT, sys__kernel__realtime="0")
    assert_is(check_preemption(by_version), OK, "6.6.31-rt31-v8+")
    assert_is(check_preemption(by_file), OK)
    assert_is(check_preemption(neither), WARN, "6.6.31-v8+", "deploy.md")
    assert_is(check_preemption(tmp_path / "empty"), WARN)


def test_each_processor_with_another_governor_is_named(tmp_path: Path) -> None:
    files = {f"sys__devices__system__cpu__cpu{i}__cpufreq__scaling_governor": "performance" for i in range(3)}  # noqa: E501  # fmt: skip
    assert_is(check_governor(computer(tmp_path / "a", **files)), OK, "3 processors")
    files["sys__devices__system__cpu__cpu1__cpufreq__scaling_governor"] = "ondemand"
    finding = check_governor(computer(tmp_path / "b", **files))
    assert_is(finding, WARN, "cpu1 ondemand", "performance", "service sets it at each start")
    assert "cpu0" not in finding.found
    assert_is(check_governor(tmp_path / "none"), NONE)


@pytest.mark.parametrize(
    ("source", "verdict"),
    [("tsc", OK), ("arch_sys_counter", OK), ("hpet", WARN), ("jiffies", WARN)],
)
def test_slow_clock_sources_are_warned_of(tmp_path: Path, source: str, verdict: Verdict) -> None:
    root = computer(
        tmp_path, sys__devices__system__clocksource__clocksource0__current_clocksource=source
    )
    assert_is(check_clock_source(root), verdict, source)
    assert_is(check_clock_source(tmp_path / "none"), NONE)


@pytest.mark.parametrize(
    ("online", "isolated", "cpu", "verdict", "words"),
    [
        ("0-3", "3", 3, OK, "isolated: 3"),
        ("0-3", "", 3, WARN, "isolcpus=3"),
        ("0-3", "2", 3, WARN, "isolcpus=3"),
        ("0-3", "", -1, WARN, "runtime.cpu = 3"),
        ("0-3", "2-3", -1, WARN, "runtime.cpu = 3"),
        ("0-3", "", 4, FAIL, "one of 0, 1, 2, 3"),
        ("0-2", "3", 3, FAIL, "no such processor"),
        ("0-1", "", -1, NONE, "too few"),
    ],
)
def test_the_control_loop_wants_an_isolated_processor_where_there_are_enough(
    tmp_path: Path, online: str, isolated: str, cpu: int, verdict: Verdict, words: str
) -> None:
    root = computer(
        tmp_path,
        sys__devices__system__cpu__online=online,
        sys__devices__system__cpu__isolated=isolated,
    )
    assert_is(check_isolation(root, cpu), verdict, words)


@given(st.sets(st.integers(0, 40)))
def test_a_processor_list_is_read_as_the_kernel_writes_it(cpus: set[int]) -> None:
    parts, ordered = [], sorted(cpus)
    while ordered:
        first = last = ordered.pop(0)
        while ordered and ordered[0] == last + 1:
            last = ordered.pop(0)
        parts.append(str(first) if first == last else f"{first}-{last}")
    assert parse_cpu_list(",".join(parts)) == cpus


def test_time_is_synchronised_unless_the_kernel_says_otherwise() -> None:
    assert_is(check_time_sync(0x0001), OK)
    assert_is(check_time_sync(0x0041), WARN, "timedatectl")
    assert_is(check_time_sync(None), NONE)


def test_disks_fail_just_below_their_limits(tmp_path: Path) -> None:
    assert_is(check_space(tmp_path, MIN_FREE_BYTES), OK, "1.0 GB")
    assert_is(check_space(tmp_path, MIN_FREE_BYTES - 1), FAIL, str(tmp_path))
    assert_is(check_write_speed(tmp_path, MIN_WRITE_BYTES_S), OK, "2.0 MB/s")
    assert_is(check_write_speed(tmp_path, MIN_WRITE_BYTES_S - 1), FAIL, "SD card")


def test_the_write_test_finds_a_parent_that_exists_and_leaves_nothing_behind(
    tmp_path: Path,
) -> None:
    space, speed = check_disk(tmp_path / "not" / "there" / "yet")
    assert str(tmp_path) in space.found
    assert speed.check == "write speed"
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_cannot_be_written_fails_with_the_reason() -> None:
    findings = check_disk(Path("/proc/sys"))
    assert_is(findings[-1], FAIL, "/proc/sys", "--logs")


def test_logs_below_a_folder_that_is_closed_to_us_are_no_reason_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def closed(path: Path, **options: object) -> os.stat_result:
        if Path(path).is_relative_to(tmp_path / "shut"):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return stat(path, **options)

    stat = os.stat
    monkeypatch.setattr(os, "stat", closed)
    space, _ = check_disk(tmp_path / "shut" / "today")
    assert f"for {tmp_path}" in space.found


@pytest.mark.parametrize("below", ["", "logs/of/today"])
@pytest.mark.parametrize("what", ["file", "dangling link"])
def test_logs_go_into_no_file(tmp_path: Path, below: str, what: str) -> None:
    path = tmp_path / "logs"
    if what == "file":
        path.write_text("notes")
    else:
        path.symlink_to(tmp_path / "gone")
    (finding,) = check_disk(path / below)
    assert_is(finding, FAIL, f"{path} is not a folder", "--logs")


def test_cameras_and_serial_lines_need_read_and_write_rights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = computer(tmp_path, dev__video0="", dev__ttyUSB0="")
    camera = camera_at("0")
    assert_is(check_camera(camera, root), OK, "video0")
    assert_is(check_camera(camera_at("/dev/video0"), root), OK, "video0")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert_is(check_camera(camera, root), FAIL, "usermod -aG video")
    assert_is(check_serial(["/dev/ttyUSB0"], root)[0], FAIL, "usermod -aG dialout")
    assert_is(check_serial(["/dev/ttyUSB7"], root)[0], FAIL, "is not there")
    assert_is(check_serial([], root)[0], NONE)


def camera_at(source: str, *, enabled: bool = True) -> CameraConfig:
    lens, mount = CameraIntrinsics(640, 480, 500.0, 500.0, 320.0, 240.0), CameraMount(0.0, 0.0, 0.2)
    return CameraConfig(lens, mount, source, enabled=enabled)


def test_the_camera_that_the_robot_looks_with_is_tried_and_no_other(tmp_path: Path) -> None:
    root = computer(tmp_path, dev__video0="", film="")
    assert_is(check_camera(camera_at("7"), root), FAIL, "video7 is not there")
    assert_is(check_camera(camera_at("/nowhere.avi"), root), FAIL, "nowhere.avi is not there")
    assert_is(check_camera(camera_at(str(tmp_path / "film")), Path("/")), OK, "may be read")
    assert_is(check_camera(camera_at("sim"), root), NONE, "sim")
    assert_is(check_camera(camera_at("rtsp://host/stream"), root), NONE, "rtsp://host/stream")
    assert_is(check_camera(camera_at("7", enabled=False), root), NONE, "camera.enabled")
    assert_is(check_camera(None, root), NONE)


def wakeups(p99_us: float = 50.0, max_us: float = 100.0, **changes: object) -> Wakeups:
    values: dict = {
        "refused": (),
        "slack_ns": 1,
        "ticks": 1000,
        "overruns": 0,
        "lag_us_p50": 20.0,
        "lag_us_p99": p99_us,
        "lag_us_max": max_us,
        "period_us": 5000.0,
    }
    return Wakeups(**(values | changes))


def test_wake_ups_are_judged_by_the_period() -> None:
    assert_is(check_lag(wakeups(500.0, 2500.0)), OK, "p99 500", "max 2500")
    assert_is(check_lag(wakeups(501.0, 2500.0)), WARN, "tenth")
    assert_is(check_lag(wakeups(100.0, 2501.0)), FAIL, "half a period")


def test_refused_rights_fail_with_the_kernels_words_and_the_user() -> None:
    assert_is(check_rights(wakeups(), "root"), OK)
    refused = wakeups(refused=("SCHED_FIFO priority 60 refused (Operation not permitted)",))
    assert_is(check_rights(refused, "pi"), FAIL, "as pi", "SCHED_FIFO", "robotctl install")


def test_timer_slack_of_a_normal_process_is_warned_of() -> None:
    assert_is(check_timer_slack(wakeups(slack_ns=1)), OK)
    assert_is(check_timer_slack(wakeups(slack_ns=50_000)), WARN, "50000 ns")


def test_a_user_without_a_name_is_named_by_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(number: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {number}")

    for variable in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr("pwd.getpwuid", nobody)
    monkeypatch.setattr("os.geteuid", lambda: 12345)
    monkeypatch.setattr("robotctl.deploy.doctor.measure_in_a_process", lambda *_: wakeups())
    rights, *_ = _check_wakeups(load_robot(find_file("diff_drive")), 0.1)
    assert_is(rights, OK, "user 12345")


def test_a_lidar_of_our_driver_needs_its_device(tmp_path: Path) -> None:
    lidar = LidarConfig("rplidar", device="/dev/ttyUSB3")
    [missing] = check_lidars([lidar], tmp_path)
    assert missing.verdict is FAIL
    assert str(tmp_path / "dev/ttyUSB3") in missing.found
    computer(tmp_path, dev__ttyUSB3="")
    assert check_lidars([lidar], tmp_path)[0].verdict is OK


@pytest.mark.parametrize("lidars", [[], [LidarConfig("socket", device="/nowhere")]])
def test_a_lidar_of_somebody_else_is_not_looked_for(
    tmp_path: Path, lidars: list[LidarConfig]
) -> None:
    assert check_lidars(lidars, tmp_path)[0].verdict is NONE


def test_each_of_several_lidars_is_looked_for(tmp_path: Path) -> None:
    computer(tmp_path, dev__ttyUSB3="")
    lidars = [LidarConfig("rplidar", device=f"/dev/ttyUSB{number}") for number in (3, 4)]
    assert [each.verdict for each in check_lidars(lidars, tmp_path)] == [OK, FAIL]
