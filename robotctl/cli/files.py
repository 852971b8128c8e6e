"""Files that commands write: checked before the work, with plain errors after."""

from __future__ import annotations

import importlib.util
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Final

from robotctl.config.patch import Tables, as_overrides
from robotctl.errors import DISK, ConfigError, DiskError

PLOTS: Final = (".png", ".svg", ".pdf")


def check_files(
    *files: Path | None,
    plot: Path | None = None,
    option: str = "--plot",
    suffixes: tuple[str, ...] = PLOTS,
) -> None:
    """Refuse what could not be written, before anything is measured; None is not asked for.

    The picture `plot` is asked for by `option`, in a format of `suffixes`.

    Raises
    ------
    ConfigError
        If a folder does not exist, a file is a folder, or `plot` cannot be drawn: matplotlib is
        missing, or its suffix is not one of them.
    """
    if plot is not None and importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(
            f"{option} needs matplotlib, which is not installed; install it with\n"
            "  sudo /opt/robotctl/bin/pip install '/opt/robotctl-source[plot]'\n"
            "where these are the installation and your copy of robotctl (in a checkout: make setup)"
        )
    if plot is not None and plot.suffix.lower() not in suffixes:
        raise ConfigError(f"{option} {plot}: the suffix must be one of {', '.join(suffixes)}")
    for file in (*files, plot):
        if file is not None and not file.parent.is_dir():
            raise ConfigError(f"{file}: the folder {file.parent} does not exist")
        if file is not None and file.is_dir():
            raise ConfigError(f"{file}: is a folder, a file is needed")


def write_file(file: Path, write: Callable[[Path], object]) -> None:
    """Let `write` write a file.

    Raises
    ------
    DiskError
        If the disk is full or fails.
    ConfigError
        If it cannot be written for another reason.
    """
    try:
        write(file)
    except OSError as error:
        kind = DiskError if error.errno in DISK else ConfigError
        raise kind(f"{file}: cannot be written: {error.strerror or error}") from error


def give_plot(file: Path | None, save: Callable[[Path], object]) -> None:
    """Write a plot and say where, if it is asked for."""
    if file is not None:
        write_file(file, save)
        print(f"plot: {file}")


def give_patch(patch: str, file: Path | None) -> None:
    """Write a configuration patch and say where, or show it."""
    if file is None:
        print(f"The patch:\n\n{patch}")
    else:
        write_file(file, lambda path: path.write_text(patch, encoding="utf-8"))
        print(f"patch: {file}")


def advise_keeping(robot: Path, tables: Tables) -> None:
    """Say how a patch gets into the robot's file."""
    command = ["robotctl", "config", "check", str(robot)]
    command += [word for setting in as_overrides(tables) for word in ("--set", setting)]
    print(f"To use it, replace the keys in {robot}, then check the file:\n  {shlex.join(command)}")
