"""`robotctl install` and `robotctl uninstall`: the robot as a service of this computer."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Final

import typer

from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, RobotFile
from robotctl.config.robot_file import find_file, load_robot
from robotctl.deploy.install import conflicts, installed_mission, read_manifest
from robotctl.deploy.install import install as install_files
from robotctl.deploy.install import uninstall as uninstall_files
from robotctl.deploy.service_files import ROBOT, check_executable, service_files
from robotctl.errors import ConfigError

INCOMPLETE = 1
_RUNNING_SYSTEMD: Final = Path("/run/systemd/system")
_RELOAD: Final = ("systemctl daemon-reload", "udevadm control --reload", "udevadm trigger")
_RELOAD_NETWORKD: Final = "systemctl try-restart systemd-networkd"

Root = Annotated[
    Path,
    typer.Option("--root", metavar="FOLDER", help="Folder to use as /, such as an image's root."),
]


@takes_options
def install(
    robot: RobotFile = DEFAULT_ROBOT,
    mission: Annotated[
        str,
        typer.Option(help="Mission file or name for mode AUTO; default: keep the installed one."),
    ] = "",
    no_mission: Annotated[
        bool, typer.Option("--no-mission", help="Remove an installed mission.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the changes, write nothing.")
    ] = False,
    root: Root = Path("/"),
) -> None:
    """Install the systemd service, CAN link and rights for one robot.

    Starts nothing that is not running; the CAN link is configured again. Files that somebody
    changed are not touched.
    """
    if mission and no_mission:
        raise ConfigError("--mission and --no-mission: give only one of them")
    root = root.absolute()
    kept = None if mission or no_mission else installed_mission(root)
    executable = Path(sys.executable).with_name("robotctl")
    files = service_files(
        robot,
        find_file(mission, "missions") if mission else kept,
        executable,
        os.cpu_count() or 1,
    )
    if kept is not None:
        print(f"mission kept: {kept}; --no-mission removes it")
    if dry_run:
        for each in files:
            print(f"### {root / each.path}\n{each.text}")
        for problem in conflicts(files, root):
            print(f"### in the way: {problem}")
    for program in (executable, Path(sys.executable)):
        check_executable(program)
    if dry_run:
        return
    for line in install_files(files, root):
        print(line)
    # Only an added device takes its queue's length.
    added = tuple(
        "udevadm trigger --action=add --subsystem-match=net "
        f"--sysname-match={shlex.quote(bus.channel)}"
        for bus in load_robot(robot).buses
    )
    # The service could keep nothing that it compiles.
    compiled = f"{shlex.quote(str(executable))} compile"
    reloaded = _run((compiled, "systemd-sysusers", *_RELOAD, *added, _RELOAD_NETWORKD), root)
    print(f"next: robotctl doctor --robot /{ROBOT}")
    print("then: systemctl enable --now systemd-networkd robotctl")
    print("emergency stop, from then on: systemctl kill --signal=SIGUSR1 robotctl")
    sys.exit(0 if reloaded else INCOMPLETE)


def uninstall(
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the changes, remove nothing.")
    ] = False,
    root: Root = Path("/"),
) -> None:
    """Stop the service and remove what `install` wrote; logs and state stay.

    Status 1: files that somebody changed were kept, or a command failed.
    """
    root = root.absolute()
    installed = bool(read_manifest(root).files)
    complete = not installed or _run(("systemctl disable --now robotctl",), root, dry_run=dry_run)
    lines, kept = uninstall_files(root, dry_run=dry_run)
    for line in (*lines, *kept):
        print(line)
    complete &= _run((*_RELOAD, _RELOAD_NETWORKD), root, dry_run=dry_run)
    print("left in place: /var/lib/robotctl, /var/log/robotctl and the user robotctl")
    sys.exit(0 if complete and not kept else INCOMPLETE)


def _run(commands: tuple[str, ...], root: Path, *, dry_run: bool = False) -> bool:
    """Run commands on a running systemd; elsewhere print them. Return whether none failed."""
    here = not dry_run and root == Path("/") and _RUNNING_SYSTEMD.is_dir()
    good = True
    for command in commands:
        if not here:
            print(f"run on the robot: {command}")
            continue
        print(command, flush=True)
        good &= subprocess.run(shlex.split(command), check=False).returncode == 0  # noqa: S603
    return good
