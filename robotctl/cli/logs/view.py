"""`robotctl view`: a recording in the page, without a robot."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def view(
    run: Annotated[Path, typer.Argument(help="Folder of --record, or one robot-*.mcap of it.")],
    run2: Annotated[Path | None, typer.Argument(help="Another one, to be shown beside it.")] = None,
) -> None:
    """Replay a recording in the web page, on this computer and without a robot, until Ctrl-C.

    With two they run beside each other, from the beginning of each or from its first driving.
    """
    from robotctl.workbench.view.serve import serve  # noqa: PLC0415 - loads numpy

    def tell(url: str, notes: list[str]) -> None:
        for note in notes:
            print(f"note: {note}", file=sys.stderr)
        print(f"replay: {url}", flush=True)

    serve([run] if run2 is None else [run, run2], tell)
