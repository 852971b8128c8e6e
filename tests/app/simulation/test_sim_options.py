"""What a user asks of a simulated run: the bus is checked as a robot's file is."""

from pathlib import Path

import pytest

from robotctl.app.simulation.sim_options import SimOptions, bus_overrides
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
    assert on(bus).channel == channel


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
    assert (robot.can.interface, robot.can.channel) == ("simcan", channel)


def test_a_channel_in_a_robots_file_is_refused_with_its_place() -> None:
    with pytest.raises(ConfigError, match=r"can.channel: must be .* not 'can 0'"):
        load_robot(find_file("diff_drive"), ['can.channel="can 0"'])
