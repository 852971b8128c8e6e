"""The web process with a leak built in: from a signal on it takes all memory it can have."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Any

from hil_tests.faulty_navigation import LEAK, PIECE_BYTES, limit_memory
from robotctl.app.processes import web
from robotctl.app.processes.entry import enter


def main() -> int:
    """Run the web process until SIGTERM, or until it has no memory left."""
    leaking = False

    class LeakingServer(web.PageServer):
        leaked: list[bytearray] | None = None

        def relay(self, *arguments: Any) -> None:
            if leaking:
                if self.leaked is None:
                    self.leaked = []
                    limit_memory()
                self.leaked.append(bytearray(PIECE_BYTES))
            super().relay(*arguments)

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal leaking
        leaking = True

    signal.signal(LEAK, on_signal)
    web.PageServer = LeakingServer  # type: ignore[misc]
    return enter("web", web.run)


if __name__ == "__main__":
    sys.exit(main())
