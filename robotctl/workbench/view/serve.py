"""The process that serves a replay until it is interrupted."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import robotctl
from robotctl.app.supervision.signals import StopFlag
from robotctl.web.access import Access
from robotctl.web.config import WebConfig
from robotctl.web.listening import PageHost, listen
from robotctl.workbench.view.run import ReplayedRun
from robotctl.workbench.view.server import ReplayServer

_LOOK_S: Final = 0.1


PORT: Final = 8090
"""Port of the page, away from those of robots; where it is taken, the next free one."""


def serve(paths: Sequence[Path], tell: Callable[[str, list[str]], None]) -> None:
    """Serve recordings on this computer until SIGINT or SIGTERM.

    Parameters
    ----------
    paths
        The recordings, one or two.
    tell
        Called with the link and sentences on what is missing, once the page can be opened.

    Raises
    ------
    RecordingError
        If one of them is no recording.
    LinkError
        If there is no free port.
    OSError
        If a file cannot be read.
    """
    stopped = StopFlag()
    with ExitStack() as stack:
        runs = [ReplayedRun(each, stack) for each in paths]
        listener = stack.enter_context(listen(WebConfig(port=PORT)))
        port = listener.getsockname()[1]
        static = Path(robotctl.__file__).parent / "web" / "static"
        host = PageHost(ReplayServer(runs, Access({}, (), port), static).app)
        tell(f"http://127.0.0.1:{port}/", [note for run in runs for note in run.notes])
        gc.freeze()

        async def until_stopped() -> None:
            serving = asyncio.create_task(host.serve([listener]))
            while not stopped() and not serving.done():
                await asyncio.sleep(_LOOK_S)
            host.should_exit = True
            await serving

        asyncio.run(until_stopped())
