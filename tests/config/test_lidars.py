"""One lidar or several in a robot's file."""

from pathlib import Path

import pytest

from robotctl.config.robot_file import find_file, load_robot, robot_of_json, robot_to_json
from robotctl.errors import ConfigError

FRONT = '[[lidar]]\nname = "front"\ndriver = "rplidar"\ndevice = "/dev/ttyUSB0"\nx_m = 0.2\n'
REAR = '[[lidar]]\nname = "rear"\ndriver = "rplidar"\ndevice = "/dev/ttyUSB1"\nx_m = -0.2\n'


@pytest.fixture
def robot(tmp_path: Path):
    """Return a function that writes a robot's file with some tables more."""

    def write(tables: str) -> Path:
        path = tmp_path / "robot.toml"
        path.write_text(find_file("diff_drive").read_text("utf-8") + "\n" + tables, "utf-8")
        return path

    return write


def test_a_robot_has_none_one_or_several(robot):
    assert load_robot(robot("")).lidars == ()
    one = load_robot(robot('[lidar]\ndriver = "socket"\n'))
    assert [each.name for each in one.lidars] == [""]
    two = load_robot(robot(FRONT + REAR))
    assert [(each.name, each.x_m) for each in two.lidars] == [("front", 0.2), ("rear", -0.2)]
    assert robot_of_json(robot_to_json(two)).lidars == two.lidars


@pytest.mark.parametrize(
    ("tables", "reason"),
    [
        (FRONT + REAR.replace("rear", "front"), r"lidar\[1\]\.name: must differ .* found 'front'"),
        (FRONT + REAR.replace("USB1", "USB0"), r"lidar\[1\]\.device: must differ .*ttyUSB0"),
        (
            FRONT + REAR.replace('"rplidar"', '"socket"'),
            r"lidar\[1\]\.driver: 'socket' found, beside",
        ),
    ],
)
def test_two_of_one_name_line_or_socket_are_refused(robot, tables, reason):
    with pytest.raises(ConfigError, match=reason):
        load_robot(robot(tables))
