"""`robotctl replay`: a recorded run through the control core again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

import robotctl
from robotctl.words import counted

DIFFERENT = 1


def replay(
    file: Annotated[
        Path, typer.Argument(help="A record: control-*.rec, fault-*.rec, crash-*.rec, or a dump.")
    ],
) -> None:
    """Recompute every output of a record; status 1 and the first tick that differs."""
    from robotctl.workbench.replay.replay import differences, replay_file  # noqa: PLC0415 - the control core

    replayed = replay_file(file)
    result = replayed.result
    if replayed.version != robotctl.__version__:
        print(f"made by robotctl {replayed.version}, replayed by {robotctl.__version__}")
    gaps = f", {counted(result.gaps, 'gap')} in the record" if result.gaps else ""
    if replayed.is_cut:
        gaps += ", up to where the record was cut"
    if result.difference is None:
        print(f"{file}: {counted(result.agreed, 'tick')}, all outputs the same bit for bit{gaps}")
        return
    tick = result.difference.tick
    agree = "agrees" if result.agreed == 1 else "agree"
    print(f"{file}: {counted(result.agreed, 'tick')} {agree}{gaps}")
    print(f"tick {result.difference.number} of the run, at {tick.now_ns} ns, differs:")
    for name, recorded, computed in differences(result.difference):
        print(f"  {name}: recorded {recorded}, computed {computed}")
    print(f"  its inputs: {tick.inputs}")
    sys.exit(DIFFERENT)
