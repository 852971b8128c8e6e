"""Common parts of the simulator's command lines: errors, poses, numbers, output lines."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final, NoReturn

POSE = "X,Y,HEADING_DEG"


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2, with a hint for a value that looks like an option."""
        if message.endswith("expected one argument"):
            message += "; one that begins with a minus sign needs `=`, as --start=-1,2,90"
        self.exit(2, f"{self.prog}: {message}\n")


def parse_pose(text: str) -> tuple[float, float, float]:
    """Return metres and radians of X,Y,HEADING_DEG."""
    try:
        x_m, y_m, heading_deg = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not {POSE}") from None
    if not all(map(math.isfinite, (x_m, y_m, heading_deg))):
        raise argparse.ArgumentTypeError(f"{text!r} is not finite")
    return x_m, y_m, math.radians(heading_deg)


def parse_natural(text: str) -> int:
    """Return a whole number >= 0."""
    if not (text.isascii() and text.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0 on")
    return int(text)


def tell(line: str) -> None:
    """Write a line to standard output at once; drop all lines once the reader is gone."""
    try:
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def file_among(folder: str, *suffixes: str) -> Callable[[str], Path]:
    """Return a parser of a file argument: a path, or a name with or without its suffix.

    A file in the working directory precedes a built-in configuration in `folder` ("": robots) with
    the first of the suffixes.
    """

    def find(text: str) -> Path:
        package = Path(__file__).resolve().parents[1]
        installed = package / "robotctl" / "configs"
        configs = installed if installed.is_dir() else package / "configs"
        for place in (Path(), configs / folder):
            for name in (text, *(f"{text}{suffix}" for suffix in suffixes)):
                if (place / name).is_file():
                    return place / name
        if Path(text).suffix in suffixes or "/" in text:
            return Path(text)  # errors are reported when it is read
        names = sorted(each.stem for each in (configs / folder).glob(f"*{suffixes[0]}"))
        raise argparse.ArgumentTypeError(
            f"{text!r} is no file, and no name of one that comes along: {', '.join(names)}"
        )

    return find


WORLD: Final = file_among("worlds", ".toml", ".yaml", ".yml")
