"""An options class gives a command its options, and the command an object of that class."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from robotctl.cli.arguments import refuse_unused
from robotctl.cli.options import takes_options
from robotctl.errors import ConfigError


def pair(text: str) -> tuple[int, int]:
    left, right = map(int, text.split(","))
    return left, right


@dataclass(frozen=True, slots=True)
class Drive:
    log: Annotated[Path, typer.Option(help="A log.")]
    speed_m_s: Annotated[float, typer.Option("--speed", min=0.0, help="Speed.")] = 0.5
    at: Annotated[
        tuple[int, int] | None, typer.Option(parser=pair, metavar="X,Y", help="Place.")
    ] = None
    names: Annotated[tuple[str, ...], typer.Option("--name", help="Names.")] = ()
    is_slow: Annotated[bool, typer.Option("--slow/--fast", help="Whether slow.")] = True
    inner: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.names == ("nobody",):
            raise ConfigError("--name nobody: not allowed")


@dataclass(frozen=True, slots=True)
class Robot:
    robot: Annotated[str, typer.Argument(help="A robot.")]
    found: list[str] = field(default_factory=list)


def call(command, *words):
    app = typer.Typer(rich_markup_mode=None)
    app.command()(takes_options(command))
    return CliRunner().invoke(app, [*map(str, words)])


def both(robot: Robot, drive: Drive, out: Annotated[Path | None, typer.Option()] = None) -> None:
    """Drive."""
    typer.echo((robot, drive, out))


def test_defaults_are_those_of_the_class_and_given_values_replace_them():
    result = call(both, "rover", "--log", "a.log")
    assert result.output == f"{(Robot('rover'), Drive(Path('a.log')), None)}\n"
    words = ("--speed", 2, "--at", "3,4", "--name", "a", "--name", "b", "--fast", "--out", "o")
    result = call(both, "rover", "--log", "a.log", *words)
    expected = Drive(Path("a.log"), 2.0, (3, 4), ("a", "b"), is_slow=False)
    assert result.output == f"{(Robot('rover'), expected, Path('o'))}\n"


def test_what_is_not_annotated_is_no_option():
    shown = call(both, "--help").output
    assert "--inner" not in shown
    assert "--found" not in shown
    options = (
        "--log",
        "--speed",
        "--at X,Y",
        "--name",
        "--slow / --fast",
        "--out",
        "[default: 0.5",
    )
    assert all(each in shown for each in options)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("rover",), "Missing option '--log'"),
        (("rover", "--log", "a", "--speed", "-1"), "--speed"),
        (("rover", "--log", "a", "--speed", "fast"), "--speed"),
    ],
)
def test_bad_options_are_refused_as_those_of_any_command(words, said):
    result = call(both, *words)
    assert result.exit_code == 2
    assert said in result.output


def test_what_the_class_refuses_is_an_error_of_the_command():
    result = call(both, "rover", "--log", "a", "--name", "nobody")
    assert isinstance(result.exception, ConfigError)


def test_a_command_can_add_what_users_do_not_give():
    def added(ctx: typer.Context, choice: partial[Drive]) -> None:
        refuse_unused(ctx, "here", "speed_m_s")
        typer.echo(f"{choice(inner=('x',))} {choice.keywords['log']}")

    expected = Drive(Path("a"), inner=("x",))
    assert call(added, "--log", "a").output == f"{expected} a\n"
    refused = call(added, "--log", "a", "--speed", "0.5").exception
    assert str(refused) == "--speed: has no effect here"


def test_the_command_keeps_its_name_and_help():
    made = takes_options(both)
    assert (made.__name__, inspect.getdoc(made)) == ("both", "Drive.")
