"""Logs of whole runs with everything on: each message fits its schema, each frame hangs together.

jsonschema judges the messages, the truth of the simulator the poses.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.formats.robotctl_log import read_own
from robotctl.logs.formats.tum import read_tum
from tests.app.simulation.missions import PATROL
from tests.logs.mcap.schema_check import checked_topics

CAMERA = ("camera.enabled=true",)
MCL = ('localisation.method="mcl"', "localisation.mapping=true")
EKF = ('localisation.method="ekf"',)
STATES = {"control", "navigation", "notice", "frames", "T_world_base", "sensor_frames"}
STATES |= {"sonar_cones", "outline", "goal"}
BELIEFS = {"localisation", "lidar", "map", "covariance"}
PLANS = {"path", "costs", "arc", "obstacles"}
"""Of robots that know ways: with a map or a lidar."""


def recorded(folder: Path, robot: str, **options: Any) -> Path:
    run_lockstep(SimOptions(find_file(robot), PATROL, record=folder, **options))
    return folder / "robot-0001.mcap"


def messages(log: Path, topic: str) -> Iterator[tuple[int, Any]]:
    with log.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topic):
            yield message.log_time, json.loads(message.data)


@pytest.fixture(scope="module")
def with_everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(
        tmp_path_factory.mktemp("mcl"),
        "diff_drive",
        localisation=MCL,
        overrides=CAMERA,
        faults=find_file("sensors", "scenarios"),
        max_seconds=25.0,
    )


def test_messages_of_a_run_with_particles_map_camera_and_faults_fit_their_schemas(
    with_everything: Path,
) -> None:
    topics = checked_topics(with_everything)
    assert set(topics) == STATES | BELIEFS | PLANS | {"camera", "seen", "live_map", "particles"}
    assert topics["map"] == 1
    assert topics["control"] == topics["frames"] > 300


@pytest.mark.parametrize(
    ("robot", "options", "expected"),
    [
        ("tricycle", {"localisation": EKF}, STATES | PLANS | {"localisation", "map", "covariance"}),
        ("ackermann", {"localisation": ("localisation.mapping=true",)}, STATES | {"live_map"}),
        ("diff_drive", {"faults": find_file("bad_day", "scenarios")}, STATES),
        ("diff_drive", {"faults": find_file("bus", "scenarios")}, STATES),
    ],
)
def test_messages_of_other_runs_fit_their_schemas(
    robot: str, options: dict[str, Any], expected: set[str], tmp_path: Path
) -> None:
    log = recorded(tmp_path, robot, max_seconds=12.0, **options)
    assert set(checked_topics(log)) - {"lidar"} == expected


def test_what_is_missing_and_what_is_infinite_stand_in_the_log_of_a_run(
    with_everything: Path,
) -> None:
    sonars = [each for _, state in messages(with_everything, "control") for each in state["sonars"]]
    assert any("range_m" in each for each in sonars)
    assert any(each["out_of_range"] for each in sonars)
    assert any("range_m" not in each and not each["out_of_range"] for each in sonars)
    assert {each["name"] for each in sonars} >= {"front", "rear_left"}
    scans = [scan for _, scan in messages(with_everything, "lidar")]
    assert all(
        0.0 <= each <= scan["max_range"] or each == 1e6 for scan in scans for each in scan["ranges"]
    )


def test_every_frame_hangs_below_world(with_everything: Path) -> None:
    parents: dict[str, str] = {}
    for topic in ("frames", "sensor_frames"):
        for _, message in messages(with_everything, topic):
            for each in message["transforms"]:
                parents[each["child_frame_id"]] = each["parent_frame_id"]
    assert parents["odom"] == "world"
    assert parents["base"] == "odom"
    sensors = {child for child, parent in parents.items() if parent == "base"}
    assert sensors >= {"lidar", "camera", "sonar_front", "sonar_rear"}
    assert set(parents) == {"odom", "base"} | sensors
    used = {
        message["frame_id"]
        for topic in ("lidar", "map", "live_map", "particles", "T_world_base")
        for _, message in messages(with_everything, topic)
    }
    assert used == {"world", "base"}


def test_the_logged_pose_of_base_in_world_is_where_the_robot_was(with_everything: Path) -> None:
    truth = read_tum(with_everything.parent / "truth-0001.tum")
    poses = list(messages(with_everything, "T_world_base"))
    assert len(poses) > 300
    for time_ns, message in poses:
        true = truth.at(time_ns)
        if true is None:  # before the first truth
            continue
        at = message["pose"]["position"]
        assert math.hypot(at["x"] - true.x_m, at["y"] - true.y_m) < 0.25
        assert message["timestamp"] == {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}


def test_the_log_of_a_run_is_read_back_as_a_drive(with_everything: Path) -> None:
    drive = read_own(with_everything)
    assert len(drive.odometry.stamps_ns) > 300
    assert drive.believed is not None
    assert len(drive.scans) > 150
    assert len(drive.sonars) > 500
    heard = [each for entry in drive.sonars for each in entry.reading.ranges_m]
    assert any(map(math.isinf, heard))
    assert any(map(math.isfinite, heard))
