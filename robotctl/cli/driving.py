"""Parts shared by commands that let a running robot drive: progress, Ctrl-C, the status."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from robotctl.cli.console import plain_console

if TYPE_CHECKING:
    from robotctl.app.supervision.remote import RemoteRobot
    from robotctl.messages.control import NavigationState

NOT_REACHED = 1

Instance: TypeAlias = Annotated[
    str, typer.Option(help="Name of the robot; default: the only one that runs.")
]


def drive(
    instance: str,
    begin: Callable[[RemoteRobot], Iterator[NavigationState]],
    is_done: Callable[[NavigationState], bool | None],
    stopped: str,
) -> None:
    """Let a robot drive, and tell how it gets on until that has ended.

    Parameters
    ----------
    instance
        Name of the robot.
    begin
        Yields the robot's states until it has ended.
    is_done
        Whether that ended well, by the last state.
    stopped
        What to say after Ctrl-C.

    Raises
    ------
    Exit
        With status 1 if it did not end well.
    """
    from robotctl.app.supervision.remote import RefusedError, RemoteRobot  # noqa: PLC0415

    console = plain_console()
    said: tuple[int, str] | None = None
    with RemoteRobot(instance) as robot, console.status("") as status:
        try:
            for state in begin(robot):
                silent = robot.silence
                status.update(f"[dim]{state.message}[/dim] {silent}" if silent else state.message)
                words = state.item, re.sub(r"[\d.]+", "", state.message)
                if state.message and words != said:  # of a countdown the first line
                    said = words
                    console.print(state.message, soft_wrap=True)
        except KeyboardInterrupt:
            robot.hold()
            console.print(stopped, soft_wrap=True)
            raise
        except RefusedError as error:
            console.print(f"not done: {error}", soft_wrap=True)
            raise typer.Exit(NOT_REACHED) from error
    if not is_done(state):
        raise typer.Exit(NOT_REACHED)
