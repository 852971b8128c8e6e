"""What a robot's processes are started with: one configuration, validated once."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotctl.config.options import StackOptions, options_of_command_line
from robotctl.config.robot_file import config_directory, load_robot
from robotctl.errors import ConfigError

ROBOTS = sorted(config_directory().glob("*.toml"))
SETTINGS = ("control.pwm.slew_per_s=inf", "runtime.rate_hz=250", 'robot.name="other"')


def handed_over(options: StackOptions) -> StackOptions:
    """Return what a process reads from its command line."""
    _python, _m, *arguments = options.command("module")
    return options_of_command_line(arguments)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda path: path.stem)
@pytest.mark.parametrize("settings", [(), SETTINGS])
def test_a_process_has_the_configuration_that_its_parent_validated(
    robot: Path, settings: tuple[str, ...]
) -> None:
    options = StackOptions("robot", str(robot), settings).validated()
    assert handed_over(options).load() == load_robot(robot, settings)


@pytest.mark.parametrize("becomes", ["", "damaged", "[robot]\n", None])
def test_what_becomes_of_the_file_later_changes_nothing(
    tmp_path: Path, becomes: str | None
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(ROBOTS[0].read_text())
    expected = load_robot(path)
    options = StackOptions("robot", str(path)).validated()
    if becomes is None:
        path.unlink()
    else:
        path.write_text(becomes)
    assert handed_over(options).load() == expected
    assert options.validated() == options


def test_a_wrong_file_is_refused_by_the_parent(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(ROBOTS[0].read_text().replace("[robot]", "[robott]"))
    with pytest.raises(ConfigError, match="robott: unknown key"):
        StackOptions("robot", str(path)).validated()


def test_a_configuration_too_large_for_an_argument_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(f"{ROBOTS[0].read_text()}\n[simulation.notes]\ntext = '{131_072 * 'x'}'\n")
    options = StackOptions("robot", str(path)).validated()
    with pytest.raises(ConfigError, match=r"robot\.toml: the configuration has \d+ bytes as JSON"):
        options.command("module")
