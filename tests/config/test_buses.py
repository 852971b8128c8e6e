"""The buses of a robot's file: one table as ever, or a list of them with names."""

from pathlib import Path

import pytest

from robotctl.config.robot_file import (
    RobotConfig,
    find_file,
    load_robot,
    robot_of_json,
    robot_to_json,
)
from robotctl.drivers.can.config import CanConfig
from robotctl.errors import ConfigError

TABLE = '[can]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = 1_000_000\n'
LIST = TABLE.replace("[can]", "[[can]]")
SECOND = '\n[[can]]\nname = "sensors"\nchannel = "can1"\nbitrate = 500_000\n'
NODES = '\n[nodes]\nsonar = "sensors"\n'


@pytest.fixture
def robot(tmp_path: Path):
    def write(buses: str, *overrides: str) -> RobotConfig:
        text = find_file("diff_drive").read_text()
        assert TABLE in text
        path = tmp_path / "robot.toml"
        path.write_text(text.replace(TABLE, buses))
        return load_robot(path, overrides)

    return write


def refusal(robot, *arguments: str) -> str:
    with pytest.raises(ConfigError) as refused:
        robot(*arguments)
    return str(refused.value)


def test_a_single_table_is_one_bus(robot) -> None:
    config = robot(TABLE)
    assert config.buses == (CanConfig(),)
    assert config.can == CanConfig()
    assert config.bus_of("sonar") is config.buses[0]


def test_a_list_of_tables_is_several_buses_and_nodes_name_theirs(robot) -> None:
    config = robot(LIST + SECOND + NODES)
    assert [bus.name for bus in config.buses] == ["main", "sensors"]
    assert config.bus_of("sonar") is config.buses[1]
    assert config.bus_of("drive") is config.buses[0]
    assert robot_of_json(robot_to_json(config)) == config


def test_settings_of_a_listed_bus_have_its_number(robot) -> None:
    config = robot(LIST + SECOND, "can.1.bitrate=250000", "can.0.data_bitrate=2000000")
    assert [bus.bitrate for bus in config.buses] == [1_000_000, 250_000]
    assert config.buses[0].data_bitrate == 2_000_000
    said = refusal(robot, LIST + SECOND, "can.bitrate=250000")
    assert said.endswith("can.bitrate: no such key; its entries are can.0 to can.1")


@pytest.mark.parametrize(
    ("buses", "said"),
    [
        (
            LIST + SECOND.replace('name = "sensors"\n', ""),
            "can[1].name: must differ from those before, since nodes and drives name their bus",
        ),
        (
            LIST + SECOND.replace("can1", "can0"),
            "can[1].channel: must differ from those before, found socketcan 'can0'",
        ),
        (
            LIST + SECOND + NODES.replace("sonar =", "sona ="),
            'nodes.sona: no such node; did you mean "sonar"?',
        ),
        (
            LIST + SECOND + NODES.replace('= "sensors"', '= "sensor"'),
            "nodes.sonar: no bus 'sensor'; did you mean \"sensors\"?",
        ),
        (
            LIST + SECOND.replace("bitrate", "bitrat"),
            'can[1].bitrat: unknown key; did you mean "bitrate"?',
        ),
        (
            LIST + SECOND.replace("500_000", "500_001"),
            "can[1].bitrate: must be one of 10000, 20000,",
        ),
        (
            LIST + SECOND.replace('"sensors"', '"my sensors"'),
            "can[1].name: must be letters, digits, - and _, a letter first, not 'my sensors'",
        ),
        (
            TABLE + "data_bitrate = 500_000\n",
            "must be 0 (classic CAN) or, with bitrate 1000000, one of 1000000, 2000000, 4000000, ",
        ),
        (TABLE + "sample_point = 75\n", "can.sample_point: must be 0.5 to 0.9, or 0 for CiA's"),
        (TABLE + "data_sample_point = 0.2\n", "can.data_sample_point: must be 0.5 to 0.9"),
    ],
)
def test_buses_that_do_not_fit_are_refused_where_they_stand(robot, buses: str, said: str) -> None:
    message = refusal(robot, buses)
    assert len(message.splitlines()) == 1
    assert "robot.toml:" in message
    assert said in message


def test_a_robot_has_a_bus(robot) -> None:
    said = "can: must be a table or a list of tables, one for each bus, found []"
    assert refusal(robot, TABLE, "can=[]").endswith(said)
