"""Files are named alike everywhere: by path, or by name; the nearest one is meant."""

import itertools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from robotctl.app.localisation.localisation_files import files_beside
from robotctl.config.robot_file import config_directory, find_file
from robotctl.errors import ConfigError
from robotctl.maps.localisation_map import find_map
from robotctl.maps.world import find_world
from tests.cli.command import status_of

ROOM = """
[world]
name = "room"
start = { x_m = 1.0, y_m = 1.0, heading_deg = 0.0 }

[[wall]]
name = "outer"
points = [[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]]
closed = true
"""
MISSION = """
name = "short"
world = "room"
start = { x_m = 1.0, y_m = 1.0, heading_deg = 0.0 }

[[item]]
kind = "drive"
waypoints = [[1.0, 1.0], [1.5, 1.0]]
"""
KINDS = {
    "": ("diff_drive", "robot's file"),
    "missions": ("patrol", "mission"),
    "worlds": ("flat", "world"),
    "scenarios": ("bad_day", "scenario of faults"),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a folder of one's own in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "room.toml").write_text(ROOM)
    (tmp_path / "mine" / "short.toml").write_text(MISSION)
    return tmp_path


@pytest.mark.parametrize("folder", KINDS)
def test_a_name_is_that_of_a_file_beside_then_here_then_among_those_that_come_along(
    here: Path, folder: str
) -> None:
    name = KINDS[folder][0]
    shipped = config_directory() / folder / f"{name}.toml"
    beside = here / "mine"
    assert find_file(name, folder, beside=beside) == shipped
    shutil.copy(shipped, here)
    assert find_file(name, folder, beside=beside) == Path(f"{name}.toml")
    shutil.copy(shipped, beside)
    assert find_file(name, folder, beside=beside) == beside / f"{name}.toml"


def test_a_world_beside_its_mission_needs_no_suffix(here: Path) -> None:
    status = status_of("sim", "--lockstep", "--mission", "mine/short", "--report", "r.json")
    assert status == 0
    report = json.loads((here / "r.json").read_text())
    assert (report["world"], report["mission"]) == ("room", "short")


def test_a_ros_map_has_a_name_as_well(here: Path) -> None:
    (here / "hall.yaml").write_text("image: hall.pgm\n")
    assert find_world("hall") == find_map("hall", here / "mine") == here / "hall.yaml"


def test_a_map_beside_the_robots_file_goes_along_by_its_name(here: Path) -> None:
    robot = here / "mine" / "rover.toml"
    text = (config_directory() / "diff_drive.toml").read_text()
    robot.write_text(f'{text}\n[localisation]\nmethod = "mcl"\nmap = "room"\n')
    from robotctl.config.robot_file import load_robot

    assert files_beside(load_robot(robot), robot) == {Path("room.toml"): ROOM.encode()}


@pytest.mark.parametrize(("asked", "given"), list(itertools.permutations(KINDS, 2)))
def test_a_file_of_another_kind_is_called_what_it_is(here: Path, asked: str, given: str) -> None:
    name, kind = KINDS[given]
    needed = KINDS[asked][1]
    with pytest.raises(ConfigError) as refused:
        find_file(name, asked)
    assert str(refused.value) == f"{name}: is the name of a {kind}; a {needed} is needed"
    copy = here / "copied.toml"
    shutil.copy(config_directory() / given / f"{name}.toml", copy)
    for way in ("copied", "copied.toml", str(copy)):
        with pytest.raises(ConfigError, match=rf"copied.toml: is a {kind}; a {needed} is needed$"):
            find_file(way, asked)


def test_a_ros_map_is_no_mission(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "hall.yaml").write_text("image: hall.pgm\n")
    assert status_of("sim", "--mission", "hall.yaml") == 2
    assert "hall.yaml: is a ROS map; a mission is needed" in capsys.readouterr().err


def test_what_is_nowhere_gets_the_nearest_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("sim", "--world", "flatt") == 2
    assert "flatt: no such file, and not in " in (said := capsys.readouterr().err)
    assert 'did you mean "flat"?' in said


@pytest.mark.parametrize("command", ["check", "show"])
def test_check_and_show_take_the_same_file(
    command: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(config_directory() / "tricycle.toml", here / "mine" / "rover.toml")
    for name in ("mine/rover", "mine/rover.toml", "tricycle"):
        assert status_of("config", command, name, "--set", 'robot.name="rover"') == 0
        assert "rover" in capsys.readouterr().out
    assert status_of("config", command, "patrol") == 2
    assert "patrol: is the name of a mission; a robot's file is needed" in capsys.readouterr().err


def firmware_says(*arguments: str, cwd: Path) -> tuple[int, str]:
    command = [sys.executable, "-m", "firmware_sim", *arguments, "--duration", "0.01"]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def test_the_simulated_firmware_knows_the_same_names(here: Path) -> None:
    (here / "room.toml").write_text(ROOM)
    bus = ("--bus", f"simcan:{here}/bus")
    names = ("--robot", "tricycle", "--world", "room", "--faults", "bad_day")
    assert firmware_says(*names, *bus, cwd=here) == (0, "")
    assert firmware_says("--robot", "diff_drive", "--world", "flat", *bus, cwd=here) == (0, "")
    status, said = firmware_says("--robot", "diff_drive", "--world", "flatt", cwd=here)
    assert status == 2
    assert "'flatt' is no file, and no name of one that comes along: clutter, " in said
    status, said = firmware_says("--robot", "diff_drive", "--world", "mine/short.toml", cwd=here)
    assert (status, said) == (2, "mine/short.toml: is a mission; a world is needed\n")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            "sim --mission patrol --map flat",
            "--map: has no effect without a localiser; add --localiser mcl or ekf",
        ),
        ("sim --mission patrol --start known", "--start: has no effect without a localiser"),
        (
            "sim --mission patrol --start unknown",
            'localisation.start: "unknown" needs method "mcl"',
        ),
        (
            "sim --mission patrol --sensors sonar --set localisation.method='none'",
            "--sensors: has no effect",
        ),
        ("sim --lockstep --stay", "--stay: has no effect with --lockstep"),
        ("sim --lockstep --hard-real-time", "--hard-real-time: has no effect with --lockstep"),
        ("calibrate odometry --log x.log --seed 2", "--seed: has no effect with recorded drives"),
        ("calibrate odometry --mrclam-robot 2", "--mrclam-robot: has no effect without --log"),
        ("calibrate odometry --time-unit ms", "--time-unit: has no effect without --log"),
        ("characterise --log x.log --seed 2", "--seed: has no effect with --log"),
        ("characterise --max-range 8", "--max-range: has no effect without --log"),
        ("places recognise --book b --log x --seed 2", "--seed: has no effect without --world"),
        ("places learn a --book b --live robot --seed 2", "--seed: has no effect without --world"),
    ],
)
def test_an_option_without_effect_is_refused(
    options: str, said: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "b").write_text("")
    assert status_of(*options.split()) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("localiser", ["mcl", "ekf"])
def test_with_a_localiser_the_map_is_that_of_the_world(localiser: str) -> None:
    short = ["sim", "--world", "flat", "--lockstep", "--max-seconds", "1", "--localiser", localiser]
    assert status_of(*short) == 3
    assert status_of(*short, "--map", "flat") == 3


def test_a_localiser_in_the_robots_file_gives_them_their_effect(here: Path) -> None:
    options = [
        "--set",
        "localisation.method=mcl",
        "--set",
        "localisation.map=flat",
        "--map",
        "flat",
    ]
    short = ["sim", "--mission", "patrol", "--lockstep", "--max-seconds", "1"]
    assert status_of(*short, *options) == 3
