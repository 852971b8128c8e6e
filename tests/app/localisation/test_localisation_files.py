"""The map and the places that a robot names: checked, and taken along when it is installed."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.app.localisation.localisation_files import check_localisation
from robotctl.cli.commands import app
from robotctl.config.robot_file import config_directory, find_file, load_robot
from robotctl.deploy.install import install, uninstall
from robotctl.deploy.service_files import MISSION, ROBOT, ServiceFile, service_files
from robotctl.errors import ConfigError, MissionError
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.maps.map_file import save_map
from robotctl.maps.place_file import save_book
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap

PROGRAM = Path("/bin/true")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with a ROS map, a world and a file of places below it."""
    home = tmp_path / "home"
    (home / "maps").mkdir(parents=True)
    cells = np.zeros((20, 200), np.int8)
    cells[0] = 100
    save_map(home / "maps" / "office", GridMap(cells, 0.05, SE2()))
    shutil.copy(config_directory() / "worlds" / "flat.toml", home / "room.toml")
    save_book(home / "places.toml", PlaceBook(signatures=SignatureConfig(24, 3.5)))
    return home


def robot_file(home: Path, *lines: str, robot: str = "diff_drive") -> Path:
    """Write a robot's file with these lines under [localisation]."""
    text = find_file(robot).read_text()
    assert "[localisation]" not in text
    path = home / "mine.toml"
    path.write_text("\n".join((text, "[localisation]", *lines, "")))
    return path


def files_of(robot: Path) -> list[ServiceFile]:
    return service_files(robot, None, PROGRAM, 4)


def everything(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


@pytest.mark.parametrize("chart", ["maps/office.yaml", "room.toml"])
def test_map_and_places_are_found_where_the_robots_file_was_installed(
    tmp_path: Path, home: Path, chart: str
) -> None:
    robot = robot_file(home, 'method = "mcl"', f'map = "{chart}"', 'places = "places.toml"')
    root = tmp_path / "root"
    root.mkdir()
    install(files_of(robot), root)
    shutil.rmtree(home)
    installed = root / ROBOT
    check_localisation(load_robot(installed), installed)
    # The update of docs/deploy.md: from the installed file.
    before = everything(root)
    again = files_of(installed)
    lines = install(again, root)
    assert len(lines) == len(again) > 0
    assert all(line.startswith("same") for line in lines)
    assert everything(root) == before
    assert uninstall(root)[1] == []
    assert list(root.iterdir()) == []


def test_a_map_that_the_robot_does_not_use_any_more_goes_with_the_next_installation(
    tmp_path: Path, home: Path
) -> None:
    install(files_of(robot_file(home, 'map = "maps/office.yaml"')), tmp_path)
    image = tmp_path / "etc/robotctl/maps/office.pgm"
    assert image.read_bytes() == (home / "maps/office.pgm").read_bytes()
    install(files_of(robot_file(home, 'map = "room.toml"')), tmp_path)
    assert not image.exists()
    assert (tmp_path / "etc/robotctl/room.toml").exists()


@pytest.mark.parametrize("chart", ["flat", "{home}/room.toml"])
def test_what_is_found_anyway_is_not_copied(home: Path, chart: str) -> None:
    robot = robot_file(home, f'map = "{chart.format(home=home)}"')
    assert [file.path for file in files_of(robot)] == [
        file.path for file in files_of(robot_file(home))
    ]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (['map = "nowhere.yaml"'], r"localisation\.map: nowhere\.yaml: no such file"),
        (['map = "broken.yaml"'], r"localisation\.map: .*broken\.yaml: image: must be the path"),
        (['method = "mcl"', 'places = "none.toml"'], r"localisation\.places: none\.toml"),
        (['method = "ekf"', 'map = "maps/office.yaml"'], r"the EKF needs walls"),
    ],
)
def test_a_map_or_places_that_do_not_load_are_said_before_the_robot_starts(
    home: Path, lines: list[str], words: str
) -> None:
    (home / "broken.yaml").write_text("resolution: 0.1\n")
    if not any(line.startswith("map") for line in lines):
        lines = [*lines, 'map = "room.toml"']
    robot = robot_file(home, *lines)
    with pytest.raises(ConfigError, match=words):
        files_of(robot)
    done = CliRunner().invoke(app, ["config", "check", str(robot)])
    assert isinstance(done.exception, ConfigError)
    with pytest.raises(ConfigError, match=words):
        raise done.exception


def test_map_and_places_that_are_both_missing_are_both_said(home: Path) -> None:
    robot = robot_file(home, 'method = "mcl"', 'map = "a.yaml"', 'places = "b.toml"')
    with pytest.raises(ConfigError, match=r"(?s)localisation\.map: .*\n.*localisation\.places: "):
        check_localisation(load_robot(robot), robot)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (['map = "../room.toml"'], "leads out of the folder"),
        (['map = "mission.toml"'], r"mission\.toml is taken"),
    ],
)
def test_what_would_not_be_found_after_installing_is_not_installed(
    home: Path, lines: list[str], words: str
) -> None:
    below = home / "robots"
    below.mkdir()
    shutil.copy(home / "room.toml", below / MISSION.name)
    robot = robot_file(below, *lines)
    with pytest.raises(ConfigError, match=words):
        files_of(robot)


def test_a_mission_that_this_robot_cannot_drive_is_not_installed(home: Path) -> None:
    mission = home / "turn.toml"
    mission.write_text(
        'name = "turn"\nworld = "flat"\nstart = {x_m = 0.0, y_m = 0.0}\n'
        '[[item]]\nkind = "turn_to"\nheading_deg = 90.0\n'
    )
    service_files(find_file("diff_drive"), mission, PROGRAM, 4)
    with pytest.raises(MissionError, match=r"item 1 \(turn_to\).*cannot turn on the spot"):
        service_files(find_file("tricycle"), mission, PROGRAM, 4)


def test_the_gap_of_this_robots_guard_counts_when_a_mission_is_checked(home: Path) -> None:
    mission = home / "wall.toml"
    mission.write_text(
        'name = "wall"\nworld = "flat"\nstart = {x_m = 0.0, y_m = 0.0}\n'
        '[[item]]\nkind = "follow_wall"\nside = "left"\ndistance_m = 0.5\n'
        "until = {front_below_m = 0.2}\n"
    )
    robot = robot_file(home, 'method = "none"')
    service_files(robot, mission, PROGRAM, 4)
    wide = robot.read_text() + "\n[navigation.guard]\nmargin_m = 0.25\n"
    robot.write_text(wide)
    with pytest.raises(MissionError, match=r"front_below_m = 0\.2 .*stops 0\.25 m before"):
        service_files(robot, mission, PROGRAM, 4)
