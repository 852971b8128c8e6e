"""Common ends of commands that calibrate: aborted, or without a patch."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, TypeVar

from robotctl.cli.console import plain_console
from robotctl.errors import CalibrationError, RobotctlError

ABORTED: Final = 1
WORSE: Final = 3

Options = TypeVar("Options")
R = TypeVar("R")


def calibrated(
    work: Callable[[Options, Callable[[str], None]], R],
    options: Options,
    error: type[RobotctlError] = CalibrationError,
) -> R:
    """Return the result of some work that says what it does; where it fails, end with status 1."""
    progress = plain_console(stderr=True)
    try:
        return work(options, lambda line: progress.print(f"{line} …"))
    except error as reason:
        progress.print(f"robotctl: {reason}", soft_wrap=True)
        sys.exit(ABORTED)


def refuse_patch(sentence: str, objections: Iterable[str], out: Path | None) -> int:
    """Say why there is no patch; return the exit status."""
    print(sentence)
    for objection in objections:
        print(f"  {objection}")
    if out is not None:
        print(f"{out} was not written.")
    return WORSE
