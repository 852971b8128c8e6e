"""The subcommands of `robotctl`, each imported when it is called: help need not wait for all."""

from __future__ import annotations

import importlib
from typing import Any, Final

import typer
from typer.core import TyperGroup
from typer.main import get_command

import robotctl

COMMANDS: Final = {
    "sim": ("sim:sim", "Drive a mission in simulation and score it."),
    "campaign": (
        "campaign.campaign:campaign",
        "Drive many simulated runs of robots, missions, faults and settings, and judge them.",
    ),
    "campaign compare": (
        "campaign.compare:compare",
        "Compare two campaigns run by run: better, worse, or no difference.",
    ),
    "run": (
        "run:run",
        "Run control, navigation and telemetry until Ctrl-C; arm from a ground station.",
    ),
    "goto": (
        "goto:goto",
        "Let a robot that runs on this computer, and is armed, drive to a place by plan.",
    ),
    "explore": (
        "goto:explore",
        "Let a robot that runs on this computer, and is armed, explore until its map is complete.",
    ),
    "web": (
        "web:web",
        "Print the link to the web page of a robot that runs on this computer, as a QR code too.",
    ),
    "mavlink": ("mavlink.mavlink:app", "MAVLink: parameters of a robot, its messages, keys."),
    "mission": ("mission:app", "Missions of a robot that runs on this computer."),
    "tune": (
        "tune.tune:tune",
        "Measure the simulated robot's wheels, compute gains, show the responses before and after.",
    ),
    "setup": (
        "setup.setup:setup",
        "Lead through the first day of a robot, and write what is found into its file.",
    ),
    "doctor": (
        "doctor:doctor",
        "Check whether this computer and the robot on it are fit to drive; moves nothing.",
    ),
    "install": (
        "install:install",
        "Install the systemd service, CAN link and rights for one robot.",
    ),
    "uninstall": (
        "install:uninstall",
        "Stop the service and remove what `install` wrote; logs and state stay.",
    ),
    "compile": (
        "compile:compile_all",
        "Compile all inner loops for this processor, so that no robot and no command waits for it.",
    ),
    "replay": (
        "logs.replay:replay",
        "Recompute every output of a record; status 1 and the first tick that differs.",
    ),
    "view": (
        "logs.view:view",
        "Replay a recording in the web page, on this computer and without a robot, until Ctrl-C.",
    ),
    "report": (
        "logs.report:report",
        "Show a recording on one page: map, paths, figures over time, states and notices.",
    ),
    "plot": (
        "logs.plot:plot",
        "Plot fields of a recording over time, with the robot's states, restarts and gaps.",
    ),
    "localise": (
        "localise.localise:localise",
        "Localise on a recorded log, and compare with its reference.",
    ),
    "topology": ("topology.topology:app", "Divide a map into places and passages."),
    "map": (
        "map.map:map_log",
        "Map the lidar scans of a recorded log, at its reference poses or its odometry.",
    ),
    "slam": (
        "slam.slam:slam",
        "Make a trajectory and a map from a recorded drive, by landmarks or by scans.",
    ),
    "slam edit": (
        "slam.edit:edit",
        "Close, refuse and move by hand in a map that was made by scans, or join two of them.",
    ),
    "plan": (
        "plan.plan:plan",
        "Find the path between two places of a map, or say why there is none.",
    ),
    "optimise": (
        "optimise.optimise:optimise",
        "Find the poses and points that fit the measurements of a graph best.",
    ),
    "characterise": (
        "characterise.characterise:characterise",
        "Find noise, outliers and limits of sonars or lidar, with 95 % intervals.",
    ),
    "config": ("config:app", "Check and show robot configurations."),
    "can": ("can:app", "Load of the CAN bus, and the devices on it."),
    "record": ("logs.record:app", "The flight recorder and the logs."),
    "calibrate": ("calibrate.calibrate:app", "Calibrate the robot from drives and recordings."),
    "places": ("places.places:app", "Learn and recognise places by sonar or images."),
    "camera": ("camera.camera:app", "Calibrate a camera, and measure on the floor with it."),
}
"""Subcommands: module and function (or group) below `robotctl.cli`, and the beginning of the help.

A test holds the second to the docstring.
"""

OLD_NAMES: Final = {"localize": "localise", "optimize": "optimise", "characterize": "characterise"}
"""Other spellings of subcommands, which scripts may use."""

_WITH_NUMBERS: Final = frozenset({"goto"})
"""Subcommands whose arguments are numbers."""


class _LazyGroup(TyperGroup):
    """Subcommands that are only names until one is called or completed."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the subcommand of the arguments, imported now, with its name and the rest."""
        args = [OLD_NAMES.get(args[0], args[0]), *args[1:]]
        if " ".join(args[:2]) in COMMANDS:
            args = [" ".join(args[:2]), *args[2:]]
        name, command, rest = super().resolve_command(ctx, args)
        return name, load(name) if name in COMMANDS else command, rest


def load(name: str) -> Any:
    """Import a subcommand of the table and return it as typer runs it."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    target = getattr(importlib.import_module(f"robotctl.cli.{module}"), attribute)
    holder = typer.Typer(callback=_nothing, add_completion=False, rich_markup_mode=None)
    if isinstance(target, typer.Typer):
        holder.add_typer(target, name=name)
    else:
        # An argument may be a negative number.
        holder.command(name, context_settings={"ignore_unknown_options": name in _WITH_NUMBERS})(
            target
        )
    group: Any = get_command(holder)
    command = group.commands[name]
    _write_plainly(command)
    return command


def _write_plainly(command: Any) -> None:
    """Let the help of a command and those below it be read as it was written.

    Typer's markup would take `[m]` for a style and show Python's names of types.
    """
    command.rich_markup_mode = None
    command.short_help = (command.help or "").partition("\n\n")[0]  # else cut at 45 characters
    for each in command.params:
        if each.param_type_name == "argument":
            each.metavar = each.metavar or each.name.upper()
            each.display_type_rich = lambda ctx: ""  # noqa: ARG005 - as typer calls it
        elif each.metavar is None and not each.is_flag:
            each.metavar = _metavar(each.type_descriptor)
    for each in getattr(command, "commands", {}).values():
        _write_plainly(each)


def _metavar(kind: Any) -> str:
    """Return what stands for a value of a type in a usage line."""
    if kind.is_choice:
        return "|".join(map(str, kind.choices))
    if kind.is_path:
        return "FILE"
    return {int: "N", float: "X"}.get(kind.annotation, "NAME")


def _nothing() -> None:
    """Stand for a subcommand that is not imported."""


app = typer.Typer(
    cls=_LazyGroup,
    name="robotctl",
    help="Real-time controller for wheeled robots.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _name, (_, _summary) in COMMANDS.items():
    app.command(_name, help=_summary, short_help=_summary)(_nothing)


@app.command()
def version() -> None:
    """Print the version."""
    print(robotctl.__version__)
