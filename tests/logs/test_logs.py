"""The log of states over several files: each can be shown by itself."""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader

from robotctl.config.robot_file import find_file, load_robot
from robotctl.logs.logs import StateLog, scene_of
from robotctl.logs.mcap.entries import MAP_NS
from robotctl.messages.estimation import (
    GivenMap,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
)
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder
from tests.logs.mcap.schema_check import checked_topics
from tests.mavlink.conftest import control_state

CONFIG = load_robot(
    find_file("diff_drive"),
    ("camera.enabled=true", 'localisation.method="mcl"', 'localisation.map="flat"'),
)
SECOND = 1_000_000_000
GIVEN = LiveMap(0, 1, 2, 0.05, -1.0, -1.0, b"\x00\x64")
SCAN = LidarScan(0, 0.1, 0.0, -1.0, 1.0, 8.0, bytes(12))
BELIEF = LocalisationState(0, "mcl", LocalisationStatus.LOCALISED, 5.0, 6.0, 0.0, (0.0,) * 6)


@pytest.fixture
def folder(tmp_path: Path) -> LogFolder:
    return LogFolder(tmp_path, LogConfig(file_mb=0.002, total_mb=100.0))


def at(message: Any, second: float) -> Any:
    return msgspec.structs.replace(message, stamp_ns=round(second * SECOND))


def contents(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            found.setdefault(channel.topic, []).append(json.loads(message.data))
    return found


def test_each_file_has_sensor_frames_the_map_and_where_odom_lies(folder: LogFolder) -> None:
    log = StateLog(folder, 0, "rover", scene_of(CONFIG))
    begin = [at(GivenMap(0, GIVEN), 1), at(SCAN, 1), at(BELIEF, 1), control_state(SECOND)]
    log.step(begin, SECOND)
    for tenth in range(11, 60):
        log.step([control_state(tenth * SECOND // 10)], tenth * SECOND // 10)
    log.close()
    paths = sorted(folder.directory.glob("robot-*.mcap"))
    assert len(paths) > 2
    for path in paths:
        checked_topics(path)
        found = contents(path)
        (chart,) = found["map"]
        assert chart["column_count"] == 2
        children = {each["child_frame_id"] for each in found["sensor_frames"][-1]["transforms"]}
        assert children >= {"camera", "lidar", "sonar_front"}
        assert all(len(each["transforms"]) == 2 for each in found["frames"])
        assert found["T_world_base"][0]["pose"]["position"]["x"] == pytest.approx(6.0)


def test_a_map_that_grows_is_logged_now_and_then_and_as_it_is_in_the_end(
    tmp_path: Path,
) -> None:
    log = StateLog(LogFolder(tmp_path, LogConfig()), 0, "rover")
    for half in range(21):
        grown = LiveMap(half * SECOND // 2, 1, 2, 0.05, 0.0, 0.0, bytes((half, 0)))
        log.step([grown], grown.stamp_ns)
    log.close()
    times_s = [
        chart["timestamp"]["sec"] + 1e-9 * chart["timestamp"]["nsec"]
        for chart in contents(tmp_path / "robot-0001.mcap")["live_map"]
    ]
    period_s = MAP_NS / SECOND
    assert times_s == [0.0, period_s, 2.0 * period_s]
    log = StateLog(LogFolder(tmp_path, LogConfig()), 0, "rover")
    for second in (0, 1, 2):
        log.step([LiveMap(second * SECOND, 1, 1, 0.05, 0.0, 0.0, bytes((second,)))], 0)
    log.close()
    maps = contents(tmp_path / "robot-0002.mcap")["live_map"]
    assert [each["timestamp"]["sec"] for each in maps] == [0, 2]


def test_a_map_that_stays_the_same_is_logged_once(tmp_path: Path) -> None:
    log = StateLog(LogFolder(tmp_path, LogConfig()), 0, "rover")
    for second in range(0, 60, 10):
        log.step([at(GivenMap(0, at(GIVEN, second)), second)], second * SECOND)
    log.close()
    assert len(contents(tmp_path / "robot-0001.mcap")["map"]) == 1


def test_frames_come_with_each_second_state_of_a_control_process_at_50_hz(tmp_path: Path) -> None:
    log = StateLog(LogFolder(tmp_path, LogConfig()), 0, "rover")
    jitter_ns = (0, 900_000, -700_000, 400_000)
    for number in range(100):
        stamp_ns = SECOND + number * 20_000_000 + jitter_ns[number % 4]
        log.step([control_state(stamp_ns)], stamp_ns)
    log.close()
    found = contents(tmp_path / "robot-0001.mcap")
    assert len(found["control"]) == 100
    assert len(found["frames"]) == len(found["T_world_base"]) == 50


def test_what_is_no_scan_does_not_end_the_log(tmp_path: Path) -> None:
    log = StateLog(LogFolder(tmp_path, LogConfig()), 0, "rover")
    wrong = msgspec.structs.replace(SCAN, ranges=b"123")
    infinite = msgspec.structs.replace(SCAN, x_m=math.inf)
    log.step([wrong, infinite, SCAN, ParticleCloud(0, bytes(24))], 0)
    log.close()
    found = contents(tmp_path / "robot-0001.mcap")
    assert len(found["lidar"]) == len(found["particles"]) == 1
