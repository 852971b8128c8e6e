"""`robotctl replay`: a recorded run through the control core again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

import robotctl
from robotctl.app.replay import replay_file

DIFFERENT = 1


def replay(
    file: Annotated[Path, typer.Argument(help="control.rec, as --record writes it.")],
) -> None:
    """Compute every command of a record anew; status 1 and the first tick where they differ."""
    result = replay_file(file)
    if result.version != robotctl.__version__:
        print(f"made by robotctl {result.version}, replayed by {robotctl.__version__}")
    if result.different is None:
        print(f"{file}: {result.agreed} ticks, all commands the same bit for bit")
        return
    print(f"{file}: differs after {result.agreed} ticks, at {result.different.now_ns} ns")
    print(f"recorded {result.different.command}")
    print(f"computed {result.command}")
    sys.exit(DIFFERENT)
