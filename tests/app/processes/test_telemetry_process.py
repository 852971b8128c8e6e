"""The telemetry process tells what stands in the robot's file."""

from robotctl.app.processes.telemetry import described
from robotctl.config.robot_file import find_file, load_robot


def test_the_robot_is_described_as_its_file_does() -> None:
    settings = ("localisation.sonar.max_range_m=2.5", "localisation.sonar.beam_deg=15.0")
    config = load_robot(find_file("tricycle"), settings)
    robot = described(config)
    assert (robot.sonar.max_range_m, robot.sonar.beam_deg) == (2.5, 15.0)
    assert [mount.name for mount in robot.sonars] == [mount.name for mount in config.sonar]
    assert (robot.name, robot.has_localiser) == ("tricycle", False)
