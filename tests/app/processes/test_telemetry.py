"""The telemetry process tells what stands in the robot's file."""

from pathlib import Path

from robotctl.app.processes.plan_files import PlanFiles
from robotctl.app.processes.telemetry import described
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.geometry.se2 import SE2


def test_the_robot_is_described_as_its_file_does() -> None:
    settings = ("localisation.sonar.max_range_m=2.5", "localisation.sonar.beam_deg=15.0")
    config = load_robot(find_file("tricycle"), settings)
    robot = described(config, StackOptions("x", "", x_m=1.0, y_m=2.0))
    assert (robot.sonar.max_range_m, robot.sonar.beam_deg) == (2.5, 15.0)
    assert [mount.name for mount in robot.sonars] == [mount.name for mount in config.sonar]
    assert (robot.name, robot.has_localiser, robot.plans) == ("tricycle", False, False)
    assert robot.home == SE2(1.0, 2.0, 0.0)


def test_a_mission_is_kept_in_its_folder_and_nowhere_without_one(tmp_path: Path) -> None:
    files = PlanFiles(str(tmp_path), "mission")
    assert files.load() == b""
    first = files.save(b"a mission")
    files.keep(b"a mission")
    assert Path(first).read_bytes() == b"a mission"
    assert PlanFiles(str(tmp_path), "mission").load() == b"a mission"
    second = files.save(b"another one")
    assert Path(first).exists()
    assert (
        PlanFiles(str(tmp_path), "mission").load() == b"a mission"
    )  # a power cut before it was taken
    files.keep(b"another one")
    assert not Path(first).exists()
    assert Path(second).read_bytes() == PlanFiles(str(tmp_path), "mission").load() == b"another one"
    files.keep(b"")
    assert files.load() == b""
    assert PlanFiles("", "mission").save(b"a mission") == ""
    PlanFiles("", "mission").keep(b"")
    assert PlanFiles(str(tmp_path / "gone"), "mission").save(b"a mission") == ""
