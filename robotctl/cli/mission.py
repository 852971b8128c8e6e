"""`robotctl mission`: missions of a running robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.cli.driving import NOT_REACHED, Instance, drive

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotctl.app.supervision.remote import RemoteRobot
    from robotctl.messages.control import ControlState, NavigationState

app = typer.Typer(help="Missions of a robot that runs on this computer.", no_args_is_help=True)

STOPPED = "paused: the robot stands, in mode HOLD; `robotctl mission resume` goes on"


@app.command("run")
def run_mission(
    file: Annotated[str, typer.Argument(help="Mission file or name.")], instance: Instance = ""
) -> None:
    """Let an armed robot drive a mission, from its first item to the end.

    Status 0: completed. 1: an item failed, or somebody else took the robot over. While it is
    paused, this waits. Ctrl-C pauses it.
    """
    from robotctl.app.processes.navigator import load_mission  # noqa: PLC0415
    from robotctl.config.robot_file import find_file  # noqa: PLC0415

    path = find_file(file, "missions").resolve()
    load_mission(path)  # what is wrong with the file is told with its lines
    content = path.read_bytes()
    drive(
        instance,
        lambda robot: robot.run_mission(str(path), content),
        lambda state: state.mission_completed,
        STOPPED,
    )


@app.command()
def pause(instance: Instance = "") -> None:
    """Let the robot stand, in mode HOLD; the mission keeps its place."""
    _ask(instance, lambda robot: robot.pause(), "paused")


@app.command()
def resume(instance: Instance = "") -> None:
    """Go on with a paused mission, try a failed item again, or give the go-ahead it waits for."""
    _ask(instance, lambda robot: robot.resume(), "goes on")


@app.command()
def abort(instance: Instance = "") -> None:
    """Give up the mission: the robot stands, and a restart begins at the first item."""
    _ask(instance, lambda robot: robot.abort(), "aborted")


@app.command()
def jump(
    item: Annotated[str, typer.Argument(help="Its number, counted from 1, or its name.")],
    instance: Instance = "",
) -> None:
    """Go on with another item: at once in mode AUTO, otherwise when the mission is resumed."""
    target = int(item) if item.isdecimal() else item
    _ask(instance, lambda robot: robot.jump(target), f"at item {item}")


@app.command()
def status(instance: Instance = "") -> None:
    """Print the mission, its present item, and how it gets on."""
    from robotctl.app.supervision.remote import RemoteRobot  # noqa: PLC0415

    with RemoteRobot(instance) as robot:
        state, control, silent = robot.navigation, robot.control, robot.silence
    console = plain_console()
    for line in [] if state is None else status_lines(state):
        console.print(line, soft_wrap=True)
    if control is not None:
        console.print(f"control: {silent or control_words(control)}", soft_wrap=True)


def control_words(control: ControlState) -> str:
    """Return the robot's state, and why it is in it."""
    words = control.state.name.lower().replace("_", " ")
    return f"{words}: {control.reason}" if control.reason else words


def status_lines(state: NavigationState) -> list[str]:
    """Return what there is to say of a mission."""
    if not state.items:
        return ["no mission is loaded"]
    name = f' "{state.item_name}"' if state.item_name else ""
    lines = [
        f"mission: {state.mission}{f', {state.mission_file}' if state.mission_file else ''}",
        f"state: {_state(state)}",
    ]
    if not state.mission_completed:
        lines.append(f"item: {state.item + 1} of {state.items}{name}")
    if state.message:
        lines.append(f"robot: {state.message}")
    lines += [f"loops: {state.loops}"] if state.loops else []
    lines += [f"trouble: {state.trouble}"] if state.trouble else []
    return lines


def _state(state: NavigationState) -> str:
    """Return how a mission is, in a few words."""
    if state.mission_completed:
        return "completed"
    if state.mission_failed:
        return "failed; `robotctl mission resume` tries its item again"
    if state.mode.name == "AUTO":
        return "waits for the go-ahead: `robotctl mission resume`" if state.waits else "under way"
    return f"not under way: mode {state.mode.name}"


def _ask(instance: str, what: Callable[[RemoteRobot], None], done: str) -> None:
    """Ask something of the robot, and say that it does it."""
    from robotctl.app.supervision.remote import RefusedError, RemoteRobot  # noqa: PLC0415

    console = plain_console()
    with RemoteRobot(instance) as robot:
        try:
            what(robot)
        except RefusedError as error:
            console.print(f"not done: {error}", soft_wrap=True)
            raise typer.Exit(NOT_REACHED) from error
        state = robot.navigation
    console.print(
        f"{done}{f': {state.message}' if state and state.message else ''}", soft_wrap=True
    )
