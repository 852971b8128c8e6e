"""What a user asks of a simulated run: the bus is checked as a robot's file is."""

from pathlib import Path

import pytest

from robotctl.app.processes.navigator import load_mission
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import bus_overrides
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError


def on(bus: str) -> SimOptions:
    return SimOptions(Path("robot"), Path("mission"), bus=bus)


@pytest.mark.parametrize(
    ("bus", "channel"),
    [
        ("simcan", ("simcan", "simcan0")),
        ("simcan:other", ("simcan", "other")),
        ("simcan:/run/a b/hub", ("simcan", "/run/a b/hub")),
        ("vcan0", ("socketcan", "vcan0")),
    ],
)
def test_a_bus_is_an_interface_and_a_channel(bus: str, channel: tuple[str, str]) -> None:
    interface, name = channel
    assert on(bus).channels([""]) == (interface, (name,))


TWO_BUSES = """[[can]]
channel = "can0"

[[can]]
name = "sensors"
channel = "can1"
bitrate = 500_000
"""


@pytest.fixture
def two_buses(tmp_path: Path) -> Path:
    text = find_file("diff_drive").read_text()
    head, rest = text.split("[can]\n")
    _, rest = rest.split("\n\n", 1)
    path = tmp_path / "two.toml"
    path.write_text(f"{head}{TWO_BUSES}\n{rest}")
    return path


@pytest.mark.parametrize(
    ("bus", "interface", "channels"),
    [
        ("simcan", "simcan", ("simcan0", "simcan0-sensors")),
        ("simcan:/run/hub", "simcan", ("/run/hub", "/run/hub-sensors")),
        ("vcan0,vcan1", "socketcan", ("vcan0", "vcan1")),
    ],
)
def test_a_robot_with_two_buses_is_put_on_two(
    two_buses: Path, bus: str, interface: str, channels: tuple[str, ...]
) -> None:
    options = SimOptions(two_buses, find_file("patrol", "missions"), bus=bus)
    robot = load_robot(two_buses, bus_overrides(options))
    assert tuple(each.channel for each in robot.buses) == channels
    assert {each.interface for each in robot.buses} == {interface}
    assert [each.bitrate for each in robot.buses] == [1_000_000, 500_000]


def test_each_bus_of_a_robot_needs_an_interface(two_buses: Path) -> None:
    options = SimOptions(two_buses, find_file("patrol", "missions"), bus="vcan0")
    with pytest.raises(ConfigError, match=r"1 interfaces found.*2 buses \(main, sensors\)"):
        bus_overrides(options)
    with pytest.raises(ConfigError, match=r"--bus vcan0,vcan1: 2 interfaces found.*one bus"):
        bus_overrides(on("vcan0,vcan1"))


@pytest.mark.parametrize(
    ("bus", "said"),
    [
        ("vcan 0", r"--bus vcan 0: channel must be the name of a network device.*not 'vcan 0'"),
        ("a-name-of-16-byt", "at most 15 bytes"),
        ("", "--bus : channel must not be empty"),
        ("simcan:a b", r"--bus simcan:a b: channel must be the name of a simulated bus"),
        ("slcan:tty", "allowed are simcan, simcan:CHANNEL or a SocketCAN interface"),
    ],
)
def test_a_bus_that_cannot_be_is_refused_before_the_run(bus: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        on(bus)


@pytest.mark.parametrize("channel", ['/run/a"b\\c d/hub', "simcan0"])
def test_a_robot_is_put_on_the_bus_whatever_its_path(channel: str) -> None:
    robot = load_robot(find_file("diff_drive"), bus_overrides(on(f"simcan:{channel}")))
    assert (robot.buses[0].interface, robot.buses[0].channel) == ("simcan", channel)


def test_a_channel_in_a_robots_file_is_refused_with_its_place() -> None:
    with pytest.raises(ConfigError, match=r"can.channel: must be .* not 'can 0'"):
        load_robot(find_file("diff_drive"), ['can.channel="can 0"'])


MISSION = """name = "m"
start = { x_m = 1.0, y_m = 1.0 }

[[item]]
kind = "wait"
duration_s = 1.0
"""


def test_a_mission_without_a_world_is_driven_in_the_one_that_is_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_text(MISSION)
    mission = load_mission(file)
    asked = SimOptions(Path("robot"), file, world="empty_room")
    assert asked.find_world(mission) == find_file("empty_room", "worlds")
    with pytest.raises(ConfigError, match='names no world; add world = "NAME" to it, or give'):
        SimOptions(Path("robot"), file).find_world(mission)
